"""Which set of effects leads, in view of motion that the fit did not see.

A probability says how well a set of effects tells the short windows that it was fitted to. Another set may tell other
motion far better. So the next sets are replayed on motion that no fit saw, and one that leaves several times as much of
it as another cannot lead: the better one takes its place. It is not sure then, as the windows say otherwise. No effect
is such a set, too: effects too small to count as present may make most of a gap. Effects take its place only where
the log determines their sizes.

Where short windows say that something unknown is at work, no effect is no rival of known ones: the motion is not
explained. Of the known sets that close a third of what no effect leaves, the most probable one stands for them that
leaves about as little as any.

Ordinary frictions, those that a robot file states, need less. Every drive has them, so they are expected where a rarer
friction is not. A set whose frictions are all ordinary takes the lead in two cases. Either it leaves less of the unseen
motion, by more than a small effect may. Or the leader has a rarer friction, leaves many times the noise, and tells that
motion about as well only.

Wrong numbers of the robot file need more. They are many, and a few of them together move an arm much as an effect does.
Where effects alone, no more of them, leave no more of the unseen motion than a leader with such numbers, both share the
probability: neither is sure. Where many times the noise remains, they share it if both leave about as much.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.decision.effect_presence import keep_present_effects, measure_deviations
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.small_effects import is_gap_alike
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.search.ordinary_frictions import is_ordinary

Gap = Mapping[str, Any]  # `gap` of diagnosis.json


def lead_on_unseen_motion(decision: Decision, measure: Callable[[Decision], Gap]) -> Decision:
    """Put the set of effects first that tells unseen motion several times better than the leading one does.

    Args:
        decision: what short windows say; of one that something unknown is at work nothing leads.
        measure: `gap` of diagnosis.json on unseen motion, of a decision.

    Returns:
        The decision, or that for the set that leaves least, the most probable of the others that were fitted.

    """
    if decision.is_unknown or decision.direct_evidence:
        return decision
    gaps: dict[tuple[str, ...], Gap] = {}

    def measure_once(one: Decision) -> Gap:
        if one.verdict not in gaps:
            gaps[one.verdict] = measure(one)  # a replay
        return gaps[one.verdict]

    decision = _lead_with_better_set(decision, measure_once)
    if not decision.verdict:
        return decision
    decision = _lead_with_ordinary_frictions(decision, measure_once)
    return _share_with_effects_alone(decision, measure_once)


def lead_with_effects(decision: Decision, measure: Callable[[Decision], Gap]) -> Decision:
    """Put a set of effects in place of no effect, where something is at work.

    Args:
        decision: among known effects, of which none leads.
        measure: `gap` of diagnosis.json on unseen motion, of a decision.

    Returns:
        The decision for the most probable set of those that leave about as little as any, and at most two thirds of
        what no effect leaves; the decision as it is, where there is none.

    """
    tried = _exchange_next_sets(decision)
    if not tried:
        return decision
    most = HOLDOUT_CHECK.most_remaining_share * float(measure(decision)["after"])
    gaps = [(one, gap) for one in tried if (gap := measure(one))["after"] <= most]
    least = min((gap for _, gap in gaps), key=lambda gap: float(gap["after"]), default=None)
    return next((one for one, gap in gaps if least is not None and is_gap_alike(least, gap)), decision)


def _exchange_next_sets(decision: Decision) -> list[Decision]:
    """Put each of the next sets of effects in the place of the leading one, the most probable first."""
    others = [h for h in decision.hypotheses if h.names and h.names != decision.verdict and h.fit and not h.is_unknown]
    return [exchange_leader(decision, one) for one in others[: HOLDOUT_CHECK.most_tried_sets]]


def _lead_with_better_set(decision: Decision, measure: Callable[[Decision], Gap]) -> Decision:
    """Put the set first that leaves several times less than the leader."""
    left = float(measure(decision)["after"])
    if left <= DATA.significant_noise_multiple:
        return decision
    tried = [one for one in _exchange_next_sets(decision) if may_replace(decision, one.best)]
    gaps = {one.verdict: float(measure(one)["after"]) for one in tried}
    best = min(tried, key=lambda one: gaps[one.verdict], default=decision)
    return best if gaps.get(best.verdict, left) * HOLDOUT_CHECK.leading_gap_ratio < left else decision


def may_replace(decision: Decision, fit: Fit) -> bool:
    """Tell whether a set of effects may take the lead because it tells unseen motion better.

    Args:
        decision: what short windows say.
        fit: the fit of the set.

    Returns:
        Whether the decision names an effect, or the log determines the size of each effect of the set. A size that may
        as well be none is no reason to change a model that short windows take as right.

    """
    if decision.verdict:
        return True
    return all(one >= HOLDOUT_CHECK.clear_deviations for one in measure_deviations(fit).values())


def _lead_with_ordinary_frictions(decision: Decision, measure: Callable[[Decision], Gap]) -> Decision:
    """Put the smallest set of ordinary frictions first of those that leave least, where it leaves less than the leader
    or stands for a rarer friction of it. Sets with the leader's own frictions have nothing to say about these."""
    own = _list_frictions(decision.best)
    if not own:
        return decision
    others = {
        h.names: h
        for h in decision.hypotheses
        if h.fit and h.names != decision.verdict and is_ordinary(h.fit) and _list_frictions(h.fit) != own
    }
    large = {keep_present_effects(h.fit) for h in others.values() if h.fit}
    tried = [exchange_leader(decision, others[names]) for names in sorted(large & others.keys())]
    gaps = {one.verdict: measure(one) for one in tried}
    if not tried:
        return decision
    least = min(gaps.values(), key=lambda gap: float(gap["after"]))
    alike = [one for one in tried if gaps[one.verdict] is least or is_gap_alike(least, gaps[one.verdict])]
    best = min(alike, key=lambda one: len(one.verdict))
    told, ordinary = measure(decision), gaps[best.verdict]
    if not is_gap_alike(ordinary, told):
        return best if ordinary["after"] < told["after"] else decision
    is_rare = not is_ordinary(decision.best) and told["after"] > DATA.significant_noise_multiple
    return best if is_rare and is_gap_alike(told, ordinary) else decision


