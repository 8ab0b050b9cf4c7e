"""Whether what is said stands on motion that the fit did not see.

A fit sees short windows that each begin anew. What acts at few places, or works slowly, hardly shows there, and a
little of much that is tolerated stands in for it; elsewhere, and over longer windows, it does not. So the leading model
replays the held-out motion with all that it has, what it names and what it tolerates: where most of a joint's gap
stays, something is at work that no effect explains.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from hdagen.diagnosis.decide import Decision, Hypothesis, decided
from hdagen.diagnosis.gap import gap
from hdagen.diagnosis.portion import Portion
from hdagen.plant import Arm
from hdagen.replay import Replay

MOST = 2 / 3  # of a joint's gap, that a model may leave: one that leaves more explains something else
ABOVE = 10.0  # multiples of the noise, from which on what is left counts
STEEPLY = 4.0  # power of what is left in the odds


def stood(decision: Decision, before: Replay, held: Portion, seen: Callable[[Arm], Replay]) -> Decision:
    """The decision, with something unknown said instead where its best fit leaves most of the gap of the replay
    ``before`` in what is ``held`` out; ``seen``: the replay of that on an arm. Raises PlantError."""
    if decision.unknown:
        return decision
    joint, share = worst(before, seen(_whole(decision)), held)
    if share <= MOST:
        return decision
    odds = (share / MOST) ** STEEPLY
    unknown = odds / (1.0 + odds)
    known = [h for h in decision.hypotheses if not h.unknown]
    total = sum(h.probability for h in known)
    shared = [Hypothesis(h.names, (1.0 - unknown) * h.probability / total, h.fit) for h in known]
    return decided([*shared, Hypothesis((f"unknown@{joint}",), unknown, None)], decision.best)


def _whole(decision: Decision) -> Arm:
    """The model where the best fit stands, with what it tolerates."""
    at = decision.best.design
    arm = Arm(at.shooting.arm.folder)
    arm.parameters.update(dict(zip(arm.parameters, at.point.p.tolist(), strict=True)))
    return arm


def worst(before: Replay, whole: Replay, held: Portion) -> tuple[int, float]:
    """The joint whose encoders ``whole`` leaves the largest share of what ``before`` errs by, and the share: a
    geometric mean over its channels; 0 where nothing is left that counts."""
    by_joint: dict[int, list[dict[str, float]]] = {}
    for name, one in gap(before, whole, held)["by_channel"].items():
        quantity, _, j = name.rpartition("_")
        if quantity.endswith("position"):
            by_joint.setdefault(int(j), []).append(one)
    shares = {0: 0.0}
    for j, channels in by_joint.items():
        left, was = (math.exp(sum(math.log(c[key]) for c in channels) / len(channels)) for key in ("after", "before"))
        shares[j] = left / was if left > ABOVE else 0.0
    return max(shares.items(), key=lambda one: one[1])
