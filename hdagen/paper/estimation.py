"""Torque estimation: Fig. 9 (currents of 2 A peak), Fig. 15 (force on the handle, unpowered and powered), and what
resolution buys what torque."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdagen.log import Log
from hdagen.paper.estimator import HALL_SMOOTHING, SMOOTHING, Estimates, estimated, rms
from hdagen.paper.prototype import (
    DISC, ENCODER, PERIOD, TABLE_1, A, B, Bench, Driven, driven, fine_sensors, torsion_of, turns, uncompensated,
)  # fmt: skip
from hdagen.paper.result import Axes, Choice, Claim, Curve, Grid, Result
from hdagen.paper.torsion import measured
from hdagen.paper.tracking import predictive
from hdagen.plant import Arm, Array
from hdagen.simulate import Push, Sensors

PEAK = 2.0  # A, III.B
CONSTANT = 0.0525  # N m/A
JOINT_TORQUE = 4.0  # N m at the joint, IV.A: 0.04 N m at the motor
POSTURE = (0.3, 0.9)  # rad, assumed: a bent arm
BEGUN = 1.0  # s that count as the start
LIMIT = 1.9e-3  # rad of torsion: nearly as far as the laws have an inverse
COUNTS, BITS = (42, 128, 512, 2048, 4096, 16384), (14, 16, 18, 20)
HELD, MARK = 11.0, 0.02  # N, rad, assumed: a hand on the handle; the way to the disc's index mark
ZEROED = "zero of the disc taken while held, until its mark comes by"
BAR, BETTER = 0.05, 3.0  # of the peak torque; times


# -- Fig. 9 -----------------------------------------------------------------------------------------------------------


def ratio_of(inner: float, outer: float, rotor: float) -> float:
    """Torque of joint 1 by that of joint 2 under equal motor torques, rigid joints: ``inner``, ``outer`` inertia of the
    links about their joints with no mass of their own between them, ``rotor`` N² J_m, kg m²."""
    M = np.array([[inner + outer, outer], [outer, outer]])
    torque = M @ np.linalg.solve(M + rotor * np.eye(2), np.ones(2))
    return float(torque[0] / torque[1])


def fig9(bench: Bench) -> Result:
    """Step and sine currents in both joints, Table I's arm."""
    arm = bench.arm(TABLE_1)
    time = np.arange(8000) * PERIOD
    wave = {"step": PEAK * (time >= 0.1), "sine": PEAK * np.sin(time)}
    sensors = Sensors(motor_resolution=(ENCODER,) * 2, joint_resolution=(DISC,) * 2)
    runs = {
        name: driven(arm, np.stack([i, i], axis=1), np.zeros((len(time), 2)), [0.4, 0.9], sensors)
        for name, i in wave.items()
    }
    found = {name: estimated(arm, run.log) for name, run in runs.items()}
    J, rotor = 0.876, 100.0**2 * arm.parameters["motor_inertia_1"]
    from scipy.optimize import brentq

    inner = float(brentq(lambda x: ratio_of(x, J, rotor) - 2.0, J, 100.0))
    outer = float(brentq(lambda x: ratio_of(J, x, rotor) - 2.0, 1e-3, J))
    other = bench.arm(TABLE_1, {"inertia_2": outer})
    twice = driven(other, np.stack([wave["step"]] * 2, axis=1), np.zeros((len(time), 2)), [0.4, 0.9], sensors)
    steady = (time > 0.5) & (time < 2.0)
    ratio = {
        name: float(np.mean(run.joint_torque[steady, 0]) / np.mean(run.joint_torque[steady, 1]))
        for name, run in (("step", runs["step"]), ("lighter second arm", twice))
    }
    errors = {name: rms(one.whole - runs[name].joint_torque) for name, one in found.items()}
    peak = {name: np.abs(run.joint_torque).max(axis=0) for name, run in runs.items()}
    parts = [
        Axes(f"({'ab'[k]}) {name} input, joint {j + 1}", "time (s)", "joint torque (N m)", [
            Curve("true", time, runs[name].joint_torque[:, j], color="grey", dash="solid", width=2.4),
            Curve("estimated", time, found[name].whole[:, j], color="blue", dash="dashed", width=1.0),
        ]) for k, name in enumerate(wave) for j in range(2)
    ]  # fmt: skip
    claims = [
        Claim("the torque of the first arm is twice that of the second", f"{ratio['step']:.2f} times under equal steps of current",
              abs(ratio["step"] - 2) < 0.1,
              f"with Table I's J_a about each joint; at most 1.5 for equal J_a, however small the load. Twice takes a second arm of {outer:.2f} kg m², {outer / J:.2f} of "
              f"the first (simulated: {ratio['lighter second arm']:.2f}), or a first of {inner:.1f} kg m². The paper omits the masses that would settle it"),
        Claim("estimated and measured torques agree under step and sinusoidal currents of 2 A peak",
              f"rms error {errors['step'][0]:.3f} and {errors['step'][1]:.3f} N m (step), {errors['sine'][0]:.3f} and {errors['sine'][1]:.3f} N m (sine), "
              f"of peaks of {peak['sine'][0]:.2f} and {peak['sine'][1]:.2f} N m", bool((errors["sine"] < BAR * peak["sine"]).all() and (errors["step"] < BAR * peak["step"]).all()),
              "encoders of 4096 counts and 2¹⁸; Table I's arm has neither hysteresis nor kinematic torsion"),
    ]  # fmt: skip
    text = "Table I's arm, as printed, under equal currents in both motors; the true torque and the estimate from motor and joint angles."
    numbers = {
        "ratio": ratio,
        "inner_inertia_for_two": inner,
        "outer_inertia_for_two": outer,
        "rms_error": errors,
        "peak": peak,
    }
    logs = {name: run.log for name, run in runs.items()}
    choices = [
        Choice(
            "masses of the links",
            "none beside J_a, as Table I has it",
            f"a second arm of {outer:.2f} kg m² gives the ratio of two",
        )
    ]
    return Result(
        "fig9",
        "Numerical validation of torque estimation",
        text,
        parts,
        claims,
        numbers,
        2,
        choices,
        logs,
        dict.fromkeys(logs, TABLE_1),
    )


