"""True parameters against found ones: orders, time constants, shapes and sizes of rightly named effects."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.blind.confidence_intervals import Figure, estimate_median, estimate_rate
from hdagen.blind.scores import Row

Values = Mapping[str, float]
_STANDARD_DEVIATIONS = 2.0


@dataclass(frozen=True)
class ParameterComparison:
    """A quantity of an effect: ``true`` from the reality's parameters, ``found`` from those of diagnosis.json, with the
    robot file's number of each as "stated …"."""

    effect: str
    words: str
    unit: str
    true: Callable[[Values], float]
    found: Callable[[Values], float]
    std: str = ""  # name of the parameter that the quantity is, whose standard deviation is known; else empty


@dataclass(frozen=True)
class ComparisonLine:
    """A quantity over all cases that have it. ``error``: median of the absolute relative error; ``within``: share of
    cases whose truth lies within two standard deviations; ``pairs``: (true, found)."""

    compared: ParameterComparison
    error: Figure
    within: Figure
    pairs: tuple[tuple[float, float], ...]


def _compare_value(effect: str, words: str, unit: str, true: str, found: str) -> ParameterComparison:
    return ParameterComparison(effect, words, unit, lambda t: t[true], lambda f: f[found], found)


def _compare_amplitude(effect: str, words: str, unit: str, true: str, *found: str) -> ParameterComparison:
    return ParameterComparison(
        effect, words, unit, lambda t: abs(t[true]), lambda f: math.hypot(*(f[name] for name in found))
    )


def _compare_change(effect: str, unit: str, key: str, true: str) -> ParameterComparison:
    """Compare a base parameter that the effect moves; its scatter is part of the found change."""
    return ParameterComparison(effect, "change", unit, lambda t: t[true], lambda f: f[key] - f[f"stated {key}"])


def _stiffer_wall(found: Values) -> str:
    """Name of the angle of the wall that is found on the stiffer side."""
    if found["contact_stiffness_above"] > found["contact_stiffness_below"]:
        return "contact_above"
    return "contact_below"


PARAMETER_COMPARISONS: tuple[ParameterComparison, ...] = (
    _compare_value("torque_ripple", "order", "a turn", "order", "ripple_order"),
    _compare_amplitude("torque_ripple", "torque", "N m", "torque", "ripple_sine", "ripple_cosine"),
    _compare_amplitude(
        "kinematic_error", "amplitude twice a turn", "rad", "twice", "kinematic_sine_twice", "kinematic_cosine_twice"
    ),
    _compare_amplitude(
        "kinematic_error", "amplitude once a turn", "rad", "once", "kinematic_sine_once", "kinematic_cosine_once"
    ),
    _compare_value("command_delay", "time", "s", "time", "command_delay"),
    _compare_value("current_loop_lag", "time constant", "s", "time", "current_lag"),
    _compare_value("sensor_delay", "time", "s", "time", "sensor_delay"),
    _compare_value("thermal_friction", "time constant", "s", "time", "thermal_time"),
    _compare_value("stribeck_friction", "speed", "rad/s", "speed", "stribeck_speed"),
    _compare_value("stribeck_friction", "torque", "N m", "torque", "stribeck_torque"),
    _compare_value("presliding_friction", "angle", "rad", "angle", "presliding_angle"),
    _compare_value("presliding_friction", "share", "1", "share", "presliding_share"),
    _compare_value("load_dependent_friction", "share", "1", "share", "load_share"),
    _compare_value("transmission_hysteresis", "torque", "N m", "torque", "hysteresis_torque"),
    _compare_value("transmission_hysteresis", "angle", "rad", "angle", "hysteresis_angle"),
    _compare_value("backlash", "width", "rad", "width", "backlash_angle"),
    _compare_value("stiffness", "factor", "1", "factor", "stiffness_level"),
    _compare_value("torque_constant", "factor", "1", "factor", "torque_gain"),
    _compare_change("coulomb_friction", "N m", "coulomb_friction", "torque"),
    _compare_change("viscous_friction", "N m s/rad", "viscous_friction", "coefficient"),
    _compare_value("coulomb_friction", "level", "N m", "size", "coulomb_friction"),
    _compare_value("viscous_friction", "level", "N m s/rad", "size", "viscous_friction"),
    ParameterComparison(
        "joint_damping",
        "factor",
        "1",
        lambda t: t["factor"],
        lambda f: f["torsional_damping"] / f["stated torsional_damping"],
    ),
    ParameterComparison(
        "current_saturation", "limit", "A", lambda t: t["limit"], lambda f: 1.0 / f["saturation_inverse"]
    ),
    _compare_value("payload", "mass", "kg", "mass", "payload_mass"),
    ParameterComparison(
        "gravity_tilt",
        "angle",
        "rad",
        lambda t: abs(t["angle"]),
        lambda f: math.asin(min(math.hypot(f["tilt_x"], f["tilt_y"]) / 9.81, 1.0)),
    ),
    ParameterComparison(
        "gravity_tilt",
        "angle in space",
        "rad",
        lambda t: abs(t["angle"]),
        lambda f: math.hypot(f["tilt_roll"], f["tilt_pitch"]),
    ),
    _compare_value("motor_inertia", "level", "kg m²", "inertia", "motor_inertia"),
    _compare_value("missing_compliance", "compliance", "rad/(N m)", "compliance", "missing_compliance"),
    _compare_value("cable_spring", "stiffness", "N m/rad", "stiffness", "cable_stiffness"),
    ParameterComparison(
        "contact",
        "angle",
        "rad",
        lambda t: t["angle"],
        lambda f: f[_stiffer_wall(f)],
    ),
    _compare_amplitude("encoder_eccentricity", "amplitude", "rad", "share", "eccentricity_sine", "eccentricity_cosine"),
)


def compare_parameters(rows: Sequence[Row]) -> list[ComparisonLine]:
    """Compare true and found parameters.

    Args:
        rows: the scored cases.

    Returns:
        A line for each quantity of `PARAMETER_COMPARISONS` that at least one right verdict states.

    """
    lines = []
    for one in PARAMETER_COMPARISONS:
        pairs, inside = [], []
        for row in rows:
            for key in set(row.truth) & set(row.verdict):
                found = (row.found or {}).get(key, {})
                if key.split("@")[0] != one.effect or not found:
                    continue
                try:
                    pair = (one.true(row.true_parameters(key)), one.found(_read_values(found)))
                except (KeyError, ZeroDivisionError):
                    continue  # the diagnosis lacks one of the parameters
                pairs.append(pair)
                std = found.get(one.std, {}).get("std")
                if std:
                    inside.append(abs(pair[0] - pair[1]) <= _STANDARD_DEVIATIONS * float(std))
        if pairs:
            errors = [abs(found - true) / abs(true) for true, found in pairs if np.isfinite(found)]
            lines.append(ComparisonLine(one, estimate_median(errors), estimate_rate(inside), tuple(pairs)))
    return lines


def _read_values(found: Mapping[str, Mapping[str, float | None]]) -> dict[str, float]:
    """The values of an effect's parameters in diagnosis.json, and the robot file's number of each that it states."""
    values = {name: one["value"] for name, one in found.items()}
    values |= {f"stated {name}": one.get("file") for name, one in found.items()}
    return {name: float(value) for name, value in values.items() if value is not None}
