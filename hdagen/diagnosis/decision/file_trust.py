"""How far a robot file can be trusted: the factors by which its numbers are wrong, and numbers that strain against it.

A number that a hypothesis frees is taken as found. Every other one stays within three of its tolerances, and one that
the log presses against that limit says that the file claims to know it better than it does. Effects that are named
beside such a number may stand in for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np

from hdagen.adoption.verdict import FACTOR
from hdagen.arm.arm_parameters import Parameter
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.inference.candidate_priors import Candidate
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.local_fit import Fit


def find_strained_numbers(fit: Fit) -> tuple[str, ...]:
    """Find the numbers of the robot file that the log presses against the limit of what the file claims.

    Args:
        fit: of the verdict.

    Returns:
        Names of the parameters, the farthest first.

    """
    described = fit.sensitivities.shooting.arm.parameters.described
    (mean, covariance), reach = fit.posterior, {}
    for k, c in enumerate(fit.sensitivities.candidates.columns):
        is_held = c.in_every_hypothesis and c.candidate not in fit.effects and described[c.parameter].tolerance > 0
        informative = np.sqrt(covariance[k, k]) < DECISION.informative_std_ratio * c.spike_width
        far = abs(float(mean[k])) / c.spike_width
        if is_held and informative and far >= CANDIDATES.nuisance_limit * (1.0 - DECISION.bound_tolerance):
            reach[c.parameter] = far
    return tuple(sorted(reach, key=lambda name: -reach[name]))


def measure_number_gain(fit: Fit) -> float:
    """Measure how much log evidence wrong numbers of the robot file would gain, in the linear model about a fit.

    A number's prior is then as wide as numbers of its kind are usually wrong.

    Args:
        fit: in which the file is taken as right.

    Returns:
        The gain of the best number alone or of all numbers together, whichever is larger; 0 where the fit has no column
        of a number.

    """
    columns, described = fit.sensitivities.candidates.columns, fit.sensitivities.shooting.arm.parameters.described
    numbers = [own for own in _list_number_columns(fit) if own]

    def measure_gain(own: Sequence[int]) -> float:
        usual = [(described[columns[k].parameter].typical or 0.0) / columns[k].unit for k in own]
        stated = [columns[k].spike_width for k in own]
        return fit.evidence_with_widths(own, np.hypot(stated, usual).tolist()) - fit.evidence_with_widths(own, stated)

    return max(map(measure_gain, (*numbers, sorted(chain(*numbers))))) if numbers else 0.0


def has_exact_number(fit: Fit) -> bool:
    """Tell whether the robot file claims to know a number exactly, so that a fit has no column of it.

    Args:
        fit: in which the file is taken as right.

    Returns:
        Whether there is such a number.

    """
    return not all(_list_number_columns(fit))


def _list_number_columns(fit: Fit) -> list[list[int]]:
    """The places of the columns of each number that may be wrong by a factor, without numbers that the effects free."""
    arm, words = fit.sensitivities.shooting.arm, fit.sensitivities.candidates
    described = arm.parameters.described
    free = {words.columns[k].parameter for k in words.hypothesis_columns(fit.effects)}
    place = {c.parameter: k for k, c in enumerate(words.columns) if c.in_every_hypothesis}
    joints = [(number["amplitudes"], j) for number in arm.manifest["numbers"] for j in number["joints"]]
    every = [[f"{amplitude}_{j}" for amplitude in amplitudes] for amplitudes, j in joints]
    held = [[name for name in names if name in described and described[name].typical] for names in every]
    return [[place[name] for name in names if name in place] for names in held if names and free.isdisjoint(names)]


def describe_factor(
    candidate: Candidate, described: Mapping[str, Parameter], parameters: Mapping[str, Any]
) -> dict[str, Any]:
    """Describe the factor by which a number of the robot file is wrong.

    Args:
        candidate: the number.
        described: all parameters by name.
        parameters: the candidate's estimates by the model's names.

    Returns:
        The factor, truth over file, as an estimate named "factor"; of a centre of mass or an inertia in space, the part
        of the true one along the file's. Empty where the candidate is no number, where the file states 0, and where the
        model does not have it, as one of rigid drives has no spring.

    """
    names = [name for name in candidate.amplitudes if name in parameters and name in described]
    if not candidate.is_number or not names:
        return {}
    own = [described[name] for name in names]
    stated = np.array([q.stated for q in own])
    if not stated.any():
        return {}
    size, share = np.linalg.norm(stated), stated / (stated @ stated)
    found = np.array([parameters[name]["value"] + q.offset for name, q in zip(names, own, strict=True)])
    spread = [parameters[name]["std"] for name in names]
    std = None
    if None not in spread:
        std = float(np.linalg.norm(share * np.array(spread, float)))
    prior = float(np.linalg.norm(share * [q.deviation for q in own]))
    file = own[0].stated if len(own) == 1 else float(size)
    factor = {"value": float(share @ found), "std": std, "unit": "1", "end": None}
    return {FACTOR: factor | {"prior": prior, "file": file}}
