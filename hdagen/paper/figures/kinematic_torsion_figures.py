"""Kinematic torsion, Fig. 14: measured as in the paper, fitted by (13) and by Fourier series, and compared on turns
that the fit has not seen. Legend: s turns of the output, θ motor angle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.log.measured_log import Log
from hdagen.paper.prototype.figure_result import Axes, Cell, Choice, Claim, Curve, Grid, Part, Result
from hdagen.paper.prototype.kinematic_torsion_fit import (
    POLYNOMIAL_ORDER,
    TorsionFit,
    angle_difference,
    fit_torsion,
    turn_joint,
)
from hdagen.paper.prototype.virtual_prototype import (
    FINE_ENCODER_RESOLUTION,
    PERIOD,
    TORSION_JOINT_1,
    TORSION_JOINT_2,
    Bench,
    drive_arm,
    encoders_of,
    fine_sensors,
    torsion_changes,
)

EXCESS_TORQUES = (0.025, 0.03, 0.035)  # N m at the motor above running friction, IV.A
PUBLISHED_TORSION = {1: TORSION_JOINT_1, 2: TORSION_JOINT_2}
DIRECTION_WORDS = {1: "forward", -1: "back"}  # by direction
SENSOR_KEYS = {True: "4096", False: "hall"}  # by whether the encoders have 4096 counts
WAVE_GENERATOR_ERROR = 1.5e-4  # rad, usual size of the wave generator's error, twice a turn: catalogue
TRAINING_TURNS, ALL_TURNS, LEAD_IN_TURNS = 1.0, 3.0, 0.3  # turns: end of the fit, end of the comparison, lead-in
SLOW_SPEED, KEPT_EVERY = 0.2, 10  # rad/s of the joint; every which row is kept


# -- bases ------------------------------------------------------------------------------------------------------------

Basis = Callable[[Array, Array], Array]  # (turns of the output, motor angle) -> columns


def torsion_bases() -> dict[str, Basis]:
    """Bases that may describe the kinematic torsion, by name."""

    def polynomial(s: Array, theta: Array) -> Array:
        return np.vander(s % 1.0, POLYNOMIAL_ORDER + 1, increasing=True)

    def continued(s: Array, theta: Array) -> Array:
        return np.vander(s, POLYNOMIAL_ORDER + 1, increasing=True)

    def output(s: Array, theta: Array) -> Array:
        return np.hstack([np.ones((len(s), 1)), *(_sine_and_cosine(2 * np.pi * k * s) for k in range(1, 6))])

    def drifting(s: Array, theta: Array) -> Array:
        return np.hstack([output(s, theta), s[:, None]])

    def motor(s: Array, theta: Array) -> Array:
        return np.hstack([np.ones((len(s), 1)), *(_sine_and_cosine(k * theta) for k in (1, 2, 4))])

    return {
        "(13), begun anew every turn": polynomial,
        "(13), continued": continued,
        "Fourier in output": output,
        "Fourier in output, and a ratio": drifting,
        "Fourier in motor angle": motor,
        "both Fourier, and a ratio": lambda s, theta: np.hstack([drifting(s, theta), motor(s, theta)[:, 1:]]),
    }


def _sine_and_cosine(angle: Array) -> Array:
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)


def turn_slowly(bench: Bench, changes: Mapping[str, float]) -> Log:
    """Turn joint 1 three times at 0.2 rad/s after a lead-in, by which the springs' torsion has become constant."""
    arm = bench.arm(changes=changes)
    friction = (
        arm.parameters["coulomb_friction_1"]
        + SLOW_SPEED * arm.parameters["ratio_1"] * arm.parameters["viscous_friction_1"]
    )
    seconds = (ALL_TURNS + 2 * LEAD_IN_TURNS) * 2 * np.pi / SLOW_SPEED
    current = np.zeros((round(seconds / PERIOD), 2))
    current[:, 0] = friction / arm.parameters["torque_constant_1"]
    begin = np.array([-2 * np.pi * LEAD_IN_TURNS, 0.0])
    log = drive_arm(arm, current, np.zeros((len(current), 2)), begin, fine_sensors(), seed=1).log
    return Log(
        log.time[::KEPT_EVERY],
        {name: column[::KEPT_EVERY].copy() for name, column in log.columns.items()},
        2,
        log.source,
    )