def _share_with_effects_alone(decision: Decision, measure: Callable[[Decision], Gap]) -> Decision:
    """Share the probability of a leader that has numbers of the robot file, other than its frictions, with the best set
    of no more effects and no such number, where that leaves no more, or about as much of many times the noise."""
    members = decision.best.sensitivities.candidates.members
    numbers = decision.numbers - {one.name for one in members if one.traits.is_friction}
    if numbers.isdisjoint(decision.verdict):
        return decision
    others = [
        h
        for h in decision.hypotheses
        if h.fit and 0 < len(h.names) <= len(decision.verdict) and not h.is_unknown and numbers.isdisjoint(h.names)
    ]
    tried = {one.names: one for one in others[: HOLDOUT_CHECK.most_tried_sets]}
    gaps = {names: measure(exchange_leader(decision, one)) for names, one in tried.items()}
    best = min(gaps, key=lambda names: float(gaps[names]["after"]), default=())
    if not best:
        return decision
    told, alone = measure(decision), gaps[best]
    is_far = told["after"] > DATA.significant_noise_multiple
    if alone["after"] > told["after"] and not (is_far and is_gap_alike(told, alone)):
        return decision
    return _state_leader(decision, _find_leader(decision), tried[best], 0.5)


def _list_frictions(fit: Fit) -> frozenset[str]:
    """The frictions of a fit, name@joint."""
    members = fit.sensitivities.candidates.members
    return frozenset(members[k].name for k in fit.effects if members[k].traits.is_friction)


def exchange_leader(decision: Decision, other: Hypothesis) -> Decision:
    """Put another set in the place of the leading one.

    Args:
        decision: what is said.
        other: one of its hypotheses, which was fitted.

    Returns:
        The decision for the other set, which takes the probability of the leading one, but for a share that makes it
        unsure; the leading one keeps that share.

    """
    assert other.fit is not None
    odds = HOLDOUT_CHECK.former_leader_odds
    return _state_leader(decision, other, _find_leader(decision), odds / (1.0 + odds))


def lead_with_long_windows(decision: Decision, lasting: Decision) -> Decision:
    """Put the set that leads over long windows in the place of the leading one.

    Args:
        decision: what is said.
        lasting: the decision of a search over long windows; its first hypothesis was fitted.

    Returns:
        The decision for the set of long windows, not sure, as `exchange_leader` has it.

    """
    other = lasting.hypotheses[0]
    here = sum(h.probability for h in decision.hypotheses if h.names == other.names)
    return replace(exchange_leader(decision, replace(other, probability=here)), undetectable=lasting.undetectable)


def _find_leader(decision: Decision) -> Hypothesis:
    """The hypothesis of the verdict."""
    return next(h for h in decision.hypotheses if h.names == decision.verdict)


def _state_leader(decision: Decision, lead: Hypothesis, second: Hypothesis, share: float) -> Decision:
    """The decision for a set that leads, where a second one has a share of the probability of both."""
    both = lead.probability + second.probability
    first = replace(lead, probability=(1.0 - share) * both)
    rest = [h for h in decision.hypotheses if h.names not in (lead.names, second.names)]
    found = sorted([first, replace(second, probability=share * both), *rest], key=lambda h: -h.probability)
    return replace(
        decision,
        hypotheses=tuple(found),
        verdict=first.names,
        probability=first.probability,
        uncalibrated_probability=first.probability,
        best=first.fit or decision.best,
    )
