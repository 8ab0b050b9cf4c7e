"""Small effects: effects of a fit that close little of the gap, and that the verdict does not name for it.

Every machine has a little of every effect, and a long log shows it, however small: a base that tilts by a degree beside
a friction that makes all of the gap. An engineer who corrects the model needs the friction. So an effect is listed as
small if the others, fitted without it, predict held-out motion about as well. Down at the noise that is a few percent.
Where many times the noise remains for an unknown reason, an effect is small if its own part of the error is smaller, in
every channel, than the error that remains with it,

    e_without² − e_with² < e_with².

An effect with direct evidence is never small.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.inference.local_fit import Fit

Gap = Mapping[str, Any]  # `gap` of diagnosis.json
Fits = Mapping[tuple[str, ...], Fit]


def drop_small_effects(
    decision: Decision, fitted: Fits, measure: Callable[[Decision], Gap], kept: Collection[str] = ()
) -> tuple[Decision, list[dict[str, Any]]]:
    """Drop the effects of a verdict that close little of the gap beside the others.

    Of several, the effect is dropped first without which the fit explains the log best.

    Args:
        decision: to be checked.
        fitted: the fits of a search, by their sets of effects.
        measure: measures `gap` of diagnosis.json on held-out motion, of a decision.
        kept: effects, name@joint, that are never small.

    Returns:
        The decision with the other effects, in their own fit and with the probability of both sets; and for each effect
        that was dropped ``effect``, ``joint``, and the gap ``with`` it and ``without``, in multiples of the noise.

    """
    small: list[dict[str, Any]] = []
    while len(decision.verdict) > 1 and not decision.is_unknown and not decision.direct_evidence:
        gap_with_all = measure(decision)
        if gap_with_all["after"] >= gap_with_all["before"]:  # nothing of it stands
            break
        tried = [name for name in decision.verdict if name not in kept]
        lesser = {name: one for name in tried if (one := drop_effects(decision, fitted, name))}
        left = {name: measure(one) for name, one in lesser.items()}
        little = [name for name, gap in left.items() if is_gap_alike(gap_with_all, gap)]
        if not little:
            break
        name = max(little, key=lambda one: lesser[one].best.evidence_here)
        effect, _, joint = name.partition("@")
        small.append(
            {"effect": effect, "joint": int(joint), "with": gap_with_all["after"], "without": left[name]["after"]}
        )
        decision = lesser[name]
    return decision, small


def is_gap_alike(told: Gap, without: Gap) -> bool:
    """Tell whether one gap is no larger, or about as large only, as another, in all and in every channel.

    Args:
        told: `gap` of diagnosis.json.
        without: the gap that may be larger, as that without an effect.

    Returns:
        False where it is clearly larger.

    """
    channels = ((told["by_channel"][name]["after"], one["after"]) for name, one in without["by_channel"].items())
    alike = all(_is_alike(before, after, HOLDOUT_CHECK.negligible_channel_ratio) for before, after in channels)
    return alike and _is_alike(told["after"], without["after"], HOLDOUT_CHECK.negligible_gap_ratio)


def _is_alike(with_it: float, without: float, least: float) -> bool:
    """Whether an error is about as large without an effect as with it, in multiples of the noise."""
    return bool(
        without
        <= (HOLDOUT_CHECK.negligible_remainder_ratio if with_it > DATA.significant_noise_multiple else least)
        * max(with_it, 1.0)
    )


def drop_effects(decision: Decision, fitted: Fits, *names: str) -> Decision | None:
    """Drop some effects from a verdict.

    Args:
        decision: with the verdict.
        fitted: the fits of a search, by their sets of effects.
        names: of the effects to drop, name@joint.

    Returns:
        The decision with the other effects, in their own fit and with the probability of both sets; None where they
        were not fitted by themselves.

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
