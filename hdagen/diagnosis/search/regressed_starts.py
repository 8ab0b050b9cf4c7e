"""Fits of sets from the regressed torque: everything begins where the regression of the record has it.

From the robot file's numbers a fit may end early: before its effects have grown, the base parameters have moved in
their place, and stay behind a valley.
"""

from __future__ import annotations

import logging

from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.local_fit import Fit, start_fit
from hdagen.diagnosis.inference.sensitivities import Sensitivities
from hdagen.diagnosis.initialization.torque_regression import TorqueRegression, place_regressed_set
from hdagen.diagnosis.search.hypothesis_race import take_further_steps

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
