"""The gap of a diagnosis: of errors that are known, and an interval that holds the truth as often as it says."""

from __future__ import annotations

import numpy as np
import pytest

from hdagen.arm.arrays import Array
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay

NOISE = {"motor_position_1": 1e-3, "joint_position_1": 1e-5}
WINDOW = 250


def replay(log: Log, errors: dict[str, Array]) -> Replay:
    return Replay(
        columns={name: log[name] + error for name, error in errors.items()},
        states=np.zeros((len(log), 4)),
        errors={name: float(np.sqrt(np.mean(error**2))) for name, error in errors.items()},
        noise=NOISE,
        relative={},
        starts=np.arange(0, len(log), WINDOW),
        beyond_law=0,
        notes=(),
    )


def log(rows: int) -> Log:
    return Log(1e-3 * np.arange(rows), {name: np.zeros(rows) for name in NOISE}, 1, "test")


def errors(rng: np.random.Generator, rows: int, size: float) -> dict[str, Array]:
    """White errors of that many times the noise, larger in some windows than in others."""
    swell = np.repeat(rng.uniform(0.5, 1.5, -(-rows // WINDOW)), WINDOW)[:rows]
    return {name: size * noise * swell * rng.normal(size=rows) for name, noise in NOISE.items()}


def test_errors_that_are_known_give_their_multiples_where_they_are_held_out() -> None:
    rows = 4000
    before = {name: np.full(rows, 8.0 * noise) for name, noise in NOISE.items()}
    after = {"motor_position_1": np.full(rows, 4e-3), "joint_position_1": np.full(rows, 1e-5)}
    for error in (*before.values(), *after.values()):
        error[:1000] = error[2600:3100] = 1e3  # not held out: must not count
    held = np.ones(rows, bool)
    held[:1000] = held[2600:3100] = False
    found = evaluate_gap(replay(log(rows), before), replay(log(rows), after), LogPortion(log(rows), held))
    assert found["before"] == pytest.approx(8.0) and found["after"] == pytest.approx(2.0)
    assert found["shrink"] == pytest.approx(6 / 7)
    one = found["by_channel"]["motor_position_1"]
    assert (one["before"], one["after"]) == (pytest.approx(8.0), pytest.approx(4.0)) and one["noise"] > 0
    assert found["interval"] == [pytest.approx(6 / 7), pytest.approx(6 / 7)]


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    rng, held, rows = np.random.default_rng(5), 0, 8000
    truth = (10.0 - 3.0) / (10.0 - 1.0)
    scale = np.sqrt(np.mean(rng.uniform(0.5, 1.5, 100000) ** 2))
    for _ in range(60):
        before, after = (replay(log(rows), errors(rng, rows, size / scale)) for size in (10.0, 3.0))
        low, high = evaluate_gap(before, after, LogPortion.all_rows(log(rows)))["interval"]
        assert low < high
        held += low <= truth <= high
    assert held >= 48  # of 57 expected; eight blocks make it a little short


def test_no_gap_has_no_share_and_one_block_no_interval() -> None:
    same = errors(np.random.default_rng(1), 900, 0.8)
    found = evaluate_gap(replay(log(900), same), replay(log(900), same), LogPortion.all_rows(log(900)))
    assert found["shrink"] is None and found["interval"] is None


def test_windows_that_begin_with_a_guess_are_left_out_as_long_as_others_are_left() -> None:
    held, starts = LogPortion.all_rows(log(1000)), np.array([0, 250, 500, 750])
    left = held.without_windows((500,), starts)
    np.testing.assert_array_equal(np.flatnonzero(~left.rows), np.arange(500, 750))
    assert held.without_windows((), starts).rows.all() and held.without_windows((0, 250, 500, 750), starts) is held
    error = {name: np.full(1000, noise) for name, noise in NOISE.items()}
    spoilt = {name: np.where(left.rows, e, 1e3) for name, e in error.items()}
    assert evaluate_gap(replay(log(1000), spoilt), replay(log(1000), error), left)["before"] == pytest.approx(1.0)
