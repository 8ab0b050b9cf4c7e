"""Numerical validation of torque estimation, Fig. 9, and what resolution buys what torque."""

from __future__ import annotations

import numpy as np

from hdagen.paper.estimator import HALL_SMOOTHING, SMOOTHING, estimated, rms
from hdagen.paper.handle import BAR, BEGUN, compensating, handled
from hdagen.paper.prototype import DISC, ENCODER, PERIOD, TABLE_1, Bench, Driven, driven
from hdagen.paper.result import Axes, Choice, Claim, Curve, Result
from hdagen.plant import Arm, Array
from hdagen.simulate import Sensors

PEAK, J_A = 2.0, 0.876  # A, III.B; kg m², Table I
TIME = np.arange(6500) * PERIOD  # the sine's first period
LAST = 1.5  # s of the step: then the arm is as fast as its motors can be
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
    wave = {"step": PEAK * (TIME[TIME < LAST] >= 0.1), "sine": PEAK * np.sin(TIME)}
    runs = {name: _under(arm, current) for name, current in wave.items()}
    found = {name: estimated(arm, run.log).whole for name, run in runs.items()}
    errors = {name: rms(one - runs[name].joint_torque) for name, one in found.items()}
    peak = {name: np.abs(run.joint_torque).max(axis=0) for name, run in runs.items()}
    inner, outer = _for_twice(100.0**2 * arm.parameters["motor_inertia_1"])
    lighter = _under(bench.arm(TABLE_1, {"inertia_2": outer}), wave["step"])
    ratio = {"step": _ratio(runs["step"]), "lighter second arm": _ratio(lighter)}
    parts = [
        Axes(f"({'ab'[k]}) {name} input, joint {j + 1}", "time (s)", "joint torque (N m)", [
            Curve("true", runs[name].log.time, runs[name].joint_torque[:, j], color="grey", dash="solid", width=2.4),
            Curve("estimated", runs[name].log.time, found[name][:, j], color="blue", dash="dashed", width=1.0),
        ]) for k, name in enumerate(wave) for j in range(2)
    ]  # fmt: skip
    words = [
        f"{name}: {errors[name][0]:.3f} and {errors[name][1]:.3f} N m of peaks of {peak[name][0]:.2f} and "
        f"{peak[name][1]:.2f}"
        for name in wave
    ]
    claims = [
        Claim(
            "the torque of the first arm is twice that of the second",
            f"{ratio['step']:.2f} times under equal steps of current",
            abs(ratio["step"] - 2) < 0.1,
            "with Table I's J_a about each joint; at most 1.5 for equal J_a, however small the load. Twice takes a "
            f"second arm of {outer:.2f} kg m², {outer / J_A:.2f} of the first (simulated: "
            f"{ratio['lighter second arm']:.2f}), or a first of {inner:.1f} kg m². The paper omits the masses that "
            "would settle it",
        ),
        Claim(
            "estimated and measured torques agree under step and sinusoidal currents of 2 A peak",
            f"rms error, {'; '.join(words)}",
            all(bool((errors[name] < BAR * peak[name]).all()) for name in wave),
            "encoders of 4096 counts and 2¹⁸; Table I's arm has neither hysteresis nor kinematic torsion",
        ),
    ]
    text = (
        "Table I's arm, as printed, under equal currents in both motors; the true torque and the estimate from both "
        "angles."
    )
    numbers = {"ratio": ratio, "inner_for_two": inner, "outer_for_two": outer, "rms_error": errors, "peak": peak}
    logs = {name: run.log for name, run in runs.items()}
    light = f"a second arm of {outer:.2f} kg m² gives the ratio of two"
    choices = [Choice("masses of the links", "none beside J_a, as Table I has it", light)]
    title = "Numerical validation of torque estimation"
    return Result("fig9", title, text, parts, claims, numbers, 2, choices, logs, dict.fromkeys(logs, TABLE_1))


def _under(arm: Arm, current: Array) -> Driven:
    """The same current in both motors, with encoders of 4096 counts and 2¹⁸."""
    sensors = Sensors(motor_resolution=(ENCODER,) * 2, joint_resolution=(DISC,) * 2)
    return driven(arm, np.stack([current, current], axis=1), np.zeros((len(current), 2)), [0.4, 0.9], sensors)


def _ratio(run: Driven) -> float:
    """Mean torque of joint 1 by that of joint 2, once the step has settled."""
    steady = run.log.time > 0.8
    mean = run.joint_torque[steady].mean(axis=0)
    return float(mean[0] / mean[1])


def _for_twice(rotor: float) -> tuple[float, float]:
    """What gives the ratio of two beside J_a: the inner link's inertia, or the outer's, kg m²."""
    from scipy.optimize import brentq

    inner = brentq(lambda x: ratio_of(x, J_A, rotor) - 2.0, J_A, 100.0)
    return float(inner), float(brentq(lambda x: ratio_of(J_A, x, rotor) - 2.0, 1e-3, J_A))


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
            f"with a disc of 2¹⁸, from {least[0]} and {least[1]} counts at the motor on the error is below 5 % of the "
            "peak",
            None,
            "above some 2000 counts the error is that of disc, smoothing and hysteresis",
        )
    ]
    numbers = {"counts": COUNTS, "bits": BITS, "rms_error": table, "peak": peak, "least_counts": least}
    text = "The powered run of Fig. 15 with other encoders, compensated, smoothed: what resolution buys what torque."
    return Result("resolution", "Torque error against encoder resolution", text, parts, claims, numbers, 2)
