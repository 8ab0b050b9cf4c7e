"""How far the fitted sets predict long windows, and the log odds that this costs them.

With short windows, each set has its own torques that no effect explains. Where a machine has such torques they grow
until they stand in for a friction that changes as slowly, and then all sets look alike. A simulation over windows of
`hdagen.prediction.window_replay.REPLAY_WINDOW` has no such torque: its error is all that a set does not explain. So a
set with several times the best set's error does not lead, however likely short windows make it.

A block of a second counts as one observation of unknown scale, with the likelihood 1 / e. Of B blocks a set loses, of
its log odds,

    B max(mean_b log(e_b / e*_b) − log MARGIN, 0),

with e_b (at least the noise) its error in block b, and e* that of the set with the least error in all. The margin
spares sets with about the same error: there the short windows decide.

Source: Ljung, System Identification (1999), 16.4 (models compared by what they predict over a horizon); Jeffreys,
Theory of Probability (1961), 3.1 (a scale that is not known).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import measure_block_errors
from hdagen.diagnosis.data.prepared_data import PreparedData
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.search.fit_ranking import charge_effects
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.prediction.window_replay import Replay
from hdagen.support.parallel import map_in_threads


@dataclass(frozen=True, eq=False)
class LongWindowPrediction:
    """The prediction of long windows by the fitted sets.

    Attributes:
        log_odds: by the names of a set, what the prediction costs it, as `weigh_predictions` has it.
        failures: a sentence where the sets could not be compared; then none of them is charged.

    """

    log_odds: Mapping[tuple[str, ...], float]
    failures: tuple[str, ...]


def predict_long_windows(found: SearchResult, data: PreparedData, budget: TimeBudget) -> LongWindowPrediction:
    """Compare the fitted sets by their prediction of long windows, where these can be simulated in time.

    Args:
        found: the search, with each set at its optimum.
        data: of the diagnosis.
        budget: the time of the diagnosis.

    Returns:
        The log odds that the prediction costs each set.

    """
    attempts = Attempts(budget)
    nothing: Mapping[tuple[str, ...], float] = {}
    weigh = partial(weigh_predictions, found, data.fitted, data.replay_fitted)
    log_odds = attempts.attempt_in_time("prediction over long windows", weigh, nothing)
    return LongWindowPrediction(log_odds, tuple(attempts.failures))


def weigh_predictions(
    found: SearchResult, shown: LogPortion, replay: Callable[[Arm], Replay]
) -> Mapping[tuple[str, ...], float]:
    """Compute the log odds that prediction over long windows costs the fitted sets.

    Args:
        found: the search, with each set at its optimum.
        shown: the motion that the fits used.
        replay: replays ``shown`` on an arm.

    Returns:
        For the null model and each of the most promising sets, by their names: 0, or less for a set whose error exceeds
        `HOLDOUT_CHECK.error_margin` times the best one's.

    Raises:
        PlantError: a model cannot be simulated.

    """
    sets: dict[tuple[str, ...], Fit] = {}
    for fit in sorted(found.fits, key=lambda fit: -charge_effects(fit.evidence_here, fit, fit.misfit_temperature)):
        if not fit.effects or len(sets) <= HOLDOUT_CHECK.most_replayed_sets:
            sets.setdefault(fit.names, fit)
    arms = [fit.sensitivities.shooting.arm.with_parameters(fit.sensitivities.point.p) for fit in sets.values()]
    lost = compare_errors(measure_block_errors(map_in_threads(replay, arms), shown))
    return dict(zip(sets, lost.tolist(), strict=True))


def compare_errors(errors: Array) -> Array:
    """Compute the log odds that each model's errors cost it.

    Args:
        errors: errors of each model (L, blocks), in multiples of the noise.

    Returns:
        Log odds (L), at most 0.

    """
    logs = np.log(np.maximum(np.where(np.isfinite(errors), errors, np.finfo(float).max), 1.0))
    behind = logs.mean(1) - logs.mean(1).min()
    return np.asarray(-errors.shape[1] * np.maximum(behind - math.log(HOLDOUT_CHECK.error_margin), 0.0))
