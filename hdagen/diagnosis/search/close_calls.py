"""Close calls: hypotheses that start at the leader's point, such as its look-alikes, and all that come close to the
best, each fitted to its end.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

import numpy as np

from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.fit_settings import FIT
from hdagen.diagnosis.inference.local_fit import Fit, restore_columns
from hdagen.diagnosis.search.fit_ranking import charge_effects, drop_columns, sort_by_evidence
from hdagen.diagnosis.search.hypothesis_race import advance_with_note, continue_fit, join_effect_names
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.diagnosis.stages.stage import Stage, StageListener
from hdagen.support.parallel import map_in_threads

LOGGER = logging.getLogger(__name__)

RefitCall = tuple[Callable[[Fit, CandidateSet, tuple[int, ...]], Fit], tuple[int, ...]]


def find_look_alikes(lead: Fit, fitted: Sequence[Fit], words: CandidateSet) -> list[tuple[int, ...]]:
    """List sets with another effect in place of one of the leader's. Each must predict nearly as much at the leader's
    point, and more than it reached in its own fit.

    Args:
        lead: the leader, with its columns.
        fitted: all fits.
        words: all candidates.

    Returns:
        Places of the candidates of each set. Sets with a twin come first, then the most promising ones.

    """
    known: dict[tuple[str, ...], float] = {}
    for fit in fitted:
        known[fit.names] = max(fit.evidence_here, known.get(fit.names, -np.inf))
    here = sorted({c.candidate for c in lead.sensitivities.candidates.columns} - {-1, *lead.effects})
    found = []
    for one in lead.effects:
        rest = tuple(i for i in lead.effects if i != one)
        least_promise = (
            lead.predicted_evidence(rest) + SEARCH.least_evidence_gain * lead.misfit_temperature
        )  # an effect that does not show promises as much as the rest
        for k in (k for k in here if words.is_compatible(lead.sensitivities.shooting.arm, k, rest)):
            promise = np.inf
            if not words.members[k].is_twin_of(words.members[one]):
                promise = lead.predicted_evidence((*rest, k))
            names = words.names_of((*rest, k))
            if promise > max(
                known.get(names, -np.inf),
                lead.evidence_here - SEARCH.look_alike_margin * lead.misfit_temperature,
                least_promise,
            ):
                found.append((promise, (*rest, k)))
    return [atoms for _, atoms in sorted(found, reverse=True)[: SEARCH.most_look_alikes]]


def settle_close_calls(fits: list[Fit], words: CandidateSet, on_stage: StageListener) -> list[Fit]:
    """Fit all hypotheses close to the best to their end, so that a close call does not depend on who was dropped on the
    way.

    Args:
        fits: the fits, which are used up.
        words: all candidates.
        on_stage: receives the stage as it begins.

    Returns:
        The fits, the best first.

    """
    ordered = sort_by_evidence(fits)
    excess = ordered[0].misfit_temperature
    least = max(charge_effects(fit.evidence_here, fit, excess) for fit in ordered) - SEARCH.close_call_margin * excess
    best: dict[tuple[str, ...], Fit] = {}  # the best fit of each set
    for fit in ordered:
        if fit is ordered[0] or charge_effects(fit.score.evidence, fit, excess) >= least:
            best.setdefault(fit.names, fit)
    close = list(best.values())[: SEARCH.most_close_calls]
    budget = ordered[0].sensitivities.shooting.budget
    if len(close) < 2 or budget.is_left_out("close calls, each fitted to its end"):
        return drop_columns([restore_columns(ordered[0], words), *ordered[1:]])
    on_stage(Stage.CLOSE_CALLS)
    LOGGER.info("going on with %s", ", ".join(join_effect_names(fit) for fit in close))
    rest = [fit.without_columns() for fit in ordered if fit not in close]
    del ordered, best, fits[:]  # the other fits free their memory
    lead = close[0].names  # the best one must have its columns

    def in_the_end(fit: Fit) -> Fit:
        has_ended = not fit.has_columns and (budget.is_up or (fit.has_converged and not fit.has_kept_columns))
        if fit.names == lead or not has_ended:
            fit = restore_columns(fit, words)
        return continue_fit(fit, words, SEARCH.close_call_steps, FIT.least_evidence_step)

    settled = map_in_threads(in_the_end, (close.pop(0) for _ in range(len(close))))
    return drop_columns(sort_by_evidence([*settled, *rest]))


def fit_from_leader(lead: Fit, words: CandidateSet, begin: RefitCall) -> Fit:
    """Fit a hypothesis that starts at the leader's point.

    Args:
        lead: the leader.
        words: all candidates.
        begin: the function that starts the hypothesis from the leader, and the places of its candidates.

    Returns:
        The fit. It is without its columns where it cannot come close, even if each further step brought as much as the
        last one.

    """
    how, atoms = begin
    fit = how(lead, words, atoms)
    least = (
        charge_effects(lead.evidence_here, lead, lead.misfit_temperature)
        - SEARCH.close_call_margin * lead.misfit_temperature
    )
    for number in range(1, SEARCH.refit_rounds + 1):
        before = fit
        fit = advance_with_note(
            words, f"from {join_effect_names(lead)}, round {number} of {SEARCH.refit_rounds}", before
        )
        gain = max(fit.score.evidence - before.score.evidence, fit.evidence_here - before.evidence_here)
        behind = least - charge_effects(fit.score.evidence, fit, lead.misfit_temperature)
        if fit.evidence_here < lead.evidence_here and behind > gain * (SEARCH.refit_rounds - number):
            return fit.without_columns()
    return fit
