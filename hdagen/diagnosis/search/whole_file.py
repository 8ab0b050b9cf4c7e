"""The whole robot file: all of its numbers fitted together from the regressed torque, and dropped where they are right.

Several wrong numbers hide each other. A search that adds one after the other takes the first that stands in for all of
them, and the point that it reaches from there is not the best. So all numbers begin free, with the ordinary frictions
and the effects that the regression of the torque finds. The linear model there proposes which of them to keep.
"""

from __future__ import annotations

from collections.abc import Collection

from hdagen.diagnosis.inference.alternative_starts import refit_from_start, refit_swapping
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.local_fit import Fit, restore_columns
from hdagen.diagnosis.inference.sensitivities import Sensitivities
from hdagen.diagnosis.initialization.torque_regression import TorqueRegression
from hdagen.diagnosis.search.fit_ranking import sort_by_evidence
from hdagen.diagnosis.search.hypothesis_race import take_further_steps
from hdagen.diagnosis.search.ordinary_frictions import list_ordinary_frictions
from hdagen.diagnosis.search.regressed_starts import fit_regressed_set
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.support.parallel import map_in_threads


def fit_whole_file(
    regression: TorqueRegression, at: Sensitivities, candidates: CandidateSet, named: Collection[str], near: float
) -> Fit:
    """Fit all numbers of the robot file at once, and keep those that the fit needs.

    Args:
        regression: the regression of the record, with the same candidates.
        at: sensitivities about the robot file's numbers.
        candidates: all candidates; some are numbers of the file.
        named: effects that a search named which took the file as right, name@joint; they are fitted beside.
        near: unexplained torque about which the fit looks for its own, as the null model has it.

    Returns:
        The fit, with its columns.

    """
    members = _list_members(regression, candidates, named)
    return _keep_proposed(fit_regressed_set(regression, at, candidates, members, near), at, candidates)


def _list_members(regression: TorqueRegression, candidates: CandidateSet, named: Collection[str]) -> tuple[int, ...]:
    """List the numbers, the ordinary frictions, the effects of the largest regressed set, and the named ones."""
    members = {k for k, one in enumerate(candidates.members) if one.is_number}
    members.update(list_ordinary_frictions(candidates))
    regressed = [k for found in regression.best_sets[-1:] for k in found.effects]
    others = [k for k, one in enumerate(candidates.members) if one.name in named]
    for k in (*regressed, *others):
        if candidates.members[k].name not in candidates.names_of(tuple(members)):
            members.add(k)
    return tuple(sorted(members))


def _keep_proposed(fit: Fit, at: Sensitivities, candidates: CandidateSet) -> Fit:
    """Keep the members that the linear model of a fit proposes, as long as the fit of these is better."""
    for _ in range(SEARCH.number_rounds):
        kept = _propose_members(fit)
        begun = refit_swapping(fit, candidates, kept), refit_from_start(at.point, fit, candidates, kept)
        best = sort_by_evidence(map_in_threads(lambda one: take_further_steps(one, candidates), begun))[0]
        if _rate_fit(best, fit) <= _rate_fit(fit, fit):
            break
        is_settled = kept == fit.effects
        fit = restore_columns(best, candidates)
        if is_settled:
            break
    return fit


def _propose_members(fit: Fit) -> tuple[int, ...]:
    """Propose the members to keep: those left when the least important go, a few of many at once, where the linear
    model says that the rest is best."""
    kept = best = fit.effects
    highest = fit.predicted_evidence(kept) - _price_members(fit, len(kept))
    while kept:
        rests = [tuple(k for k in kept if k != one) for one in kept]
        predicted = map_in_threads(fit.predicted_evidence, rests)
        ranked = sorted(zip(predicted, kept, strict=True), reverse=True)
        dropped = {one for _, one in ranked[: max(1, int(SEARCH.dropped_share * len(kept)))]}
        kept = tuple(k for k in kept if k not in dropped)
        evidence = fit.predicted_evidence(kept) - _price_members(fit, len(kept))
        if evidence > highest:
            best, highest = kept, evidence
    return best


def _rate_fit(fit: Fit, lead: Fit) -> float:
    """Log evidence of a fit less the price of its members, at the temperature of a leader."""
    return fit.evidence_here - _price_members(lead, len(fit.effects))


def _price_members(fit: Fit, count: int) -> float:
    """Log evidence that as many members cost."""
    return SEARCH.effect_penalty * fit.misfit_temperature * count