# -- Fig. 15 ----------------------------------------------------------------------------------------------------------


def machine() -> dict[str, float]:
    """The published torsion of both joints with its zeros, as in Fig. 14."""
    return torsion_of(1, A) | torsion_of(2, B)


def compensating(bench: Bench, fine: bool) -> tuple[Arm, Array]:
    """The model that knows the torsion as Fig. 14 found it, and the zeros to add to the disc's angles."""
    fits = {j: measured(bench, j, fine).fit.coefficients for j in (1, 2)}
    changes = {name: value for j, found in fits.items() for name, value in torsion_of(j, found).items()}
    return bench.arm(changes=changes), np.array([found[0] for found in fits.values()])


def handled(
    bench: Bench, powered: bool, sensors: Sensors | None, changes: Mapping[str, float] | None = None, before: str = ""
) -> Driven:
    """The handle pushed to and fro for 10 s; powered: both motors give 4 N m at the joint, slowly to and fro.
    ``before``: "leaned", the arm had been leaned on before the log begins; "held", a hand holds it when it begins."""
    early = round(2.0 / PERIOD) if before else 0
    time = (np.arange(round(10.0 / PERIOD) + early) - early) * PERIOD
    push = np.zeros((len(time), 2))
    push[:, 1] = 20.0 * np.sin(2 * np.pi * 0.4 * (time - 1)) * (time > 1)
    push[:, 0] = 10.0 * np.sin(2 * np.pi * 0.23 * (time - 1)) * (time > 1)
    push[:, 1] += HELD * ((time > -1.5) & (time < (0.3 if before == "held" else -0.5)))
    current = np.zeros((len(time), 2))
    if powered:
        level = JOINT_TORQUE / 100.0 / CONSTANT
        current[:] = (level * np.sign(np.cos(2 * np.pi * time / 5.0)) * (time >= 0))[:, None]
    arm = bench.arm(changes={**machine(), **(changes or {})})
    found = driven(arm, current, push, POSTURE, sensors, 1)
    log = Log(
        time[early:], {name: column[early:].copy() for name, column in found.log.columns.items()}, 2, found.log.source
    )
    return Driven(log, found.state[early:], found.joint_torque[early:], found.tip[early:])


