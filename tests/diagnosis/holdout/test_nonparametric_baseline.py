"""The flexible correction: it tells what it has not seen, says nothing of noise, and closes a gap that it can."""

from __future__ import annotations

import numpy as np
import pytest
from replayed import simulated

from hdagen.arm.compiled_arm import Arm, load
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.holdout.nonparametric_baseline import RidgeRegression, fit_nonparametric_baseline
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import replay


def slow(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Features that change slowly, so that neighbours are alike."""
    return np.cumsum(rng.normal(size=(rows, columns)), 0) / np.sqrt(rows)


def test_a_map_tells_what_it_has_not_seen() -> None:
    rng = np.random.default_rng(1)
    X, weights = slow(rng, 4000, 12), rng.normal(size=12)
    y = X @ weights + 0.05 * rng.normal(size=4000) + 3.0
    of = RidgeRegression.fit(X[:3000], y[:3000])
    left = of(np.clip(X[3000:], of.low, of.high)) - (np.clip(X[3000:], of.low, of.high) @ weights + 3.0)
    assert np.sqrt(np.mean(left**2)) < 0.1 * y.std()


def test_noise_is_told_by_its_mean() -> None:
    rng = np.random.default_rng(2)
    of = RidgeRegression.fit(slow(rng, 2000, 60), rng.normal(2.0, 1.0, 2000))
    said = of(slow(rng, 500, 60))
    assert np.sqrt(np.mean((said - 2.0) ** 2)) < 0.4  # the noise has 1


def test_a_map_does_not_go_beyond_what_it_saw() -> None:
    rng = np.random.default_rng(3)
    X = rng.uniform(-1, 1, (1000, 3))
    of = RidgeRegression.fit(X, X[:, 0] ** 2 + X[:, 1])
    np.testing.assert_allclose(of(np.full((1, 3), 50.0)), of(X.max(0)[None]))


@pytest.mark.parametrize("parameter, factor", [("viscous_friction_1", 4.0), ("mass_2", 1.3)])
def test_a_gap_of_torque_is_closed_in_part(parameter: str, factor: float) -> None:
    arm, plain = load("paper"), load("paper")
    arm.parameters[parameter] = factor * arm.parameters.described[parameter].nominal
    log, held = simulated(arm, 8.0, seed=1), simulated(arm, 3.0, seed=2)
    before = replay(plain, held)
    found = evaluate_gap(
        before,
        before,
        LogPortion.all_rows(held),
        fit_nonparametric_baseline(plain, LogPortion.all_rows(log), LogPortion.all_rows(held), before),
    )
    assert 1.0 < found["achievable"] < 0.8 * found["before"]


@pytest.mark.parametrize("kinds", [("motor_torque",), ("motor_torque", "motor_torque_command")])
def test_a_log_of_torques_is_corrected_as_one_of_currents(kinds: tuple[str, ...]) -> None:
    """Where the robot file has a torque constant: the numbers are the same, only a channel's name and unit differ."""
    arm, plain = load("paper"), load("paper")
    arm.parameters["viscous_friction_1"] = 4.0 * arm.parameters.described["viscous_friction_1"].nominal
    gaps = []
    for names in (kinds, tuple(kind.replace("torque", "current") for kind in kinds)):
        logs = [named(plain, simulated(arm, 3.0, seed=seed), names) for seed in (1, 2)]
        before = replay(plain, logs[1])
        shown, held = map(LogPortion.all_rows, logs)
        gaps.append(evaluate_gap(before, before, held, fit_nonparametric_baseline(plain, shown, held, before)))
    assert gaps[0]["achievable"] == pytest.approx(gaps[1]["achievable"], rel=1e-6) and gaps[0]["achievable"] > 1.0
    assert gaps[0]["before"] == pytest.approx(gaps[1]["before"], rel=1e-6)


def named(arm: Arm, log: Log, kinds: tuple[str, ...]) -> Log:
    """The log with its inputs as ``kinds`` alone, torques by the robot file's constant."""
    columns = {k: v for k, v in log.columns.items() if not k.startswith(("motor_current", "motor_torque"))}
    for kind in kinds:
        current = kind.replace("torque", "current")
        for j in range(1, arm.n + 1):
            unit = arm.parameters[f"torque_constant_{j}"] if "torque" in kind else 1.0
            columns[f"{kind}_{j}"] = log[f"{current}_{j}"] * unit
    return Log(log.time, columns, log.n_joints, log.source)


def test_a_correction_that_makes_it_worse_is_none() -> None:
    plain = load("paper")
    log, held = simulated(plain, 2.0, seed=1), simulated(plain, 2.0, seed=2)
    before = replay(plain, held)
    found = evaluate_gap(
        before,
        before,
        LogPortion.all_rows(held),
        fit_nonparametric_baseline(plain, LogPortion.all_rows(log), LogPortion.all_rows(held), before),
    )
    assert found["achievable"] <= found["before"] == pytest.approx(1.0, abs=0.1)
