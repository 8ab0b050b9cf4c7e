"""Forces on the handle and how well the joint torques are estimated under them: the runs of Fig. 15, and what disturbs
their start."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdagen.log import Log
from hdagen.paper.estimator import HALL_SMOOTHING, HAND, PASSED, Estimates, Rows, estimated, rms
from hdagen.paper.prototype import (
    PERIOD,
    STRUCTURE,
    A,
    B,
    Bench,
    Driven,
    driven,
    fine_sensors,
    torsion_of,
    turns,
    uncompensated,
)
from hdagen.paper.torsion import measured
from hdagen.paper.tracking import predictive
from hdagen.plant import Arm, Array
from hdagen.simulation import Push, Sensors

CONSTANT = 0.0525  # N m/A
JOINT_TORQUE = 4.0  # N m at the joint, IV.A: 0.04 N m at the motor
POSTURE = (0.3, 0.9)  # rad, assumed: a bent arm
BEGUN = 1.0  # s that count as the start
LIMIT = 1.9e-3  # rad of torsion: nearly as far as the laws have an inverse
BAR, BETTER = 0.05, 3.0  # of the peak torque; times
HELD, MARK = 11.0, 0.02  # N, rad, assumed: a hand on the handle; the way to the disc's index mark
NONE, LEANED, OFF_CENTRE = "none of these", "leaned on before the log began", "disc off centre by 20 µm"
HELD_THEN = "held by the handle when it begins"
ZEROED = "zero of the disc taken while held, until its mark comes by"
CAUSES: dict[str, tuple[dict[str, float], str]] = {  # changes of the arm, what went before the log
    NONE: ({}, ""),
    LEANED: ({}, "leaned"),
    OFF_CENTRE: ({"eccentricity_cosine_1": 5e-4, "eccentricity_cosine_2": 5e-4}, ""),
    **{name: (changes, "") for name, changes in STRUCTURE.items()},
    HELD_THEN: ({}, "held"),
    ZEROED: ({}, "held"),
}


def machine() -> dict[str, float]:
    """The published torsion of both joints with its zeros, as in Fig. 14."""
    return torsion_of(1, A) | torsion_of(2, B)


def compensating(bench: Bench, fine: bool) -> tuple[Arm, Array]:
    """The model that knows the torsion as Fig. 14 found it, and the zeros to add to the disc's angles."""
    fits = {j: measured(bench, j, fine).fit.coefficients for j in (1, 2)}
    changes = {name: value for j, found in fits.items() for name, value in torsion_of(j, found.tolist()).items()}
    return bench.arm(changes=changes), np.array([found[0] for found in fits.values()])


def handled(
    bench: Bench,
    powered: bool,
    sensors: Sensors | None,
    changes: Mapping[str, float] | None = None,
    before: str = "",
    torque: float = JOINT_TORQUE,
) -> Driven:
    """The handle pushed to and fro for 10 s; powered: both motors give ``torque`` at the joint, slowly to and fro.
    ``before``: "leaned", the arm had been leaned on before the log begins; "held", a hand holds it when it begins."""
    early = round(2.0 / PERIOD) if before else 0
    time = np.asarray((np.arange(round(10.0 / PERIOD) + early) - early) * PERIOD, float)
    push = np.zeros((len(time), 2))
    push[:, 1] = 20.0 * np.sin(2 * np.pi * 0.4 * (time - 1)) * (time > 1)
    push[:, 0] = 10.0 * np.sin(2 * np.pi * 0.23 * (time - 1)) * (time > 1)
    let_go = 0.3 if before == "held" else -0.5
    push[:, 1] += HELD * (_eased(time, -1.5) - _eased(time, let_go))
    current = np.zeros((len(time), 2))
    if powered:
        level = torque / 100.0 / CONSTANT
        current[:] = (level * np.sign(np.cos(2 * np.pi * time / 5.0)) * (time >= 0))[:, None]
    arm = bench.arm(changes={**machine(), **(changes or {})})
    found = driven(arm, current, push, POSTURE, sensors, 1)
    log = Log(
        time[early:], {name: column[early:].copy() for name, column in found.log.columns.items()}, 2, found.log.source
    )
    return Driven(log, found.state[early:], found.joint_torque[early:], found.tip[early:])