def compared(bench: Bench, run: Driven, fine: bool) -> dict[str, Estimates]:
    """Estimates with and without compensation of the kinematic torsion."""
    smoothing = SMOOTHING if fine else HALL_SMOOTHING
    known, zero = compensating(bench, fine)
    plain = bench.arm(changes=uncompensated(bench.arm()))
    return {
        "compensated": estimated(known, run.log, zero, smoothing),
        "uncompensated": estimated(plain, run.log, 0.0, smoothing),
    }


def defined(run: Driven) -> Array:
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


CAUSES: dict[str, tuple[dict[str, float], str]] = {  # changes of the arm, what went before the log
    "none of these": ({}, ""),
    "leaned on before the log began": ({}, "leaned"),
    "disc off centre by 20 µm": ({"eccentricity_cosine_1": 5e-4, "eccentricity_cosine_2": 5e-4}, ""),
    "play of 1 arcmin in the printed parts": ({"backlash_angle_1": 2.9e-4, "backlash_angle_2": 2.9e-4}, ""),
    "links that bend at 24 Hz": ({"link_share_1": 0.2, "link_share_2": 0.2}, ""),
    "mounting that yields": ({"base_compliance_1": 2e-5}, ""),
    "held by the handle when it begins": ({}, "held"),
    ZEROED: ({}, "held"),
}


def causes(bench: Bench) -> dict[str, tuple[float, float]]:
    """What may disturb the start: rms error of joint 1 in the first second and after it, each cause alone."""
    found = {}
    for name, (changes, before) in CAUSES.items():
        run = handled(bench, True, fine_sensors(), changes, before)
        known, zero = compensating(bench, True)
        zeros = _zeroed(known, run.log, zero) if name == ZEROED else zero
        error = estimated(known, run.log, zeros).whole - run.joint_torque
        start = run.log.time < BEGUN
        found[name] = float(rms(error, start)[0]), float(rms(error, ~start)[0])
    return found


def _zeroed(known: Arm, log: Log, zero: Array) -> Array:
    """Zeros (T, n) to add to a disc that takes the torsion at the log's begin for none, until the joint has turned on to
    the disc's index mark."""
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


def fig15(bench: Bench) -> Result:
    """The handle pushed, unpowered and powered."""
    static, moving = handled(bench, False, fine_sensors()), handled(bench, True, fine_sensors())
    hall = handled(bench, True, None)
    found = {
        "static": compared(bench, static, True),
        "moving": compared(bench, moving, True),
        "hall": compared(bench, hall, False),
    }
    runs = {"static": static, "moving": moving, "hall": hall}
    table = {name: by_axis(runs[name], found[name]) for name in runs}
    peak = {name: np.abs(run.joint_torque).max(axis=0).tolist() for name, run in runs.items()}
    why = causes(bench)
    filters = {name: filtered(bench, fine) for name, fine in (("hall", False), ("4096", True))}
    parts = [*_panels(static, moving, found), *_tables(table, peak, filters, why)]
    numbers = {"rms_error": table, "peak": peak, "start_and_after": why, "kalman": filters}
    text = (
        "(b) joint 2 with no current and powered, the handle pushed to and fro; (c), (d) both joints with motors that give 4 N m at the joint. "
        "Kinematic torsion as published, taken off as Fig. 14 found it. Encoders of 4096 counts and 2¹⁸; Hall sensors in the table."
    )
    logs = {"static": static.log, "moving": moving.log, "moving_hall": hall.log}
    return Result(
        "fig15",
        "Torque estimation of both joints",
        text,
        parts,
        _claims(table, peak, filters, why),
        numbers,
        2,
        _choices(),
        logs,
    )


