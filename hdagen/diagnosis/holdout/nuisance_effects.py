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
from hdagen.diagnosis.data.gap import gap
from hdagen.diagnosis.data.split import Portion
from hdagen.diagnosis.decision.verdict_content import LEANS, estimates
from hdagen.diagnosis.inference.local_fit import Fitted
from hdagen.prediction.window_replay import Replay
from hdagen.support.parallel import together

CLEAR = 4.0  # standard deviations from 0, from which the data determine an effect's size
MOST = 2  # effects that are tried: each costs one replay
WORTH = 0.05  # of the gap after the verdict, that an effect must close to be listed


def tolerated(
    best: Fitted, said: verdict.Verdict, before: Replay, after: Replay, held: Portion, seen: Callable[[Arm], Replay]
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
    words, described = best.design.words, best.design.shooting.arm.parameters.described
    mean, covariance = best.posterior
    clear: dict[int, float] = {}
    for k, c in enumerate(words.columns):
        # base parameters go with the verdict, and so does the base's tilt
        goes_along = c.atom < 0 or c.parameter in LEANS or described[c.parameter].tolerance > 0
        if not goes_along and words.atoms[c.atom].name not in best.names:
            told = abs(float(mean[k])) / math.sqrt(covariance[k, k])
            clear[c.atom] = max(told, clear.get(c.atom, CLEAR))
    left = gap(before, after, held)["after"]

    def worth(atom: int) -> dict[str, Any]:
        """The entry of one candidate, replayed as large as the fit has it, beside the verdict."""
        effect, (arm, _) = words.atoms[atom], verdict.applied(best.design.shooting.arm, said)
        parameters = estimates(best, atom)
        arm.parameters.update({name: one["value"] for name, one in parameters.items()})
        return {
            "effect": effect.effect,
            "joint": effect.joint,
            "parameters": parameters,
            "size": float(np.linalg.norm(mean[words.free((atom,))])),
            "gap": gap(before, seen(arm), held)["after"],
        }

    clearest = sorted((k for k in clear if clear[k] > CLEAR), key=lambda k: -clear[k])[:MOST]
    closer = [one for one in together(worth, clearest) if one["gap"] < (1.0 - WORTH) * left]
    return sorted(closer, key=lambda one: float(one["gap"]))
