"""Effects of a verdict that close little beside what no effect explains, and are not named for it.

Every machine has a little of everything, and a long log tells it, however little: a base that leans by a degree beside
a friction that makes all of the gap. Who mends the model needs the friction. So an effect without which held-out motion
is told about as well, the others being fitted without it, is listed as small. Down at the noise that is a few percent.
Where many times the noise remains, nobody knows by what: there an effect is small whose own part of the error, in every
channel, is smaller than what remains with it,

    e_without² − e_with² < e_with².

What the log shows by itself, before any model is fitted, is never small.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any

from hdagen.diagnosis.decide import Decision, Hypothesis
from hdagen.diagnosis.fitting import Fitted
from hdagen.diagnosis.gap import ABOVE

LITTLE = 1.05  # times the gap with an effect, that may be left without it
OF_A_CHANNEL = 1.1  # times what any channel errs by: what acts on one of many shows little in their mean
REMAINS = 2.0**0.5  # times either, where that is as many times the noise as counts

Gap = Mapping[str, Any]  # `gap` of diagnosis.json
Fits = Mapping[tuple[str, ...], Fitted]


def drop_small_effects(
    decision: Decision, fitted: Fits, measure: Callable[[Decision], Gap], kept: Collection[str] = ()
) -> tuple[Decision, list[dict[str, Any]]]:
    """A decision without the effects that close little beside the others.

    Args:
        decision: what would be said.
        fitted: the fits of a search, by their sets of effects.
        measure: `gap` of diagnosis.json on held-out motion, of a decision.
        kept: effects, name@joint, that are never small.

    Returns:
        The decision with the others alone, in their own fit and with the probability of both sets; and for each effect
        that was dropped ``effect``, ``joint``, and the gap ``with`` it and ``without``. Of several the one is dropped
        first without which the fit tells the log best.

    """
    small: list[dict[str, Any]] = []
    while len(decision.verdict) > 1 and not decision.unknown and not decision.beside:
        told = measure(decision)
        if told["after"] >= told["before"]:  # nothing of it stands
            break
        tried = [name for name in decision.verdict if name not in kept]
        lesser = {name: one for name in tried if (one := without(decision, fitted, name))}
        left = {name: measure(one) for name, one in lesser.items()}
        little = [name for name, gap in left.items() if _is_little(told, gap)]
        if not little:
            break
        name = max(little, key=lambda one: lesser[one].best.reached)
        effect, _, joint = name.partition("@")
        small.append({"effect": effect, "joint": int(joint), "with": told["after"], "without": left[name]["after"]})
        decision = lesser[name]
    return decision, small


def _is_little(told: Gap, without: Gap) -> bool:
    """Whether a gap ``without`` an effect is about that with it, in all and in every channel."""
    channels = ((told["by_channel"][name]["after"], one["after"]) for name, one in without["by_channel"].items())
    alike = all(_is_alike(before, after, OF_A_CHANNEL) for before, after in channels)
    return alike and _is_alike(told["after"], without["after"], LITTLE)


def _is_alike(with_it: float, without: float, least: float) -> bool:
    """Whether an error is about as large without an effect as with it, in multiples of the noise."""
    return bool(without <= (REMAINS if with_it > ABOVE else least) * max(with_it, 1.0))


def without(decision: Decision, fitted: Fits, *names: str) -> Decision | None:
    """A decision without some of its effects.

    Args:
        decision: what would be said.
        fitted: the fits of a search, by their sets of effects.
        names: of effects, name@joint, that are not to be said.

    Returns:
        The decision with the others alone, in their own fit and with the probability of both sets; None where they were
        not fitted by themselves.

    """
    fewer = tuple(one for one in decision.verdict if one not in names)
    both = {h.names: h for h in decision.hypotheses if h.names in (fewer, decision.verdict)}
    own, whole = both.get(fewer), both.get(decision.verdict)
    fit = fitted.get(fewer)
    if fit is None or own is None or whole is None:
        return None
    probability = own.probability + whole.probability
    rest = [h for h in decision.hypotheses if h not in (own, whole)]
    found = [Hypothesis(fewer, probability, fit), *rest, Hypothesis(whole.names, 0.0, whole.fit)]
    ordered = tuple(sorted(found, key=lambda h: -h.probability))
    return replace(decision, hypotheses=ordered, verdict=fewer, probability=probability, best=fit)