def _panels(static: Driven, moving: Driven, found: Mapping[str, Mapping[str, Estimates]]) -> list[Axes]:
    time = static.log.time
    panels = []
    for name, run, j, heading in (
        ("static", static, 1, "(b) joint 2, no current"), ("moving", moving, 1, "(b) joint 2, powered"),
        ("moving", moving, 0, "(c) first arm"), ("moving", moving, 1, "(d) second arm"),
    ):  # fmt: skip
        curves = [
            Curve("actual", time, run.joint_torque[:, j], color="grey", dash="solid", width=2.4),
            Curve("estimated", time, found[name]["compensated"].whole[:, j], color="blue", dash="solid", width=0.9),
        ]
        if heading.startswith("(b)"):
            curves.append(
                Curve(
                    "by torsion alone, not smoothed",
                    time,
                    found[name]["compensated"].torsion[:, j],
                    color="orange",
                    dash="solid",
                    width=0.4,
                )
            )
        else:
            curves.append(
                Curve(
                    "uncompensated",
                    time,
                    np.clip(found[name]["uncompensated"].whole[:, j], -12, 12),
                    color="vermilion",
                    dash="dashed",
                    width=0.9,
                )
            )
        panels.append(Axes(heading, "time (s)", "joint torque (N m)", curves))
    return panels


def _tables(
    table: Mapping[str, Mapping[str, list[float]]],
    peak: Mapping[str, list[float]],
    filters: Mapping[str, tuple[list[float], list[float]]],
    why: Mapping[str, tuple[float, float]],
) -> list[Grid]:
    labels = {"static": "static, 4096 counts", "moving": "moving, 4096 counts", "hall": "moving, Hall sensors"}
    rows: list[tuple[str | float, ...]] = [
        (f"{labels[name]}: {kind}", *errors, *(100 * e / p for e, p in zip(errors, peak[name], strict=True)))
        for name, kinds in table.items() for kind, errors in kinds.items()
    ]  # fmt: skip
    for name, (errors, peaks) in filters.items():
        shares = (100 * e / p for e, p in zip(errors, peaks, strict=True))
        rows.append(
            (f"Kalman filter at the tick, {'Hall sensors' if name == 'hall' else '4096 counts'}", *errors, *shares)
        )
    return [
        Grid("rms error of the torque estimate", ("", "joint 1 (N m)", "joint 2 (N m)", "joint 1 (% of peak)", "joint 2 (% of peak)"), rows, 3),
        Grid("start-up error of joint 1, each cause alone", ("cause", "first second (N m rms)", "after it (N m rms)", "ratio"),
             [(name, begin, after, begin / after) for name, (begin, after) in why.items()], 3),
    ]  # fmt: skip