def compare_on_held_out_turns(log: Log, j: int, ratio: float) -> dict[str, tuple[float, float]]:
    """The rms residual of each basis on the turn of its fit and on the turns after it, rad."""
    s, y = angle_difference(log, j, ratio)
    theta = log[f"motor_position_{j}"]
    seen, unseen = (s >= 0) & (s < TRAINING_TURNS), (s >= TRAINING_TURNS) & (s < ALL_TURNS)
    found = {}
    for name, basis in torsion_bases().items():
        X = basis(s, theta)
        coefficients = np.linalg.lstsq(X[seen], y[seen], rcond=1e-10)[0]
        left = y - X @ coefficients
        found[name] = float(np.sqrt(np.mean(left[seen] ** 2))), float(np.sqrt(np.mean(left[unseen] ** 2)))
    return found


# -- the figure -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TorsionMeasurement:
    """The measurement of joint ``j`` for Fig. 14: logs by (torque above friction, direction), and the fit."""

    j: int
    logs: dict[tuple[float, int], Log]
    fit: TorsionFit


def measure_torsion(bench: Bench, j: int, fine: bool, repeat: int = 0) -> TorsionMeasurement:
    """Recover the published torsion of a joint from six logs of an arm that has it.

    Args:
        bench: arms and shared runs.
        j: the joint, 1 or 2.
        fine: encoders of 4096 counts in place of Hall sensors.
        repeat: each repeat has noise of its own.

    Returns:
        The logs and the fit.

    """

    def make() -> TorsionMeasurement:
        changes = torsion_changes(j, PUBLISHED_TORSION[j])
        logs = {
            (above, way): turn_joint(bench, j, above, way, changes, fine=fine, repeat=repeat).log
            for above in EXCESS_TORQUES
            for way in (1, -1)
        }
        found = fit_torsion([(log, way, above) for (above, way), log in logs.items()], j, 100.0)
        return TorsionMeasurement(j, logs, found)

    return bench.compute_once(("fig14", j, fine, repeat), make)


def evaluate_torsion(coefficients: Sequence[float] | Array, s: Array) -> Array:
    """Evaluate (13) at turns s (T,); returns rad (T,)."""
    return np.vander(s, POLYNOMIAL_ORDER + 1, increasing=True) @ np.asarray(coefficients)


