"""What a verdict leaves within tolerance: the effects that are not named, as large as the fit has them, and what each
would be worth in the gap beside the verdict.

No effect is ever exactly absent, and what is tolerated may still be most of what a verdict leaves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from hdagen import verdict
from hdagen.diagnosis.fitting import Fitted
from hdagen.diagnosis.gap import gap
from hdagen.diagnosis.portion import Portion
from hdagen.plant import Arm
from hdagen.replay import Replay

CLEAR = 4.0  # standard deviations from 0, from which an effect's size was told by the data
MOST = 4  # effects that are replayed
WORTH = 0.05  # of the gap after the verdict, that an effect must close to be listed


def tolerated(
    best: Fitted, said: verdict.Verdict, before: Replay, after: Replay, held: Portion, seen: Callable[[Arm], Replay]
) -> list[dict[str, Any]]:
    """Effect, joint, parameters (value, std, unit), size in usual ones, and the gap with that and the verdict in the
    model, the smallest gap first; ``seen``: the replay of what is ``held`` out on an arm. Raises PlantError."""
    words, p = best.design.words, best.design.point.p
    mean, covariance = best.posterior
    clear: dict[int, float] = {}
    for k, c in enumerate(words.columns):
        if c.atom >= 0 and words.atoms[c.atom].name not in best.names and not _refitted(best, c.parameter):
            told = abs(float(mean[k])) / math.sqrt(covariance[k, k])
            clear[c.atom] = max(told, clear.get(c.atom, CLEAR))
    arm, _ = verdict.applied(best.design.shooting.arm, said)
    names, own = list(arm.parameters.described), dict(arm.parameters)
    left, found = gap(before, after, held)["after"], []
    for atom in sorted((k for k in clear if clear[k] > CLEAR), key=lambda k: -clear[k])[:MOST]:
        effect = words.atoms[atom]
        values = {name: float(p[names.index(name)]) for name in (*effect.amplitudes, *effect.shapes)}
        arm.parameters.update(own | values)
        reached = gap(before, seen(arm), held)["after"]
        if reached < (1.0 - WORTH) * left:
            columns = [k for k, c in enumerate(words.columns) if c.atom == atom]
            std = {words.columns[k].parameter: math.sqrt(covariance[k, k]) * words.columns[k].unit for k in columns}
            units = {name: arm.parameters.described[name].unit for name in values}
            found.append(
                {
                    "effect": effect.effect,
                    "joint": effect.joint,
                    "parameters": {n: {"value": v, "std": std.get(n), "unit": units[n]} for n, v in values.items()},
                    "size": math.hypot(*(float(mean[k]) for k in columns)),
                    "gap": reached,
                }
            )
    return sorted(found, key=lambda one: float(one["gap"]))


def _refitted(best: Fitted, parameter: str) -> bool:
    """Whether a parameter is a base one, which goes with the verdict anyway."""
    described = best.design.shooting.arm.parameters.described
    return any(
        c.parameter == parameter and c.base and described[parameter].tolerance > 0 for c in best.design.words.columns
    )
