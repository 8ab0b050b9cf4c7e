"""Numerical validation of torque estimation, Fig. 9, and what resolution buys what torque."""

from __future__ import annotations

import numpy as np

from hdagen.paper.estimator import HALL_SMOOTHING, SMOOTHING, estimated, rms
from hdagen.paper.handle import BAR, BEGUN, compensating, handled
from hdagen.paper.prototype import DISC, ENCODER, PERIOD, TABLE_1, Bench, driven
from hdagen.paper.result import Axes, Choice, Claim, Curve, Result
from hdagen.simulate import Sensors

PEAK = 2.0  # A, III.B
COUNTS, BITS = (42, 128, 512, 2048, 4096, 16384), (14, 16, 18, 20)


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
        Axes(
            f"({'ab'[k]}) {name} input, joint {j + 1}",
            "time (s)",
            "joint torque (N m)",
            [
                Curve("true", time, runs[name].joint_torque[:, j], color="grey", dash="solid", width=2.4),
                Curve("estimated", time, found[name].whole[:, j], color="blue", dash="dashed", width=1.0),
            ],
        )
        for k, name in enumerate(wave)
        for j in range(2)
    ]
    claims = [
        Claim(
            "the torque of the first arm is twice that of the second",
            f"{ratio['step']:.2f} times under equal steps of current",
            abs(ratio["step"] - 2) < 0.1,
            "with Table I's J_a about each joint; at most 1.5 for equal J_a, however small the load. Twice takes "
            f"a second arm of {outer:.2f} kg m², {outer / J:.2f} of "
            f"the first (simulated: {ratio['lighter second arm']:.2f}), or a first of {inner:.1f} kg m². The paper "
            "omits the masses that would settle it",
        ),
        Claim(
            "estimated and measured torques agree under step and sinusoidal currents of 2 A peak",
            f"rms error {errors['step'][0]:.3f} and {errors['step'][1]:.3f} N m (step), {errors['sine'][0]:.3f} "
            f"and {errors['sine'][1]:.3f} N m (sine), "
            f"of peaks of {peak['sine'][0]:.2f} and {peak['sine'][1]:.2f} N m",
            bool((errors["sine"] < BAR * peak["sine"]).all() and (errors["step"] < BAR * peak["step"]).all()),
            "encoders of 4096 counts and 2¹⁸; Table I's arm has neither hysteresis nor kinematic torsion",
        ),
    ]
    text = (
        "Table I's arm, as printed, under equal currents in both motors; the true torque and the estimate from "
        "motor and joint angles."
    )
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
        Axes(
            f"joint {j + 1}",
            "counts of the motor encoder (1)",
            "rms error of the torque (N m)",
            [Curve(f"disc of 2^{bits}", COUNTS, table[:, column, j]) for column, bits in enumerate(BITS)]
            + [
                Curve(
                    "5 % of peak", COUNTS, np.full(len(COUNTS), BAR * peak[j]), color="grey", dash="dotted", width=1.0
                )
            ],
            log_x=True,
            log_y=True,
        )
        for j in range(2)
    ]
    enough = [
        [counts for counts, row in zip(COUNTS, table[:, :, j], strict=True) if row[BITS.index(18)] < BAR * peak[j]]
        for j in range(2)
    ]
    least = [min(found, default=None) for found in enough]
    claims = [
        Claim(
            "(the paper does not say what its encoders suffice for)",
            f"with a disc of 2¹⁸, from {least[0]} "
            f"and {least[1]} counts at the motor on the error is below 5 % of the peak",
            None,
            "above some 2000 counts the error is that of disc, smoothing and hysteresis",
        )
    ]
    numbers = {"counts": COUNTS, "bits": BITS, "rms_error": table, "peak": peak, "least_counts": least}
    text = "The powered run of Fig. 15 with other encoders, compensated, smoothed: what resolution buys what torque."
    return Result("resolution", "Torque error against encoder resolution", text, parts, claims, numbers, 2)
