"""Forces on the handle and the errors of the estimated joint torques: the runs of Fig. 15, and the causes that disturb
their start."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.log.measured_log import Log
from hdagen.paper.figures.kinematic_torsion_figures import measure_torsion
from hdagen.paper.figures.tracking_runs import make_predictive_controller
from hdagen.paper.prototype.torque_estimator import (
    HALL_SMOOTHING,
    HAND_FREQUENCY,
    PASSED_PERIODS,
    Estimates,
    Rows,
    column_rms,
    estimate_torques,
)
from hdagen.paper.prototype.virtual_prototype import (
    PERIOD,
    STRUCTURE_FAULTS,
    TORSION_JOINT_1,
    TORSION_JOINT_2,
    Bench,
    DrivenRun,
    drive_arm,
    encoders_of,
    fine_sensors,
    paper_circle,
    torsion_changes,
    without_kinematic_torsion,
)
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push

MOTOR_TORQUE_CONSTANT = 0.0525  # N m/A
JOINT_TORQUE = 4.0  # N m at the joint, IV.A: 0.04 N m at the motor
HANDLE_POSTURE = (0.3, 0.9)  # rad, assumed: a bent arm
START_SECONDS = 1.0  # s that count as the start
INVERTIBLE_TORSION = 1.9e-3  # rad of torsion, just below the end of the laws' inverse
LARGEST_ERROR_SHARE = 0.05  # largest error, as a share of the peak torque
LEAST_IMPROVEMENT = 3.0  # smallest factor by which compensation has to reduce the error
HOLDING_FORCE, INDEX_MARK_ANGLE = 11.0, 0.02  # assumed: N of a hand on the handle; rad to the disc's index mark
NO_CAUSE, LEANED_ON_BEFORE, DISC_OFF_CENTRE = (
    "none of these",
    "leaned on before the log began",
    "disc off centre by 20 µm",
)
HELD_AT_START = "held by the handle when it begins"
ZEROED_UNDER_LOAD = "zero of the disc taken while held, until its mark comes by"
START_CAUSES: dict[
    str, tuple[dict[str, float], str]
] = {  # changes of the arm, and the state before the log: `push_handle`
    NO_CAUSE: ({}, ""),
    LEANED_ON_BEFORE: ({}, "leaned"),
    DISC_OFF_CENTRE: ({"eccentricity_cosine_1": 5e-4, "eccentricity_cosine_2": 5e-4}, ""),
    **{name: (changes, "") for name, changes in STRUCTURE_FAULTS.items()},
    HELD_AT_START: ({}, "held"),
    ZEROED_UNDER_LOAD: ({}, "held"),
}


def published_torsion() -> dict[str, float]:
    """Changes that give both joints the published torsion with its zeros, as in Fig. 14."""
    return torsion_changes(1, TORSION_JOINT_1) | torsion_changes(2, TORSION_JOINT_2)


def compensating_model(bench: Bench, fine: bool) -> tuple[Arm, Array]:
    """Make the model that knows the torsion as Fig. 14 found it.

    Args:
        bench: arms and shared runs.
        fine: from the logs of encoders of 4096 counts in place of Hall sensors.

    Returns:
        The model, and the zeros to add to the discs' angles (2,), rad.

    """
    first, second = (measure_torsion(bench, j, fine).fit.coefficients for j in (1, 2))
    changes = torsion_changes(1, first.tolist()) | torsion_changes(2, second.tolist())
    return bench.arm(changes=changes), np.array([first[0], second[0]])


def push_handle(
    bench: Bench,
    powered: bool,
    sensors: Sensors | None,
    changes: Mapping[str, float] | None = None,
    before: str = "",
    torque: float = JOINT_TORQUE,
) -> DrivenRun:
    """Push the handle to and fro for 10 s.

    Args:
        bench: arms and shared runs.
        powered: both motors give ``torque``, slowly to and fro; else no current.
        sensors: encoders; None for Hall sensors.
        changes: parameters of the arm that differ from the prototype with the published torsion, SI.
        before: "leaned": a hand leaned on the arm before the log; "held": a hand holds the arm when the log begins.
        torque: at each joint, N m.

    Returns:
        The run.

    """
    early = 0  # rows before the log
    if before:
        early = round(2.0 / PERIOD)
    time = np.asarray((np.arange(round(10.0 / PERIOD) + early) - early) * PERIOD, float)
    push = np.zeros((len(time), 2))
    push[:, 1] = 20.0 * np.sin(2 * np.pi * 0.4 * (time - 1)) * (time > 1)
    push[:, 0] = 10.0 * np.sin(2 * np.pi * 0.23 * (time - 1)) * (time > 1)
    let_go = -0.5
    if before == "held":
        let_go = 0.3
    push[:, 1] += HOLDING_FORCE * (_ease_in(time, -1.5) - _ease_in(time, let_go))
    current = np.zeros((len(time), 2))
    if powered:
        level = torque / 100.0 / MOTOR_TORQUE_CONSTANT
        current[:] = (level * np.sign(np.cos(2 * np.pi * time / 5.0)) * (time >= 0))[:, None]
    arm = bench.arm(changes={**published_torsion(), **(changes or {})})
    found = drive_arm(arm, current, push, HANDLE_POSTURE, sensors, 1)
    log = Log(
        time[early:], {name: column[early:].copy() for name, column in found.log.columns.items()}, 2, found.log.source
    )
    return DrivenRun(log, found.state[early:], found.joint_torque[early:], found.tip[early:])


def _ease_in(time: Array, begin: float) -> Array:
    """A rise from 0 to 1 after ``begin``, as slow as HAND: a hand takes hold."""
    found: Array = 0.5 - 0.5 * np.cos(np.pi * np.clip((time - begin) * HAND_FREQUENCY, 0, 1))
    return found


def compare_compensation(bench: Bench, run: DrivenRun, fine: bool) -> dict[str, Estimates]:
    """Estimate the torques with and without compensation of the kinematic torsion.

    Args:
        bench: arms and shared runs.
        run: a run of the handle.
        fine: the run has encoders of 4096 counts in place of Hall sensors.

    Returns:
        Estimates: "compensated" and "uncompensated".

    """
    smoothing = HALL_SMOOTHING
    if fine:
        smoothing = PASSED_PERIODS / HAND_FREQUENCY
    known, zero = compensating_model(bench, fine)
    plain = bench.arm(changes=without_kinematic_torsion(bench.arm()))
    return {
        "compensated": estimate_torques(known, run.log, zero, smoothing),
        "uncompensated": estimate_torques(plain, run.log, 0.0, smoothing),
    }


def find_invertible_rows(run: DrivenRun) -> Rows:
    """Find the rows at which the angles' difference is small enough for the laws' inverse.

    Args:
        run: a run of the handle.

    Returns:
        True where it is (T, n).

    """
    twist = np.stack([run.log[f"motor_position_{j}"] / 100.0 - run.log[f"joint_position_{j}"] for j in (1, 2)], axis=1)
    return np.abs(twist) < INVERTIBLE_TORSION


def errors_by_axis(run: DrivenRun, found: Mapping[str, Estimates]) -> dict[str, list[float]]:
    """Compute the rms errors of estimates after the start, where all of them are defined.

    Args:
        run: a run of the handle.
        found: its estimates, as `compare_compensation` makes them.

    Returns:
        Errors of both joints, N m, by estimate.

    """
    rows = find_invertible_rows(run) & (run.log.time >= START_SECONDS)[:, None]

    def over(values: Array) -> list[float]:
        return [float(np.sqrt(np.nanmean((values - run.joint_torque)[rows[:, j], j] ** 2))) for j in range(2)]

    table = {}
    for name, one in found.items():
        table[f"{name}, torsion"] = over(one.torsion)
        table[f"{name}, whole"] = over(one.whole)
    from_current = found["compensated"].current
    if np.isfinite(from_current).any(axis=0).all():
        table["from current"] = over(from_current)
    return table


def run_with_cause(bench: Bench, name: str) -> tuple[DrivenRun, Array]:
    """Run the powered arm with one of CAUSES.

    Args:
        bench: arms and shared runs.
        name: key of CAUSES.

    Returns:
        The run, and the error of its estimate (T, n), N m.

    """
    changes, before = START_CAUSES[name]

    def make() -> tuple[DrivenRun, Array]:
        run = push_handle(bench, True, fine_sensors(), changes, before)
        known, zero = compensating_model(bench, True)
        if name == ZEROED_UNDER_LOAD:
            zero = _zeros_taken_under_load(known, run.log, zero)
        return run, estimate_torques(known, run.log, zero).whole - run.joint_torque

    return bench.compute_once(("caused", name), make)


def compare_causes(bench: Bench) -> dict[str, tuple[float, float]]:
    """Compare the causes that may disturb the start, each alone.

    Args:
        bench: arms and shared runs.

    Returns:
        rms errors of joint 1, N m, in the first second and after it, by cause.

    """
    found = {}
    for name in START_CAUSES:
        run, error = run_with_cause(bench, name)
        start = run.log.time < START_SECONDS
        found[name] = float(column_rms(error, start)[0]), float(column_rms(error, ~start)[0])
    return found


def _zeros_taken_under_load(known: Arm, log: Log, zero: Array) -> Array:
    """Zeros (T, n) of a disc that was zeroed under the torsion at the log's begin, until the joint has turned to the
    disc's index mark."""
    first = slice(0, 50)
    rows = Log(log.time[first], {name: column[first] for name, column in log.columns.items()}, log.n_joints, log.source)
    torque = estimate_torques(known, rows, zero, 0.041).torsion.mean(axis=0)
    wound = known.evaluate("torsion", joint_torque=torque)["torsion"]
    q = np.stack([log[f"joint_position_{j}"] for j in (1, 2)], axis=1)
    passed = np.maximum.accumulate(np.abs(q - q[0]) > INDEX_MARK_ANGLE, axis=0)
    return np.where(passed, zero, zero + wound)


def kalman_filter_errors(bench: Bench, fine: bool) -> tuple[list[float], list[float]]:
    """Run predictive control on the circle under pushes, and compare its Kalman filter with the truth.

    Args:
        bench: arms and shared runs.
        fine: encoders of 4096 counts in place of Hall sensors.

    Returns:
        rms errors of the filter's joint torques, and their true peaks, N m, by joint.

    """
    from hdagen.mpc.closed_loop_trial import run_trial

    path, pushes = paper_circle(10.0), (Push(3.0, 4.0, (20.0, 0.0)), Push(6.0, 7.0, (0.0, 20.0)))
    regulator = make_predictive_controller(bench, (2.0, 60.0, 1000.0))
    done = run_trial(bench.arm(), regulator, path, pushes, encoders_of(fine) or Sensors(), (), 1)
    states = np.array([report.state_estimate for report in done.reports])
    seen = regulator.arm.outputs(states, np.zeros((len(states), regulator.arm.nu)))["joint_torque"]
    truth = done.simulation.joint_torque
    return column_rms((seen - truth)[200:]).tolist(), np.abs(truth).max(axis=0).tolist()
