"""Nuisance effects: effects within tolerance that the verdict does not name, and the gap that each would close.

No effect is ever exactly absent. Effects within tolerance may still be most of the gap that a verdict leaves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from hdagen.adoption import verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.decision.parameter_estimates import estimate_parameters
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.prediction.window_replay import Replay
from hdagen.support.parallel import map_in_threads


def rank_nuisance_effects(
    best: Fit, said: verdict.Verdict, before: Replay, after: Replay, held: LogPortion, seen: Callable[[Arm], Replay]
) -> list[dict[str, Any]]:
    """Rank the effects within tolerance by the gap that each leaves beside the verdict.

    Args:
        best: the fit that the verdict stands on.
        said: the verdict.
        before: the replay of the robot file's model.
        after: the replay with the verdict.
        held: the held-out rows (T,) of the log.
        seen: replays the held-out log on a model.

    Returns:
        Entries with ``effect``, ``joint``, ``parameters`` (value, std, unit), ``size`` in usual sizes, and the ``gap``
        with the effect and the verdict in the model, in multiples of the noise; the smallest gap first.

    Raises:
        PlantError: a model cannot be simulated.

    """
    candidates, described = best.sensitivities.candidates, best.sensitivities.shooting.arm.parameters.described
    mean, covariance = best.posterior
    clear: dict[int, float] = {}
    for k, c in enumerate(candidates.columns):
        # base parameters go with the verdict, and so does the base's tilt
        q = described[c.parameter]
        goes_along = c.candidate < 0 or q.equivalent is not None or q.tolerance > 0
        if not goes_along and candidates.members[c.candidate].name not in best.names:
            deviations = abs(float(mean[k])) / math.sqrt(covariance[k, k])
            clear[c.candidate] = max(deviations, clear.get(c.candidate, HOLDOUT_CHECK.clear_deviations))
    left = evaluate_gap(before, after, held)["after"]

    def worth(atom: int) -> dict[str, Any]:
        """The entry of one candidate, replayed as large as the fit has it, beside the verdict."""
        effect, (arm, _) = candidates.members[atom], verdict.apply_verdict(best.sensitivities.shooting.arm, said)
        parameters = estimate_parameters(best, atom)
        sizes = {name: (one["value"], described[name]) for name, one in parameters.items()}
        # the linear model knows no bounds
        arm.parameters.update({name: min(max(value, q.low), q.high) for name, (value, q) in sizes.items()})
        return {
            "effect": effect.effect,
            "joint": effect.joint,
            "parameters": parameters,
            "size": float(np.linalg.norm(mean[candidates.amplitude_columns((atom,))])),
            "gap": evaluate_gap(before, seen(arm), held)["after"],
        }

    clearest = sorted((k for k in clear if clear[k] > HOLDOUT_CHECK.clear_deviations), key=lambda k: -clear[k])[
        : HOLDOUT_CHECK.most_replayed_effects
    ]
    closer = [
        one for one in map_in_threads(worth, clearest) if one["gap"] < (1.0 - HOLDOUT_CHECK.least_listed_gain) * left
    ]
    return sorted(closer, key=lambda one: float(one["gap"]))