def make_fig14(bench: Bench) -> Result:
    """Make Fig. 14: kinematic torsion against the output's turn, both joints."""
    every = {(j, fine): measure_torsion(bench, j, fine) for j in PUBLISHED_TORSION for fine in (True, False)}
    parts: list[Part] = [
        _draw_torsion(every[j, True], every[j, False], f"({'ab'[j - 1]}) joint {j}") for j in PUBLISHED_TORSION
    ]
    parts += [
        _draw_difference(every[j, True], every[j, False], f"joint {j}, less the published torsion")
        for j in PUBLISHED_TORSION
    ]
    truths = {
        "as published": torsion_changes(1, TORSION_JOINT_1),
        "without its ratio error": torsion_changes(
            1, [TORSION_JOINT_1[0], -sum(TORSION_JOINT_1[2:]), *TORSION_JOINT_1[2:]]
        ),
        "and with the wave generator's": torsion_changes(
            1, [TORSION_JOINT_1[0], -sum(TORSION_JOINT_1[2:]), *TORSION_JOINT_1[2:]]
        )
        | {"kinematic_sine_twice_1": WAVE_GENERATOR_ERROR},
    }
    left, slow = {}, {}
    for name, changes in truths.items():
        slow[name] = turn_slowly(bench, changes)
        left[name] = compare_on_held_out_turns(slow[name], 1, 100.0)
    best = {name: min(found, key=lambda basis: found[basis][1]) for name, found in left.items()}
    columns = ("left on turns 2 and 3 (mrad)", *truths)
    rows: list[list[Cell]] = []
    for basis in torsion_bases():
        rows.append([basis, *(1e3 * left[name][basis][1] for name in truths)])
    coefficients = _tabulate_coefficients(every)
    parts += [
        Grid("recovered coefficients (1e-3 rad, s in turns)", *coefficients, digits=3),
        Grid("held-out turns", columns, rows, digits=3),
    ]
    numbers = _collect_numbers(every) | {"held_out": left, "best": best}
    logs, robots = _collect_logs(bench, every)
    for name, end in zip(truths, ("slow", "slow_without_ratio", "slow_with_wave_generator"), strict=True):
        logs[end], robots[end] = slow[name], bench.robot_file(truths[name], sensors=fine_sensors())
    text = (
        "Each joint turned once by a motor torque of 25, 30 and 35 mN m above running friction, both ways, with the "
        "published torsion in the arm; (13) is fitted to all six logs, a torsion by acceleration and one by "
        "direction beside it. Below: which basis predicts the turns after the one it was fitted to."
    )
    title = "Kinematic torsion and the output's angle"
    claims, choices = _make_claims(every, left, best), _make_choices(bench, every)
    return Result("fig14", title, text, parts, claims, numbers, 2, choices, logs, robots)


def _collect_logs(
    bench: Bench, every: Mapping[tuple[int, bool], TorsionMeasurement]
) -> tuple[dict[str, Log], dict[str, str | bytes]]:
    """The fitted logs by the end of their file's name, and their robot files."""
    logs, robots = dict[str, Log](), dict[str, str | bytes]()
    for (j, fine), one in every.items():
        robot = bench.robot_file(torsion_changes(j, PUBLISHED_TORSION[j]), sensors=encoders_of(fine))
        for (above, way), log in one.logs.items():
            end = f"joint{j}_{SENSOR_KEYS[fine]}_{1e3 * above:.0f}mNm_{DIRECTION_WORDS[way]}"
            logs[end], robots[end] = log, robot
    return logs, robots


def _draw_torsion(fine: TorsionMeasurement, hall: TorsionMeasurement, heading: str) -> Axes:
    s = np.linspace(0, 1, 200)
    curves = []
    for (above, way), log in fine.logs.items():
        at, y = angle_difference(log, fine.j, 100.0)
        inside = (at >= 0) & (at <= 1)
        name = f"{1e3 * above:.0f} mN m {DIRECTION_WORDS[way]}"
        curves.append(Curve(name, at[inside][::20], y[inside][::20], "points", width=0.7))
    curves.append(
        Curve("published", s, evaluate_torsion(PUBLISHED_TORSION[fine.j], s), color="ink", dash="solid", width=2.0)
    )
    curves.append(
        Curve(
            "fit, 4096 counts",
            s,
            evaluate_torsion(fine.fit.coefficients, s),
            color="vermilion",
            dash="dashed",
            width=2.0,
        )
    )
    curves.append(
        Curve(
            "fit, Hall sensor", s, evaluate_torsion(hall.fit.coefficients, s), color="green", dash="dotted", width=2.0
        )
    )
    return Axes(heading, "turn of the output (1)", "angles' difference (rad)", curves)


