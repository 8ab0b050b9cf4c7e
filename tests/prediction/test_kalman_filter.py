"""The compiled bank of filters against the textbook's: dense matrices, one filter at a time, in numpy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from replayed import FLEXIBLE, HYSTERESIS, INPUT_AND_SENSOR, MEMORY, RIGID, simulated

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.log.measured_log import Log
from hdagen.prediction.driving_inputs import read_driving_inputs
from hdagen.prediction.kalman_filter import BANK_CHANNELS, FILTER_DEVIATIONS, FilterBank
from hdagen.prediction.measurement_model import Readings, are_within_limits
from hdagen.prediction.prediction_settings import PREDICTION

CASES: dict[str, tuple[str, tuple[str, ...], dict[str, float], bool]] = {
    "flexible": (FLEXIBLE, (), {}, False),
    "flexible, velocities logged": (FLEXIBLE, (), {}, True),
    "effects that remember": (FLEXIBLE, MEMORY, HYSTERESIS, False),
    "a sensor's effect": (FLEXIBLE, INPUT_AND_SENSOR, {"encoder_wave_2": 1e-3}, False),
    "rigid": (RIGID, (), {}, False),
}
SPAN = 40


@pytest.fixture(scope="module")
def made(build: Callable[..., Any]) -> Callable[..., tuple[Arm, Log, Readings, Array]]:
    """made(case, profile="portable") -> arm, a log of it, its readings, its inputs."""

    def filtered(case: str, profile: str = "portable") -> tuple[Arm, Log, Readings, Array]:
        robot, effects, parameters, velocities = CASES[case]
        arm = Arm(build(robot, profile, effects).folder)
        arm.parameters.update({k: v for k, v in parameters.items() if k in arm.parameters})
        log = simulated(arm, velocities=velocities)
        return arm, log, Readings.from_log(arm, log), read_driving_inputs(arm, log, "command")[0]

    return filtered


def run(bank: FilterBank, log: Log, inputs: Array, first: list[int], last: list[int], noise: float = 1e-5) -> Array:
    """The bank's states (W, nx) at the rows ``last``."""
    s = bank.readings
    hidden = np.zeros((len(first), bank.arm.nx - bank.m))
    each = np.full((len(first), len(s.names)), noise) * np.abs(s.factors)
    return bank.run(log.time, inputs, np.array(first), np.array(last), each, hidden)


