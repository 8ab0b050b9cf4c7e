"""The time left goes down where a diagnosis goes on as usual, and up where it finds more to do."""

from __future__ import annotations

import re

import pytest

from hdagen.diagnosis.progress import Progress

USUAL = [  # stages of a log of two effects with the second at which each began, and where it ended
    (0.0, "model"),
    (2.6, "what the log suggests"),
    (12.0, "screening 115 candidates"),
    (33.0, "fitting none, round 1 of 3"),
    (35.0, "fitting payload@2, round 2 of 3"),
    (40.0, "fitting none, round 3 of 3"),
    (51.0, "fitting payload@2 + stiffness@1, round 1 of 3"),
    (58.0, "fitting payload@2 + stiffness@1, round 3 of 3"),
    (64.0, "fitting payload@2 + stiffness@1 + backlash@2, round 1 of 3"),
    (70.0, "fitting none, from payload@2 + stiffness@1, round 1 of 3"),
    (77.0, "going on with payload@2 + stiffness@1, payload@2"),
    (82.0, "replay of held-out motion"),
    (92.0, "where and when"),
    (95.0, "report"),
]
END = 97.0


def said(stages: list[tuple[float, str]], capsys: pytest.CaptureFixture[str]) -> list[float | None]:
    """The seconds left that were said at each stage."""
    now = [0.0]
    say = Progress(lambda: now[0])
    for now[0], stage in stages:
        say(stage)
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(" s  ")[0].strip() for line in lines] == [f"{t:.1f}" for t, _ in stages]
    assert all(stage in line for line, (_, stage) in zip(lines, stages, strict=True))
    found = [re.search(r", about (\d+) s left$", line) for line in lines]
    return [float(one[1]) if one else None for one in found]


def test_the_time_left_is_that_of_a_usual_log(capsys: pytest.CaptureFixture[str]) -> None:
    left = said(USUAL, capsys)
    assert left[:2] == [None, None]  # too early to say
    for (passed, _), seconds in list(zip(USUAL, left, strict=True))[2:]:
        assert seconds is not None and abs(seconds - (END - passed)) < 0.25 * END


def test_more_to_do_takes_longer_and_what_is_left_out_does_not(capsys: pytest.CaptureFixture[str]) -> None:
    spring = [(96.0, "a spring in what the robot file calls rigid"), (100.0, "fitting none, round 1 of 3")]
    found = said([*USUAL[:-2], *spring], capsys)
    (before, after), last = found[-3:-1], found[-1]
    assert before is not None and after is not None and last is not None and before < 20 < last <= after
    short = said([*USUAL[:6], (44.0, "replay of held-out motion"), (46.0, "where and when")], capsys)
    assert short[-1] == pytest.approx(1.0, abs=1.0)


def test_a_stage_that_comes_late_from_another_thread_changes_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    stages = [(40.0, "fitting payload@2, from none, round 3 of 3"), (40.0, "fitting none, from none, round 1 of 3")]
    left = said(stages, capsys)
    assert left[0] == left[1] is not None