def _eased(time: Array, begin: float) -> Array:
    """From 0 to 1 after ``begin`` as a hand takes hold, without what is faster than HAND."""
    found: Array = 0.5 - 0.5 * np.cos(np.pi * np.clip((time - begin) * HAND, 0, 1))
    return found


def compared(bench: Bench, run: Driven, fine: bool) -> dict[str, Estimates]:
    """Estimates with and without compensation of the kinematic torsion."""
    smoothing = PASSED / HAND if fine else HALL_SMOOTHING
    known, zero = compensating(bench, fine)
    plain = bench.arm(changes=uncompensated(bench.arm()))
    return {
        "compensated": estimated(known, run.log, zero, smoothing),
        "uncompensated": estimated(plain, run.log, 0.0, smoothing),
    }


def defined(run: Driven) -> Rows:
    """Rows (T, n) where the angles' difference itself stays within what the laws have an inverse of."""
    twist = np.stack([run.log[f"motor_position_{j}"] / 100.0 - run.log[f"joint_position_{j}"] for j in (1, 2)], axis=1)
    return np.abs(twist) < LIMIT


def by_axis(run: Driven, found: Mapping[str, Estimates]) -> dict[str, list[float]]:
    """rms errors by axis, N m, over rows where both are defined, after the start."""
    rows = defined(run) & (run.log.time >= BEGUN)[:, None]

    def over(values: Array) -> list[float]:
        return [float(np.sqrt(np.nanmean((values - run.joint_torque)[rows[:, j], j] ** 2))) for j in range(2)]

    table = {
        f"{name}, {kind}": over(getattr(one, kind)) for name, one in found.items() for kind in ("torsion", "whole")
    }
    with_current = np.isfinite(found["compensated"].current).any(axis=0).all()
    return table | ({"from current": over(found["compensated"].current)} if with_current else {})


def caused(bench: Bench, name: str) -> tuple[Driven, Array]:
    """The powered run with one of CAUSES, and the error of its estimate (T, n, N m)."""
    changes, before = CAUSES[name]

    def make() -> tuple[Driven, Array]:
        run = handled(bench, True, fine_sensors(), changes, before)
        known, zero = compensating(bench, True)
        zeros = _zeroed(known, run.log, zero) if name == ZEROED else zero
        return run, estimated(known, run.log, zeros).whole - run.joint_torque

    return bench.once(("caused", name), make)


def causes(bench: Bench) -> dict[str, tuple[float, float]]:
    """What may disturb the start: rms error of joint 1 in the first second and after it, each cause alone."""
    found = {}
    for name in CAUSES:
        run, error = caused(bench, name)
        start = run.log.time < BEGUN
        found[name] = float(rms(error, start)[0]), float(rms(error, ~start)[0])
    return found


def _zeroed(known: Arm, log: Log, zero: Array) -> Array:
    """Zeros (T, n) to add to a disc that takes the torsion at the log's begin for none, until the joint has
    turned on to the disc's index mark."""
    first = slice(0, 50)
    rows = Log(log.time[first], {name: column[first] for name, column in log.columns.items()}, log.n_joints, log.source)
    torque = estimated(known, rows, zero, 0.041).torsion.mean(axis=0)
    wound = known.evaluate("torsion", joint_torque=torque)["torsion"]
    q = np.stack([log[f"joint_position_{j}"] for j in (1, 2)], axis=1)
    passed = np.maximum.accumulate(np.abs(q - q[0]) > MARK, axis=0)
    return np.where(passed, zero, zero + wound)


def filtered(bench: Bench, fine: bool) -> tuple[list[float], list[float]]:
    """rms error of the Kalman filter of predictive control by axis, in closed loop on the circle under pushes, and the
    peak torques, N m."""
    from hdagen.mpc.trials import trial

    path, pushes = turns(10.0), (Push(3.0, 4.0, (20.0, 0.0)), Push(6.0, 7.0, (0.0, 20.0)))
    regulator = predictive(bench, (2.0, 60.0, 1000.0))
    done = trial(bench.arm(), regulator, path, pushes, fine_sensors() if fine else Sensors(), (), 1)
    states = np.array([report.x for report in done.reports])
    seen = regulator.arm.outputs(states, np.zeros((len(states), regulator.arm.nu)))["joint_torque"]
    truth = done.simulation.joint_torque
    return rms((seen - truth)[200:]).tolist(), np.abs(truth).max(axis=0).tolist()
