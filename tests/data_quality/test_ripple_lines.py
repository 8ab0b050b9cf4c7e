"""Lines of the input over the motor's turns: those that were put in are named with their size, nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from hdagen.data_quality.finding import Finding, RobotFacts
from hdagen.data_quality.log_profile import LogProfile
from hdagen.data_quality.ripple_lines import find_ripple_lines
from hdagen.log.measured_log import Log

NOISE = 0.01  # A
STEP = 2 * np.pi / 4096  # rad


def found(
    speed: np.ndarray, lines: dict[float, float], hertz: float = 0.0, prismatic: bool = False, lost: float = 0.0
) -> list[Finding]:
    """Of a motor at ``speed`` (T,), rad/s, whose current has ``lines`` over its angle and one of ``hertz``; a share of
    the rows is ``lost``."""
    rng, time = np.random.default_rng(3), 1e-3 * np.arange(len(speed))
    angle = np.cumsum(speed) * 1e-3
    current = 0.8 * np.sign(speed) + 0.003 * speed + NOISE * rng.standard_normal(len(time))
    current = current + sum(size * np.sin(k * angle + k) for k, size in lines.items())
    current = current + 0.2 * np.sin(2 * np.pi * hertz * time)
    columns = {"motor_current_1": current, "motor_position_1": np.round(angle / STEP) * STEP}
    kept = rng.random(len(time)) >= lost
    columns = {name: values[kept] for name, values in columns.items()}
    log = Log(time[kept], columns, 1, "made")
    return find_ripple_lines(LogProfile(log), RobotFacts((100.0,), {}, (None,), (None,), (prismatic,)), None)


STEADY = np.full(6000, 40.0)
SWEPT = np.linspace(20.0, 80.0, 6000)


@pytest.mark.parametrize("lost", [0.0, 0.01, 0.05])
@pytest.mark.parametrize("speed", [STEADY, -STEADY, SWEPT, np.concatenate([SWEPT, -SWEPT])])
def test_lines_are_named_with_their_size(speed: np.ndarray, lost: float) -> None:
    (one,) = found(speed, {1: 0.05, 12: 0.1, 24: 0.02}, lost=lost)
    assert (one.name, one.joint) == ("cycles", 1)
    for k, size in ((1, "0.05"), (12, "0.1"), (24, "0.02")):
        text = one.sentence.partition(f" {k} (")[2]
        assert float(text.partition(" A")[0]) == pytest.approx(float(size), rel=0.12)
    assert one.sentence.count(" A)") == 3
    assert ("At this one speed" in one.sentence) == (np.ptp(np.abs(speed)) == 0.0)


def test_at_most_five_are_named_the_largest() -> None:
    (one,) = found(SWEPT, {k: 0.02 * k for k in range(1, 9)})
    assert [f" {k} (" in one.sentence for k in range(1, 9)] == [False] * 3 + [True] * 5


@pytest.mark.parametrize(
    "speed, lines, hertz",
    [
        (STEADY, {}, 0.0),
        (SWEPT, {}, 50.0),  # of time
        (SWEPT, {6.5: 0.2}, 0.0),  # of another wheel
        (STEADY[:2000], {12: 0.1}, 0.0),  # too few turns
        (30.0 * np.sin(np.linspace(0.0, 12.0, 6000)), {12: 0.1}, 0.0),  # too few at a time
    ],
)
def test_what_does_not_go_with_the_turns_is_none(speed: np.ndarray, lines: dict[float, float], hertz: float) -> None:
    assert found(speed, lines, hertz) == []


def test_a_drive_that_slides_has_no_turns() -> None:
    assert found(STEADY, {12: 0.1}, prismatic=True) == []


def test_by_chance_there_is_hardly_ever_one() -> None:
    seen = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        speed = 40.0 + 20.0 * np.sin(np.linspace(0.0, rng.uniform(5, 20), 6000) + rng.uniform(0, 6))
        time, angle = 1e-3 * np.arange(6000), np.cumsum(speed) * 1e-3
        columns = {"motor_current_1": rng.standard_normal(6000), "motor_position_1": angle}
        machine = RobotFacts((100.0,), {}, (None,), (None,), (False,))
        seen += len(find_ripple_lines(LogProfile(Log(time, columns, 1, "noise")), machine, None))
    assert seen <= 2