@pytest.mark.parametrize(
    ("case", "profile"), [*((case, "portable") for case in CASES), ("flexible", "native"), ("rigid", "native")]
)
def test_the_bank_is_the_textbook_s(case: str, profile: str, made: Callable[..., Any]) -> None:
    """A native build steps the filters in the lanes of vectors."""
    arm, log, readings, inputs = made(case, profile)
    bank = FilterBank(arm, readings)
    first, last = [0, 237], [SPAN, 237 + SPAN // 2]
    found = run(bank, log, inputs, first, last)
    for k, (begin, end) in enumerate(zip(first, last, strict=True)):
        noise = np.full((1, len(readings.names)), 1e-5) * np.abs(readings.factors)
        start = bank._compute_initial_states(log.time, np.array([begin]), np.array([end]), noise)
        expected = textbook(bank, log, inputs, begin, end, noise[0], *(part[0] for part in start))
        np.testing.assert_allclose(found[k], expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


def test_spans_do_not_know_of_each_other(made: Callable[..., Any]) -> None:
    arm, log, readings, inputs = made("flexible")
    bank = FilterBank(arm, readings)
    first, last = [0, 50, 50, 200], [30, 110, 90, 290]
    alone = [run(bank, log, inputs, [begin], [end])[0] for begin, end in zip(first, last, strict=True)]
    assert run(bank, log, inputs, first, last).tobytes() == np.stack(alone).tobytes()


def test_a_bank_of_which_every_filter_is_lost_says_so(made: Callable[..., Any]) -> None:
    arm, log, readings, inputs = made("flexible")
    bank = FilterBank(arm, readings)
    bank.state_bounds = np.full(bank.m, 1e-12)
    assert np.isnan(run(bank, log, inputs, [100], [100 + SPAN])).all()


@pytest.mark.parametrize("span", [(-1, 5), (5, 5), (5, 10**6)])
def test_rows_outside_the_log_are_refused(span: tuple[int, int], made: Callable[..., Any]) -> None:
    arm, log, readings, inputs = made("rigid")
    with pytest.raises(ValueError, match="spans must be rows"):
        arm.module.filters(*(arrays(arm, log, readings, inputs) | {"spans": np.array([span], np.int32)}).values())


@pytest.mark.parametrize(
    ("changed", "error", "says"),
    [
        ({"places": 99}, ValueError, "places those of channels"),
        ({"settings": 0.0}, ValueError, "longest step above 0"),
        ({"read": np.zeros(3)}, ValueError, "read must have"),
        ({"spread": np.zeros(10)}, ValueError, "the extra torques of this arm"),
        ({"time": np.zeros(1200, np.int64)}, TypeError, "time must hold float64"),
    ],
)
def test_wrong_arrays_are_refused(
    changed: dict[str, Any], error: type[Exception], says: str, made: Callable[..., Any]
) -> None:
    arm, log, readings, inputs = made("rigid")
    given = arrays(arm, log, readings, inputs)
    more = {k: v if np.ndim(v) else np.full_like(given[k], v) for k, v in changed.items()}
    with pytest.raises(error, match=says):
        arm.module.filters(*(given | more).values())
    with pytest.raises(TypeError, match="filters takes"):
        arm.module.filters(given["begun"])


def arrays(arm: Arm, log: Log, readings: Readings, inputs: Array) -> dict[str, Any]:
    """What the compiled bank takes, of a span of five rows."""
    bank, M, L = FilterBank(arm, readings), len(readings.names), len(FILTER_DEVIATIONS)
    E = bank.D - bank.m
    return {
        "begun": np.zeros((L, arm.nx)),
        "extra": np.zeros((L, E)),
        "covariance": np.zeros((L, bank.D, bank.D)),
        "spans": np.array([[0, 5]], np.int32),
        "u": inputs,
        "time": log.time,
        "c": arm.c,
        "measured": readings.measured,
        "variance": np.ones((1, M)),
        "read": bank.output_matrix,
        "places": np.zeros(M, np.int32),
        "spread": np.ones((L, E)),
        "settings": np.ones(3 + arm.nx + bank.m + 3 * arm.n),
        "found": np.empty(arm.nx),
    }


def textbook(
    bank: FilterBank, log: Log, inputs: Array, begin: int, end: int, noise: Array, x: Array, extra: Array, P: Array
) -> Array:
    """The state at row ``end``: x (L, nx), extra (L, E), P (L, D, D) at ``begin``."""
    lanes = [[x[k].copy(), extra[k].copy(), P[k].copy()] for k in range(len(FILTER_DEVIATIONS))]
    told, score = np.zeros(len(lanes)), np.zeros(len(lanes))
    for row in range(begin, end):
        dt = float(log.time[row + 1] - log.time[row])
        F = transition(bank, lanes[int(told.argmax())][0], inputs[row], dt)
        for k, lane in enumerate(lanes):
            predict(bank, lane, F, bank.disturbance_deviations[k], inputs[row], dt)
            if (
                not are_within_limits(bank.arm, lane[0])
                or (np.sqrt(np.diag(lane[2])[: bank.m]) >= bank.state_bounds).any()
            ):
                told[k] = score[k] = -np.inf
            if np.isinf(told[k]):
                lane[:] = [x[k].copy(), 0.0 * extra[k], 0.0 * P[k]]
                continue
            likely = update(bank, lane, inputs[row + 1], bank.readings.measured[row + 1], noise)
            told[k] += likely
            if row + 1 - begin > PREDICTION.burn_in_share * (end - begin):
                score[k] += likely
    return np.asarray(lanes[int(score.argmax())][0])


def transition(bank: FilterBank, x: Array, u: Array, dt: float) -> Array:
    """F (D, D): of x and of the extra, which has not faded yet."""
    arm, m, n, D = bank.arm, bank.m, bank.n, bank.D
    at, steps = x.copy(), arm.count_steps(dt)
    for j, place in enumerate(bank.sliding_velocities):
        if abs(at[place]) < bank.free_speeds[j]:
            at[place] = np.copysign(bank.free_speeds[j], at[place])
    for j in arm.manifest["flexible"]:
        motor, joint = arm.index(f"motor_position_{j}"), arm.index(f"joint_position_{j}")
        torsion = at[motor] / arm.parameters[f"ratio_{j}"] - at[joint]
        at[joint] += torsion - np.clip(torsion, -bank.rated_torsions[j - 1], bank.rated_torsions[j - 1])
    slopes = arm.evaluate("rhs_jacobian", x=at, u=u)
    G = np.zeros((D, D))
    G[:m, :m] = slopes["by_x"].reshape(arm.nx, arm.nx).T[:m, :m]
    G[:m, m : m + n] = slopes["by_u"].reshape(arm.nu, arm.nx).T[:m, :n]
    for k, j in enumerate(arm.manifest["flexible"]):
        G[arm.index(f"joint_velocity_{j}"), m + n + k] = 1.0
    G *= dt / steps
    return np.linalg.matrix_power(np.eye(D) + G + G @ G / 2 + G @ G @ G / 6 + G @ G @ G @ G / 24, steps)


def predict(bank: FilterBank, lane: list[Array], F: Array, spread: Array, u: Array, dt: float) -> None:
    """From one row to the next."""
    arm, m, n = bank.arm, bank.m, bank.n
    x, extra, P = lane
    steps, fade = arm.count_steps(dt), np.exp(-dt / PREDICTION.disturbance_correlation_time)
    held = u.copy()
    held[:n] += extra[:n]
    for _ in range(steps):
        x = arm.step(x, held, dt / steps, exact=True)
    for k, j in enumerate(arm.manifest["flexible"], n):
        x[arm.index(f"joint_position_{j}")] += 0.5 * extra[k] * dt**2
        x[arm.index(f"joint_velocity_{j}")] += extra[k] * dt
    F = F.copy()
    F[m:, m:] *= fade
    Q = np.diag(np.r_[np.zeros(m), spread**2 * (1 - fade**2)])
    lane[:] = x, extra * fade, F @ P @ F.T + Q


def update(bank: FilterBank, lane: list[Array], u: Array, measured: Array, noise: Array) -> float:
    """By what a row shows; the log-likelihood of that."""
    x, extra, P = lane
    outputs, H = bank.arm.outputs(x, u), bank.output_matrix
    assert {name for name, _ in bank.readings.outputs} <= set(BANK_CHANNELS)
    expected = np.array([outputs[name][j - 1] for name, j in bank.readings.outputs])
    error = measured - expected - H[:, bank.m :] @ extra
    S = H @ P @ H.T + np.diag(noise**2)
    K = P @ H.T @ np.linalg.inv(S)
    change = K @ error
    moved = x.copy()
    moved[: bank.m] += change[: bank.m]
    left = np.eye(bank.D) - K @ H
    lane[:] = moved, extra + change[bank.m :], left @ P @ left.T + K @ np.diag(noise**2) @ K.T  # Joseph's form
    return float(-0.5 * (error @ np.linalg.solve(S, error) + np.linalg.slogdet(S)[1]))