def _draw_difference(fine: TorsionMeasurement, hall: TorsionMeasurement, heading: str) -> Axes:
    """Draw the errors of the fits, and one log with 4096 counts less the published curve, in means of 50 rows."""
    s = np.linspace(0, 1, 200)
    log = fine.logs[EXCESS_TORQUES[0], 1]
    at, y = angle_difference(log, fine.j, 100.0)
    inside = (at >= 0) & (at <= 1)
    whole = np.flatnonzero(inside)[: inside.sum() // 50 * 50].reshape(-1, 50)
    means = at[whole].mean(axis=1), (y - evaluate_torsion(PUBLISHED_TORSION[fine.j], at))[whole].mean(axis=1)
    curves = [Curve(f"log, {1e3 * EXCESS_TORQUES[0]:.0f} mN m forward", *means, "points", color="grey", width=1.2)]
    for one, name, color, dash in (
        (fine, "fit, 4096 counts", "vermilion", "dashed"),
        (hall, "fit, Hall sensor", "green", "dotted"),
    ):
        curves.append(
            Curve(
                name,
                s,
                evaluate_torsion(one.fit.coefficients, s) - evaluate_torsion(PUBLISHED_TORSION[one.j], s),
                color=color,
                dash=dash,
                width=2.0,
            )
        )
    return Axes(heading, "turn of the output (1)", "angles' difference (rad)", curves)


def _tabulate_coefficients(
    every: Mapping[tuple[int, bool], TorsionMeasurement],
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    columns = ("", "a published", "4096 counts", "Hall sensor", "b published", "4096 counts ", "Hall sensor ")
    rows = []
    for k in range(POLYNOMIAL_ORDER + 1):
        row = [f"{k}"]
        for j, published in PUBLISHED_TORSION.items():
            row.append(f"{1e3 * published[k]:.4g}")
            for fine in (True, False):
                found = every[j, fine].fit
                row.append(f"{1e3 * found.coefficients[k]:.3g} ± {1e3 * found.standard_errors[k]:.2g}")
        rows.append(tuple(row))
    return columns, rows


def _collect_numbers(every: Mapping[tuple[int, bool], TorsionMeasurement]) -> dict[str, object]:
    s = np.linspace(0, 1, 201)
    out: dict[str, object] = {}
    for (j, fine), one in every.items():
        off = evaluate_torsion(one.fit.coefficients, s) - evaluate_torsion(PUBLISHED_TORSION[j], s)
        out[f"joint_{j}_{SENSOR_KEYS[fine]}"] = {
            "coefficients": one.fit.coefficients,
            "standard_errors": one.fit.standard_errors,
            "chi_square_6": one.fit.squared_distance_to(PUBLISHED_TORSION[j]),
            "chi_square_as_far_by_chance": _chance_of_distance(one),
            "off_by": one.fit.deviations_from(PUBLISHED_TORSION[j]),
            "within_one_standard_error": _count_within_errors(one),
            "curve_rms_error": float(np.sqrt(np.mean(off**2))),
            "residual_rms": one.fit.residual_rms,
        }
    return out


def _make_claims(
    every: Mapping[tuple[int, bool], TorsionMeasurement],
    left: Mapping[str, Mapping[str, tuple[float, float]]],
    best: Mapping[str, str],
) -> list[Claim]:
    claims = [_coefficients_claim(one, fine) for (_, fine), one in every.items()]
    shift = _spread_between_torques(every[1, True])
    claims.append(
        Claim(
            "torsion over the output's angle remains the same under different input torques",
            f"fits of one torque each differ by {1e6 * shift:.0f} µrad rms of {1e3 * sum(TORSION_JOINT_1):.2f} mrad,"
            " once the hysteresis of each direction is taken off",
            bool(shift < 0.05 * sum(TORSION_JOINT_1)),
        )
    )
    name = "and with the wave generator's"
    claims.append(
        Claim(
            "a fifth-order polynomial of the output's angle, (13)",
            f"on turns it has not seen {best[name]} leaves least, {1e6 * left[name][best[name]][1]:.0f} µrad; (13) "
            f"begun anew {1e6 * left[name]['(13), begun anew every turn'][1]:.0f}, continued "
            f"{1e6 * left[name]['(13), continued'][1]:.3g} µrad",
            best[name].startswith("(13)"),
            "a polynomial neither closes after a turn nor holds what turns with the motor; both published sets end "
            "off where they began, which begun anew is a jump and as a ratio an error that a gear cannot have",
        )
    )
    return claims


def _coefficients_claim(one: TorsionMeasurement, fine: bool) -> Claim:
    """Claim that the published coefficients of a joint are recovered."""
    published, off = PUBLISHED_TORSION[one.j], np.abs(one.fit.deviations_from(PUBLISHED_TORSION[one.j]))
    s = np.linspace(0, 1, 201)
    rms = float(np.sqrt(np.mean((evaluate_torsion(one.fit.coefficients, s) - evaluate_torsion(published, s)) ** 2)))
    sensors = "Hall sensors"
    why = (
        f"42 counts a turn are {1e3 * 2 * np.pi / 4200:.2f} mrad at the joint: the curve is found, single "
        "coefficients hardly"
    )
    if fine:
        sensors = "4096 counts"
        why = "of six, four are to be expected within one standard error"
    return Claim(
        f"coefficients of joint {one.j}, IV.A: {', '.join(f'{v:g}' for v in published)}",
        f"with {sensors} {_count_within_errors(one)} of six within their standard errors, all within {off.max():.1f} of"
        f" them; χ² = {one.fit.squared_distance_to(published):.1f}, which chance passes in"
        f" {100 * _chance_of_distance(one):.0f} of 100 fits; the curve to {1e6 * rms:.1f} µrad rms",
        bool(off.max() < 3.0 and _chance_of_distance(one) > 0.01),
        why,
    )


def _count_within_errors(one: TorsionMeasurement) -> int:
    """Count the coefficients that are nearer to the published ones than their standard errors."""
    return int((np.abs(one.fit.deviations_from(PUBLISHED_TORSION[one.j])) < 1).sum())


def _chance_of_distance(one: TorsionMeasurement) -> float:
    """Share of fits to the same arm, with other noise, that miss all six together by as much or more."""
    from scipy.stats import chi2

    return float(chi2.sf(one.fit.squared_distance_to(PUBLISHED_TORSION[one.j]), POLYNOMIAL_ORDER + 1))


def _spread_between_torques(one: TorsionMeasurement) -> float:
    """The rms difference, rad, of fits to the logs of one torque each."""
    s, curves = np.linspace(0, 1, 201), []
    for above in EXCESS_TORQUES:
        logs = [(one.logs[above, way], way, above) for way in (1, -1)]
        curves.append(evaluate_torsion(fit_torsion(logs, one.j, 100.0).coefficients, s))
    return float(np.sqrt(np.mean(np.var(curves, axis=0))))


def _make_choices(bench: Bench, every: Mapping[tuple[int, bool], TorsionMeasurement]) -> list[Choice]:
    level = bench.arm().parameters["coulomb_friction_1"]
    still = turn_joint(bench, 1, max(EXCESS_TORQUES) - level, 1, {}, fine=True).log["joint_position_1"]
    sure = {fine: 1e3 * every[1, fine].fit.standard_errors[2] for fine in (True, False)}
    turn_a, turn_b = sum(TORSION_JOINT_1), sum(TORSION_JOINT_2)
    radians_a, radians_b = (
        sum(c * (2 * np.pi) ** k for k, c in enumerate(cs)) for cs in (TORSION_JOINT_1, TORSION_JOINT_2)
    )
    return [
        Choice("unit of the angle in (13)", "turns", f"at one turn {turn_a:.2e} and {turn_b:.2e} rad; in radians "
                        f"{radians_a:.1f} and {radians_b:.1f} rad, which no gear has"),
        Choice("0.025 to 0.035 N m at the motor", "above running friction", "as motor torques: below Table I's "
                        f"starting torque, 0.037 N m; 0.035 N m turns joint 1 by {1e3 * np.ptp(still):.2f} mrad in "
                        "4.7 s"),
        Choice("motor encoder", f"the paper's 42 counts, and 4096 ({FINE_ENCODER_RESOLUTION:.1e} rad) beside it: "
               "a_2 to "
                        f"{sure[True]:.2g}e-3", f"Hall sensors alone: a_2 to {sure[False]:.2g}e-3, of 3.2e-3"),
    ]  # fmt: skip
