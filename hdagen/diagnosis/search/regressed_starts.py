"""Fits of sets from the regressed torque: everything begins where the regression of the record has it.

From the robot file's numbers a fit may end early: before its effects have grown, the base parameters have moved in
their place, and stay behind a valley.
"""

from __future__ import annotations

import logging

from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.gauss_newton import place_sizes
from hdagen.diagnosis.inference.local_fit import Fit, start_fit
from hdagen.diagnosis.inference.sensitivities import OperatingPoint, Sensitivities
from hdagen.diagnosis.initialization.torque_regression import RegressedSet, TorqueRegression
from hdagen.diagnosis.search.hypothesis_race import take_further_steps
from hdagen.support.parallel import map_in_threads

LOGGER = logging.getLogger(__name__)


def fit_regressed_set(
    regression: TorqueRegression, at: Sensitivities, candidates: CandidateSet, effects: tuple[int, ...], near: float
) -> Fit:
    """Fit a set from where the regression has its effects, the base parameters and the nuisance effects.

    Args:
        regression: the regression of the record, with the same candidates.
        at: sensitivities about the robot file's numbers.
        candidates: all candidates.
        effects: places of the set's candidates.
        near: unexplained torque about which the fit looks for its own.

    Returns:
        The fit, with its columns.

    """
    LOGGER.info("fitting %s, from the regressed torque", " + ".join(candidates.names_of(effects)))
    start = place_regressed_set(at, candidates, regression.fit_set(effects))
    begun = start_fit(at, candidates, effects, near, start)
    return take_further_steps(begun, candidates)


def start_regressed_sets(regression: TorqueRegression, at: Sensitivities, near: float) -> list[Fit]:
    """Start fits at the best sets of several effects, each at its regressed sizes.

    Args:
        regression: the regression of the record, with the candidates of ``at``.
        at: sensitivities about the robot file's numbers.
        near: size of unexplained torque to start from.

    Returns:
        The fits, the smallest set first.

    """

    def begin(one: RegressedSet) -> Fit:
        return start_fit(at, at.candidates, one.effects, near, place_regressed_set(at, at.candidates, one))

    return map_in_threads(begin, regression.best_sets)


def place_regressed_set(at: Sensitivities, candidates: CandidateSet, found: RegressedSet) -> OperatingPoint:
    """Return the point of a regressed set, with everything that is free beside it where the regression has it.

    Args:
        at: sensitivities about the robot file's numbers.
        candidates: all candidates.
        found: the set.

    """
    p = place_sizes(at, candidates, found.effects, found.theta).p.copy()
    for size, c in zip(found.nuisance, candidates.columns, strict=True):
        if size:
            p[c.index] = c.center + float(size) * c.unit
    p = at.shooting.arm.parameters.clip_to_bounds(p)
    return OperatingPoint(p, at.shooting.filtered_initial_states(p))
