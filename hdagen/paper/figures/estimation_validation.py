"""Numerical validation of torque estimation, Fig. 9, and the torque error against the encoders' resolution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.paper.figures.handle_forces import (
    LARGEST_ERROR_SHARE,
    START_SECONDS,
    compensating_model,
    find_invertible_rows,
    published_torsion,
    push_handle,
)
from hdagen.paper.prototype.figure_result import Axes, Choice, Claim, Curve, Result
from hdagen.paper.prototype.torque_estimator import (
    HALL_SMOOTHING,
    HAND_FREQUENCY,
    PASSED_PERIODS,
    column_rms,
    estimate_torques,
)
from hdagen.paper.prototype.virtual_prototype import (
    PERIOD,
    TABLE_1,
    Bench,
    DrivenRun,
    drive_arm,
    make_encoders,
    without_kinematic_torsion,
)

PEAK_CURRENT, LINK_INERTIA = 2.0, 0.876  # A, III.B; kg m², Table I
BENT_POSTURE = (0.4, 0.9)  # rad, assumed: a bent arm
OTHER_WINDOWS = (0.009, 0.017, 0.061, 0.101)  # s, alternative windows of smoothing
SINE_TIME = np.arange(6500) * PERIOD  # the sine's first period
STEP_SECONDS = 1.5  # s of the step, after which the arm is as fast as its motors can be
ENCODER_COUNTS, DISC_BIT_COUNTS = (42, 128, 512, 2048, 4096, 16384), (14, 16, 18, 20)
DISC_BITS = 18


def torque_ratio(inner: float, outer: float, rotor: float) -> float:
    """Ratio of the torques of joints 1 and 2 under equal motor torques, with rigid joints. ``inner``, ``outer``:
    inertia of the links about their joints, without coupling by their masses; ``rotor``: N² J_m; all in kg m²."""
    M = np.array([[inner + outer, outer], [outer, outer]])
    torque = M @ np.linalg.solve(M + rotor * np.eye(2), np.ones(2))
    return float(torque[0] / torque[1])


def make_fig9(bench: Bench) -> Result:
    """Make Fig. 9: step and sine currents in both joints of Table I's arm."""
    arm = bench.arm(TABLE_1)
    wave = {
        "step": PEAK_CURRENT * (SINE_TIME[SINE_TIME < STEP_SECONDS] >= 0.1),
        "sine": PEAK_CURRENT * np.sin(SINE_TIME),
    }
    runs = {name: _drive_both_motors(arm, current) for name, current in wave.items()}
    fastest = natural_frequencies(arm, BENT_POSTURE)[-1]
    window = PASSED_PERIODS / fastest
    found = {name: estimate_torques(arm, run.log, smoothing=window).whole for name, run in runs.items()}
    errors = {name: column_rms(one - runs[name].joint_torque) for name, one in found.items()}
    peak = {name: np.abs(run.joint_torque).max(axis=0) for name, run in runs.items()}
    inner, outer = _solve_for_ratio_two(100.0**2 * arm.parameters["motor_inertia_1"])
    lighter = _drive_both_motors(bench.arm(TABLE_1, {"inertia_2": outer}), wave["step"])
    ratio = {"step": _measured_ratio(runs["step"]), "lighter second arm": _measured_ratio(lighter)}
    parts = _draw_torques(runs, found)
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
            f"second arm of {outer:.2f} kg m², {outer / LINK_INERTIA:.2f} of the first (simulated: "
            f"{ratio['lighter second arm']:.2f}), or a first of {inner:.1f} kg m². The paper omits the masses that "
            "would settle it",
        ),
        Claim(
            "estimated and measured torques agree under step and sinusoidal currents of 2 A peak",
            f"rms error, {'; '.join(words)}",
            all(bool((errors[name] < LARGEST_ERROR_SHARE * peak[name]).all()) for name in wave),
            "encoders of 4096 counts and 2¹⁸; Table I's arm has neither hysteresis nor kinematic torsion",
        ),
    ]
    text = (
        "Table I's arm, as printed, under equal currents in both motors; the true torque and the estimate from both "
        "angles."
    )
    numbers = {"ratio": ratio, "inner_for_two": inner, "outer_for_two": outer, "rms_error": errors, "peak": peak}
    logs = {name: run.log for name, run in runs.items()} | {"lighter_second_arm": lighter.log}
    robots: dict[str, str | bytes] = dict.fromkeys(logs, TABLE_1)
    robots["lighter_second_arm"] = bench.robot_file({"inertia_2": outer}, TABLE_1)
    light = f"a second arm of {outer:.2f} kg m² gives the ratio of two"
    choices = [
        Choice("masses of the links", "none beside J_a, as Table I has it", light),
        _choose_smoothing(arm, runs["step"], window, fastest),
    ]
    title = "Numerical validation of torque estimation"
    return Result("fig9", title, text, parts, claims, numbers, 2, choices, logs, robots)


