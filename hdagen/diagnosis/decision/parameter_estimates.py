"""The parameters of a fit as diagnosis.json states them, each with its standard deviation and the file's number."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hdagen.adoption.verdict import MOST_TOLERANCES
from hdagen.arm.arm_parameters import Parameter
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.inference.bounded_least_squares import solve_box_qp
from hdagen.diagnosis.inference.candidate_priors import Column
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.local_fit import Fit


def estimate_parameters(fit: Fit, atom: int) -> dict[str, Any]:
    """Estimate the parameters of one candidate from a fit.

    A log may determine one of several sizes of an effect and leave another one open. The open one stays at its nominal
    value: at the edge of this motion, it may be in the middle of the next.

    Args:
        fit: with the candidate.
        atom: index of the candidate.

    Returns:
        By parameter its value, std, unit and end of range, in SI. The shapes of the candidate have no std.

    """
    words, described = fit.sensitivities.candidates, fit.sensitivities.shooting.arm.parameters.described
    columns, (mean, covariance) = words.columns, fit.posterior
    free, std = words.amplitude_columns((atom,)), np.sqrt(np.diagonal(covariance))
    alone = _compute_conditional_deviations(covariance)[free]
    spread = {columns[k].parameter: float(std[k]) * columns[k].unit for k in free}
    names = (*spread, *words.members[atom].shapes)
    found = {
        name: _describe_estimate(fit, described[name], list(described).index(name), spread.get(name)) for name in names
    }
    for k, own in zip(free, alone, strict=True):
        found[columns[k].parameter]["conditional_std"] = float(own) * columns[k].unit
    silent = [
        columns[k] for k, own in zip(free, alone, strict=True) if abs(mean[k]) < DECISION.present_from_deviations * own
    ]
    if len(silent) < len(free):
        for column in silent:
            found[column.parameter] |= {"value": column.center, "end": None}
    return found


def _compute_conditional_deviations(covariance: Array) -> Array:
    """Standard deviation (P) of each parameter while all others are held, from the covariance (P, P) of all."""
    std = np.sqrt(np.diagonal(covariance))
    inflation = np.diagonal(np.linalg.inv(covariance / std / std[:, None]))  # 1 where no other parameter compensates
    return np.asarray(std / np.sqrt(np.maximum(inflation, 1.0)))


def estimate_base_parameters(best: Fit) -> dict[str, Any]:
    """Estimate the base parameters of a fit, for a model without the nuisance effects.

    A nuisance effect may share with a base parameter what the log shows: a payload within tolerance, and the mass of
    its link. No verdict states it, so the base parameters take its part (`_refit_without_nuisances`). No base is quite
    level: where the fit has no effect for its tilt, the components of gravity have it.

    Args:
        best: the fit of a set of effects, or of none.

    Returns:
        `parameters` of diagnosis.json: value, std, unit and end of range, in SI.

    """
    described, (_, covariance) = best.sensitivities.shooting.arm.parameters.described, best.posterior
    places = {name: k for k, name in enumerate(described)}
    held = _compute_conditional_deviations(covariance)
    shift = _refit_without_nuisances(best, held)
    free = [(k, c) for k, c in enumerate(best.sensitivities.candidates.columns) if c.candidate not in best.effects]
    spread = {
        c.parameter: math.sqrt(covariance[k, k]) * c.unit
        for k, c in free
        if c.spike_width > CANDIDATES.silent_spike_width
    }
    found = {
        c.parameter: _describe_estimate(best, described[c.parameter], c.index, spread[c.parameter], shift[k] * c.unit)
        for k, c in free
        if _is_stated_base(c, described) and c.parameter in spread
    }
    conditional = {c.parameter: float(held[k]) * c.unit for k, c in free}
    for name, one in found.items():
        one["conditional_std"] = conditional[name]
    for k, c in ((k, c) for k, c in free if c.parameter in spread):
        equivalent = described[c.parameter].equivalent
        if equivalent is None:
            continue
        gravity = described[equivalent]
        one = found.get(gravity.name) or _describe_estimate(best, gravity, places[gravity.name], 0.0)
        leaned = float(best.sensitivities.point.p[c.index]) - described[c.parameter].nominal
        leaned += float(shift[k]) * c.unit
        one |= {"value": one["value"] + leaned, "std": math.hypot(one["std"], spread[c.parameter])}
        one["conditional_std"] = min(one.get("conditional_std", math.inf), conditional[c.parameter])
        prior = gravity.deviation
        found[gravity.name] = one | {"prior": math.hypot(prior, c.spike_width * c.unit)}
    return found


def _refit_without_nuisances(fit: Fit, alone: Array) -> Array:
    """The change of each base parameter (P) in θ that takes the part of the nuisance effects.

    With the precision Λ = Σ⁻¹ of the posterior, θ of the fit, base parameters b and the nuisance effects n that the log
    shows, the effects being held, the most probable base parameters without nuisance effects are

        b = θ_b + Λ_bb⁻¹ Λ_bn θ_n,

    within their bounds and as far as a verdict may move them. ``alone`` has the standard deviations (P), all else held.
    """
    candidates, arm, (_, covariance) = fit.sensitivities.candidates, fit.sensitivities.shooting.arm, fit.posterior
    described, columns = arm.parameters.described, candidates.columns
    free = [k for k, c in enumerate(columns) if c.candidate not in fit.effects]
    base = [k for k in free if _is_stated_base(columns[k], described) or described[columns[k].parameter].equivalent]
    nuisances = sorted(set(free) - set(base))
    std: Array = np.sqrt(np.diagonal(covariance))
    precision = np.asarray(np.linalg.inv(covariance / std / std[:, None]))
    theta = candidates.to_theta(fit.sensitivities.point.p)
    reach, (low, high) = MOST_TOLERANCES * candidates.spike_widths, candidates.theta_bounds(arm)
    down, up = np.maximum(low, -reach) - theta, np.minimum(high, reach) - theta
    bounds = np.minimum(down, 0.0)[base] / std[base], np.maximum(up, 0.0)[base] / std[base]
    own = precision[np.ix_(base, base)]
    shown = np.where(np.abs(theta) >= DECISION.present_from_deviations * alone, theta / std, 0.0)
    taken = precision[np.ix_(base, nuisances)] @ shown[nuisances]
    shift = np.zeros(len(columns))
    shift[base] = solve_box_qp(own, taken, np.asarray(np.linalg.solve(own, taken)), bounds) * std[base]
    return shift


def _is_stated_base(column: Column, described: Mapping[str, Parameter]) -> bool:
    """Whether a column is that of a base parameter that diagnosis.json states."""
    return column.in_every_hypothesis and described[column.parameter].tolerance > 0


def _describe_estimate(
    fit: Fit, parameter: Parameter, place: int, std: float | None, shift: float = 0.0
) -> dict[str, Any]:
    """Value, std and unit of a parameter, and the robot file's number; ``end``: of its range, that it stands at. The
    value is the fit's with a ``shift``."""
    value = float(fit.sensitivities.point.p[place]) + float(shift)
    ends = {"low": parameter.low, "high": parameter.high}
    least = {name: DECISION.bound_tolerance * max(abs(end), abs(parameter.nominal)) for name, end in ends.items()}
    end = next((name for name in ends if abs(value - ends[name]) <= least[name]), None)
    if value == parameter.nominal:
        end = None
    file = describe_file_number(fit.sensitivities.shooting.arm, parameter)
    return {"value": value, "std": std, "unit": parameter.unit, "end": end, "file": file}


def describe_file_number(arm: Arm, parameter: Parameter) -> float | None:
    """Describe the robot file's number of a parameter.

    Args:
        arm: of the robot file.
        parameter: the parameter.

    Returns:
        The number, SI; None of an effect that the file does not have.

    """
    stated = {(effect["name"], effect["joint"]) for effect in arm.robot["effects"]}
    if parameter.role == "base" or (parameter.effect, parameter.joint) in stated:
        return parameter.nominal
    return None
