"""Effects of a verdict that close next to nothing of the gap, and are not named for it.

Every machine has a little of everything, and a long log tells it, however little: a base that leans by a degree beside
a friction that makes all of the gap. Who mends the model needs the friction. So an effect without which held-out motion
is told about as well, the others being fitted without it, is listed as small.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from hdagen.diagnosis.decide import Decision, Hypothesis

LITTLE = 1.05  # times the gap with an effect, that may be left without it
OF_A_CHANNEL = 1.1  # times what any channel errs by: what acts on one of many shows little in their mean

Gap = Mapping[str, Any]  # `gap` of diagnosis.json


def drop_small_effects(decision: Decision, measure: Callable[[Decision], Gap]) -> tuple[Decision, list[dict[str, Any]]]:
    """A decision without the effects that close next to nothing of the gap beside the others.

    Args:
        decision: what would be said.
        measure: `gap` of diagnosis.json on held-out motion, of a decision.

    Returns:
        The decision with the others alone, in their own fit and with the probability of both sets; and for each effect
        that was dropped ``effect``, ``joint``, and the gap ``with`` it and ``without``.

    """
    small: list[dict[str, Any]] = []
    while len(decision.verdict) > 1 and not decision.unknown and not decision.beside:
        told = measure(decision)
        if told["after"] >= told["before"]:  # nothing of it stands
            break
        lesser = {name: one for name in decision.verdict if (one := without(decision, name))}
        left = {name: measure(one) for name, one in lesser.items()}
        little = [name for name, gap in left.items() if _is_little(told, gap)]
        if not little:
            break
        name = min(little, key=lambda one: float(left[one]["after"]))
        effect, _, joint = name.partition("@")
        small.append({"effect": effect, "joint": int(joint), "with": told["after"], "without": left[name]["after"]})
        decision = lesser[name]
    return decision, small


def _is_little(told: Gap, without: Gap) -> bool:
    """Whether a gap ``without`` an effect is about that with it, in all and in every channel."""
    channels = ((told["by_channel"][name]["after"], one["after"]) for name, one in without["by_channel"].items())
    alike = all(after <= OF_A_CHANNEL * max(before, 1.0) for before, after in channels)
    return bool(alike and without["after"] <= LITTLE * max(told["after"], 1.0))


def without(decision: Decision, *names: str) -> Decision | None:
    """A decision without some of its effects.

    Args:
        decision: what would be said.
        names: of effects, name@joint, that are not to be said.

    Returns:
        The decision with the others alone, in their own fit and with the probability of both sets; None where they were
        not fitted by themselves.

    """
    fewer = tuple(one for one in decision.verdict if one not in names)
    both = {h.names: h for h in decision.hypotheses if h.names in (fewer, decision.verdict)}
    own, whole = both.get(fewer), both.get(decision.verdict)
    if own is None or own.fit is None or whole is None:
        return None
    probability = own.probability + whole.probability
    rest = [h for h in decision.hypotheses if h not in (own, whole)]
    found = [Hypothesis(fewer, probability, own.fit), *rest, Hypothesis(whole.names, 0.0, whole.fit)]
    ordered = tuple(sorted(found, key=lambda h: -h.probability))
    return replace(decision, hypotheses=ordered, verdict=fewer, probability=probability, best=own.fit)