def _draw_torques(runs: Mapping[str, DrivenRun], found: Mapping[str, Array]) -> list[Axes]:
    """Draw the true and the estimated torque (T, 2) of each run, by joint."""
    parts = []
    for name, letter in zip(runs, "ab", strict=True):
        for j in range(2):
            time, truth = runs[name].log.time, runs[name].joint_torque[:, j]
            curves = [
                Curve("true", time, truth, color="grey", dash="solid", width=2.4),
                Curve("estimated", time, found[name][:, j], color="blue", dash="dashed", width=1.0),
            ]
            parts.append(Axes(f"({letter}) {name} input, joint {j + 1}", "time (s)", "joint torque (N m)", curves))
    return parts


def _choose_smoothing(arm: Arm, step: DrivenRun, window: float, fastest: float) -> Choice:
    """The choice of the window of Fig. 9's smoothing, and the results of other windows."""
    words = []
    for seconds in OTHER_WINDOWS:
        one, two = column_rms(estimate_torques(arm, step.log, smoothing=seconds).whole - step.joint_torque)
        words.append(f"{1e3 * seconds:g} ms {one:.3f} and {two:.3f} N m")
    return Choice(
        "over what the angles are smoothed",
        f"{1e3 * window:.0f} ms, {PASSED_PERIODS:g} periods of the fastest oscillation of the arm with its motors held,"
        f" {fastest:.1f} Hz: cubics pass it to 1 %",
        f"rms errors under the step: {'; '.join(words)}",
    )


def natural_frequencies(arm: Arm, q: Sequence[float]) -> Array:
    """Frequencies (n, Hz, rising) of the arm at rest at ``q``, unloaded, its motors held."""
    small = 1e-3  # N m
    stiffness = small / arm.evaluate("torsion", joint_torque=np.full(arm.n, small))["torsion"]
    M = arm.evaluate("mass_matrix", q=q)["M"].reshape(arm.n, arm.n)
    found: Array = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, np.diag(stiffness))).real)) / (2 * np.pi)
    return found


def _drive_both_motors(arm: Arm, current: Array) -> DrivenRun:
    """Drive both motors by the same current (T,), A."""
    push = np.zeros((len(current), 2))
    return drive_arm(arm, np.stack([current, current], axis=1), push, BENT_POSTURE)


def _measured_ratio(run: DrivenRun) -> float:
    """Ratio of the mean torques of joints 1 and 2 once the step has settled."""
    steady = run.log.time > 0.8
    mean = run.joint_torque[steady].mean(axis=0)
    return float(mean[0] / mean[1])


def _solve_for_ratio_two(rotor: float) -> tuple[float, float]:
    """Inertia of the inner link, or of the outer one, that gives the ratio of two beside J_a, kg m²."""
    from scipy.optimize import brentq

    inner = brentq(lambda x: torque_ratio(x, LINK_INERTIA, rotor) - 2.0, LINK_INERTIA, 100.0)
    return float(inner), float(brentq(lambda x: torque_ratio(LINK_INERTIA, x, rotor) - 2.0, 1e-3, LINK_INERTIA))


def push_handle_with_encoders(bench: Bench, powered: bool, counts: int, bits: int) -> DrivenRun:
    """Run Fig. 15 with ``counts`` a turn at the motors and discs of 2^``bits``."""
    make = partial(push_handle, bench, powered, make_encoders(counts, bits))
    return bench.compute_once(("handled", powered, counts, bits), make)


def estimation_error(bench: Bench, run: DrivenRun, counts: int, blind: bool = False) -> Array:
    """rms error of a run's estimate by joint, N m; ``blind``: uncompensated, where the springs' law has an inverse."""
    smoothing = HALL_SMOOTHING
    if counts >= 512:
        smoothing = PASSED_PERIODS / HAND_FREQUENCY
    rows = run.log.time >= START_SECONDS
    if blind:
        off = estimate_torques(bench.arm(changes=without_kinematic_torsion(bench.arm())), run.log, 0.0, smoothing).whole
        return column_rms(np.where(find_invertible_rows(run), off - run.joint_torque, np.nan), rows)
    known, zero = compensating_model(bench, True)
    return column_rms(estimate_torques(known, run.log, zero, smoothing).whole - run.joint_torque, rows)


