"""How far the sets that were fitted predict long windows, and what that takes from their odds.

A likelihood of short windows lets each set have torques of its own that no effect explains. Where a machine has some of
these, they grow until they stand in for a friction that is as slow, and then all sets are alike. A simulation over
windows of `hdagen.replay.WINDOW` has no such torque: what a set does not explain there, it errs by. So a set of which
the simulation errs several times as much as that of the best does not lead, however likely short windows make it.

A block of a second counts as one observation whose scale is not known, with the likelihood 1 / e. Of B blocks a set
loses, of its log odds,

    B max(mean_b log(e_b / e*_b) − log MARGIN, 0),

e_b (at least the noise) what it errs by in block b, e* that of the set that errs least in all. The margin leaves alone
what errs about alike: there the short windows decide.

Source: Ljung, System Identification (1999), 16.4 (models compared by what they predict over a horizon); Jeffreys,
Theory of Probability (1961), 3.1 (a scale that is not known).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from hdagen.diagnosis.fitting import Fitted
from hdagen.diagnosis.gap import block_errors
from hdagen.diagnosis.portion import Portion
from hdagen.diagnosis.search import DEAR, Search
from hdagen.plant import Arm, Array
from hdagen.replay import Replay
from hdagen.together import together

MARGIN = 1.5  # times what the best errs by, up to which short windows decide: the same as `standing.MOST` grants
MOST = 8  # sets beside none: each costs a replay of the log


def weigh_predictions(
    found: Search, shown: Portion, replay: Callable[[Arm], Replay]
) -> Mapping[tuple[str, ...], float]:
    """What prediction over long windows takes from the log odds of the sets that were fitted.

    Args:
        found: the search, with each set where it stands.
        shown: the motion that the fits saw.
        replay: of ``shown`` on an arm.

    Returns:
        Of each of the sets that promise most, and of none, by their names: 0, or less for a set that errs by more than
        `MARGIN` times what the best does.

    Raises:
        PlantError: a model cannot be simulated.

    """
    sets: dict[tuple[str, ...], Fitted] = {}
    for fit in sorted(found.fitted, key=lambda fit: -_charged(fit)):
        if not fit.atoms or len(sets) <= MOST:
            sets.setdefault(fit.names, fit)
    arms = [fit.design.shooting.arm.at(fit.design.point.p) for fit in sets.values()]
    lost = compare_errors(block_errors(together(replay, arms), shown))
    return dict(zip(sets, lost.tolist(), strict=True))


def _charged(fit: Fitted) -> float:
    """Log evidence of a set where it stands less what the prior takes for its effects."""
    return fit.reached - DEAR * fit.excess * len(fit.atoms)


def compare_errors(errors: Array) -> Array:
    """What each model (L) loses of its log odds by its ``errors`` (L, blocks), in multiples of the noise."""
    logs = np.log(np.maximum(np.where(np.isfinite(errors), errors, np.finfo(float).max), 1.0))
    behind = logs.mean(1) - logs.mean(1).min()
    return np.asarray(-errors.shape[1] * np.maximum(behind - math.log(MARGIN), 0.0))
