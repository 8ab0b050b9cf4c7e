"""The time left goes down where a diagnosis goes on as usual, and up where it finds more to do."""

from __future__ import annotations

import re

import pytest

from hdagen.diagnosis.progress import RACE_COUNT, RACE_SHARES, STAGE_SHARES, Progress
from hdagen.diagnosis.stages.stage import Stage

USUAL = [  # stages of a log of two effects with the second at which each began, and where it ended
    (0.0, Stage.MODELS),
    (1.9, Stage.DATA),
    (2.6, Stage.DIRECT_EVIDENCE),
    (3.5, Stage.NULL_MODEL),
    (12.0, Stage.SCREENING),
    (33.0, Stage.RACE_ROUND_1),
    (35.0, Stage.RACE_ROUND_2),
    (40.0, Stage.RACE_ROUND_3),
    (51.0, Stage.RACE_ROUND_1),
    (58.0, Stage.RACE_ROUND_3),
    (64.0, Stage.RACE_ROUND_1),
    (70.0, Stage.RIVALS),
    (77.0, Stage.CLOSE_CALLS),
    (82.0, Stage.HOLDOUT),
    (92.0, Stage.LOCATION),
    (95.0, Stage.REPORT),
]
END = 97.0


def follow(stages: list[tuple[float, Stage]], capsys: pytest.CaptureFixture[str]) -> list[float | None]:
    """The seconds left that are printed at each stage."""
    now = [0.0]
    progress = Progress(clock=lambda: now[0])
    for now[0], stage in stages:
        progress(stage)
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(" s  ")[0].strip() for line in lines] == [f"{t:.1f}" for t, _ in stages]
    assert all(stage.value in line for line, (_, stage) in zip(lines, stages, strict=True))
    found = [re.search(r", about (\d+) s left$", line) for line in lines]
    return [float(one[1]) if one else None for one in found]


def test_every_stage_has_a_share_of_the_time() -> None:
    assert STAGE_SHARES.keys() | RACE_SHARES.keys() | {Stage.SPRINGS} == set(Stage)
    assert all(len(shares) == RACE_COUNT for shares in RACE_SHARES.values())
    shares = [STAGE_SHARES.get(stage, RACE_SHARES.get(stage, (0.0,))[0]) for stage in Stage if stage != Stage.SPRINGS]
    assert shares == sorted(shares)  # stages stand in the order in which they begin


def test_the_time_left_is_that_of_a_usual_log(capsys: pytest.CaptureFixture[str]) -> None:
    left = follow(USUAL, capsys)
    assert left[:3] == [None, None, None]  # too early to say
    for (passed, _), seconds in list(zip(USUAL, left, strict=True))[4:]:
        assert seconds is not None and abs(seconds - (END - passed)) < 0.25 * END


def test_more_to_do_takes_longer_and_what_is_left_out_does_not(capsys: pytest.CaptureFixture[str]) -> None:
    springs = [(96.0, Stage.SPRINGS), (100.0, Stage.RACE_ROUND_1)]
    found = follow([*USUAL[:-2], *springs], capsys)
    (before, after), last = found[-3:-1], found[-1]
    assert before is not None and after is not None and last is not None and before < 20 < last <= after
    short = follow([*USUAL[:8], (44.0, Stage.HOLDOUT), (46.0, Stage.LOCATION)], capsys)
    assert short[-1] == pytest.approx(1.0, abs=1.0)


def test_a_further_race_takes_no_more_than_the_last_one(capsys: pytest.CaptureFixture[str]) -> None:
    races = [(40.0, stage) for _ in range(RACE_COUNT + 1) for stage in RACE_SHARES]
    left = follow(races, capsys)
    assert left[-1] == left[-4] is not None