def make_resolution(bench: Bench) -> Result:
    """Make the figure of the torque error against the resolution of both encoders."""
    runs = {
        (counts, bits): push_handle_with_encoders(bench, True, counts, bits)
        for counts in ENCODER_COUNTS
        for bits in DISC_BIT_COUNTS
    }
    held = {counts: push_handle_with_encoders(bench, False, counts, DISC_BITS) for counts in ENCODER_COUNTS}
    every_error = np.array([estimation_error(bench, run, counts) for (counts, _), run in runs.items()])
    table = every_error.reshape(len(ENCODER_COUNTS), len(DISC_BIT_COUNTS), 2)
    still = np.array([estimation_error(bench, run, counts) for counts, run in held.items()])
    plain = np.array(
        [estimation_error(bench, runs[counts, DISC_BITS], counts, blind=True) for counts in ENCODER_COUNTS]
    )
    peak = np.abs(runs[ENCODER_COUNTS[0], DISC_BITS].joint_torque).max(axis=0)
    parts, least = [], []
    for j in range(2):
        parts.append(_draw_resolution(j, table, still, plain, peak))
        enough = table[:, DISC_BIT_COUNTS.index(18), j] < LARGEST_ERROR_SHARE * peak[j]
        least.append(next((counts for counts, good in zip(ENCODER_COUNTS, enough, strict=True) if good), None))
    fine = ENCODER_COUNTS.index(4096)
    claims = [
        Claim(
            "(the paper does not say what its encoders suffice for)",
            f"with a disc of 2¹⁸, from {least[0]} and {least[1]} counts at the motor on the error in motion is below 5"
            f" % of the peak; with 4096 counts {table[fine, DISC_BIT_COUNTS.index(18), 0]:.2f} and"
            f" {table[fine, DISC_BIT_COUNTS.index(18), 1]:.2f} N m, held still {still[fine, 0]:.2f} and"
            f" {still[fine, 1]:.2f}, uncompensated {plain[fine, 0]:.1f} and {plain[fine, 1]:.1f}",
            None,
            "above some 2000 counts the error is that of disc, smoothing and hysteresis; uncompensated none helps",
        )
    ]
    numbers = {
        "counts": ENCODER_COUNTS, "bits": DISC_BIT_COUNTS, "rms_error": table, "static": still,
        "uncompensated": plain, "peak": peak,
        "least_counts": least,
    }  # fmt: skip
    text = (
        "The runs of Fig. 15 with other encoders, smoothed: what resolution buys what torque. Powered and compensated, "
        "but where it says otherwise; uncompensated over rows where the springs' law has an inverse."
    )
    every = {f"moving_{counts}_{bits}": (run, counts, bits) for (counts, bits), run in runs.items()}
    every |= {f"static_{counts}_{DISC_BITS}": (run, counts, DISC_BITS) for counts, run in held.items()}
    logs = {end: run.log for end, (run, _, _) in every.items()}
    robots = {
        end: bench.robot_file(published_torsion(), sensors=make_encoders(counts, bits))
        for end, (_, counts, bits) in every.items()
    }
    title = "Torque error against encoder resolution"
    return Result("resolution", title, text, parts, claims, numbers, 2, logs=logs, robots=robots)


def _draw_resolution(j: int, table: Array, still: Array, plain: Array, peak: Array) -> Axes:
    """Draw the errors of one joint, from 0, against the counts: with each disc, held still, and uncompensated."""
    curves = [
        Curve(f"disc of {_power_of_two(bits)}", ENCODER_COUNTS, table[:, column, j])
        for column, bits in enumerate(DISC_BIT_COUNTS)
    ]
    limit = np.full(len(ENCODER_COUNTS), LARGEST_ERROR_SHARE * peak[j])
    curves += [
        Curve(f"{_power_of_two(DISC_BITS)}, static", ENCODER_COUNTS, still[:, j], color="blue", dash="dotted"),
        Curve(f"{_power_of_two(DISC_BITS)}, uncompensated", ENCODER_COUNTS, plain[:, j], color="ink", dash="dashed"),
        Curve("5 % of peak", ENCODER_COUNTS, limit, color="grey", dash="dotted"),
    ]
    labels = "counts of the motor encoder (1)", "rms error of the torque (N m)"
    return Axes(f"joint {j + 1}", *labels, curves, log_x=True, log_y=True)


def _power_of_two(bits: int) -> str:
    """2¹⁸ for 18."""
    return "2" + str(bits).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