def _claims(
    table: Mapping[str, Mapping[str, list[float]]],
    peak: Mapping[str, list[float]],
    filters: Mapping[str, tuple[list[float], list[float]]],
    why: Mapping[str, tuple[float, float]],
) -> list[Claim]:
    ours, plain, peaks = table["moving"]["compensated, whole"], table["moving"]["uncompensated, whole"], peak["moving"]
    share = [e / p for e, p in zip(ours, peaks, strict=True)]
    times = [b / a for a, b in zip(ours, plain, strict=True)]
    raw, best = table["hall"]["compensated, torsion"], table["hall"]["compensated, whole"]
    motor, (ekf, ekf_peak) = table["hall"]["from current"], filters["hall"]
    base = why["none of these"]
    worst = max(why, key=lambda name: why[name][0] / why[name][1])
    vanishes = why[worst][0] > 2 * why[worst][1] and why[worst][1] < 1.5 * base[1]
    return [
        Claim("after the system is stable the estimates closely match the actual values",
              f"rms error {ours[0]:.2f} and {ours[1]:.2f} N m in motion, {100 * share[0]:.1f} and {100 * share[1]:.1f} % of the peak torques", max(share) < BAR,
              "4096 counts and 2¹⁸; smoothed over 61 ms, with the hysteresis that the torsion has wound up"),
        Claim("compensating the kinematic torsion is needed", f"{times[0]:.1f} and {times[1]:.1f} times the error without, where both are defined", min(times) >= BETTER,
              "joint 2's torsion, 0.32 mrad at most, is a tenth of joint 1's"),
        Claim("the paper's sensors: Hall, 42 counts a turn",
              f"raw {raw[0]:.1f} and {raw[1]:.1f} N m rms; smoothed {best[0]:.2f} and {best[1]:.2f}; from current and disc {motor[0]:.2f} and {motor[1]:.2f}; "
              f"Kalman filter at the tick {ekf[0]:.2f} and {ekf[1]:.2f} N m ({100 * ekf[0] / ekf_peak[0]:.0f} and {100 * ekf[1] / ekf_peak[1]:.0f} % of peak)", None,
              "a count is 1.5 mrad at the joint, and the whole drive twists 1 mrad under 10 N m: torsion alone cannot tell the torque"),
        Claim("at the start there are significant errors, later they vanish",
              f"{worst}: {why[worst][0]:.2f} N m rms in the first second, {why[worst][1]:.2f} after it; held, with a zero known before: "
              f"{why['held by the handle when it begins'][0]:.2f} and {why['held by the handle when it begins'][1]:.2f}",
              vanishes,
              "what the paper supposes, the disc's tolerance, " + (f"raises the error from beginning to end ({why['disc off centre by 20 µm'][0]:.2f} and {why['disc off centre by 20 µm'][1]:.2f} N m)")),
        Claim("peak noise at flat portions of the curve, from the disc's resolution", f"by torsion alone, not smoothed, {table['static']['compensated, torsion'][1]:.2f} N m rms when static, smoothed {table['static']['compensated, whole'][1]:.2f}", None,
              f"a count of the disc is {1e3 * DISC * 7051:.0f} mN m, one of the motor {1e3 * ENCODER / 100 * 7051:.0f} mN m at no torque"),
    ]  # fmt: skip


def _choices() -> list[Choice]:
    return [
        Choice(
            "0.4 N m at the motor and 4 N m",
            "4 N m at the joint, 0.04 N m at the motor",
            "0.4 N m at the motor is 7.6 A and 40 N m at the joint: beyond its limit",
        )
    ]


# -- what resolution buys ---------------------------------------------------------------------------------------------


def resolution(bench: Bench) -> Result:
    """Torque error against the resolution of both encoders."""
    table = np.empty((len(COUNTS), len(BITS), 2))
    for row, counts in enumerate(COUNTS):
        for column, bits in enumerate(BITS):
            sensors = Sensors((2 * np.pi / counts,) * 2, (2 * np.pi / 2**bits,) * 2)
            run = handled(bench, True, sensors)
            known, zero = compensating(bench, True)
            smoothing = SMOOTHING if counts >= 512 else HALL_SMOOTHING
            error = estimated(known, run.log, zero, smoothing).whole - run.joint_torque
            table[row, column] = rms(error, run.log.time >= BEGUN)
    peak = np.abs(run.joint_torque).max(axis=0)
    parts = [
        Axes(f"joint {j + 1}", "counts of the motor encoder (1)", "rms error of the torque (N m)", [
            Curve(f"disc of 2^{bits}", COUNTS, table[:, column, j]) for column, bits in enumerate(BITS)
        ] + [Curve("5 % of peak", COUNTS, np.full(len(COUNTS), BAR * peak[j]), color="grey", dash="dotted", width=1.0)], log_x=True, log_y=True)
        for j in range(2)
    ]  # fmt: skip
    enough = [
        [counts for counts, row in zip(COUNTS, table[:, :, j], strict=True) if row[BITS.index(18)] < BAR * peak[j]]
        for j in range(2)
    ]
    least = [min(found, default=None) for found in enough]
    claims = [Claim("(the paper does not say what its encoders suffice for)", f"with a disc of 2¹⁸, from {least[0]} and {least[1]} counts at the motor on the error is below 5 % of the peak", None,
                    "above some 2000 counts the error is that of disc, smoothing and hysteresis")]  # fmt: skip
    numbers = {"counts": COUNTS, "bits": BITS, "rms_error": table, "peak": peak, "least_counts": least}
    text = "The powered run of Fig. 15 with other encoders, compensated, smoothed: what resolution buys what torque."
    return Result("resolution", "Torque error against encoder resolution", text, parts, claims, numbers, 2)
