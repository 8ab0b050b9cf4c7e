"""The search: screen all effects in one linear model, race the leading ones, then add further effects to the winner."""

from __future__ import annotations

import logging
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hdagen.diagnosis.inference.alternative_starts import refit_from_start, refit_swapping, refit_without
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.local_fit import Fit, start_fit
from hdagen.diagnosis.inference.marginal_likelihood import (
    ScoredHypothesis,
    compute_posteriors,
    compute_presence_probability,
    score_candidate_sets,
)
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import Sensitivities
from hdagen.diagnosis.initialization.torque_regression import TorqueRegression
from hdagen.diagnosis.search.close_calls import RefitCall, find_look_alikes, fit_from_leader, settle_close_calls
from hdagen.diagnosis.search.equal_motions import find_equal_motions, refit_at_point
from hdagen.diagnosis.search.fit_ranking import (
    drop_columns,
    drop_undeserved,
    first_with_columns,
    is_beyond_known_effects,
    leaves_much,
    sort_by_evidence,
    sort_by_promise,
)
from hdagen.diagnosis.search.hypothesis_race import (
    adopt_spike_scale,
    run_race,
    start_promising,
    start_with_one_more,
    take_further_steps,
)
from hdagen.diagnosis.search.multistart import scan_sizes
from hdagen.diagnosis.search.null_model import make_nominal_point
from hdagen.diagnosis.search.ordinary_frictions import fit_ordinary_frictions
from hdagen.diagnosis.search.regressed_starts import start_regressed_sets
from hdagen.diagnosis.search.ripple_order import add_ripple_orders
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.diagnosis.search.whole_drives import fit_whole_drives, list_absent_inertias
from hdagen.diagnosis.search.whole_file import fit_whole_file
from hdagen.diagnosis.search.wrong_numbers import (
    choose_wrong_numbers,
    free_wrong_numbers,
    list_numbers,
    may_grow,
)
from hdagen.diagnosis.stages.stage import Stage, StageListener
from hdagen.support.parallel import map_in_threads

LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of a search.

    Attributes:
        candidates: every effect on every joint that was a candidate.
        fits: the null model, the leading effects and sets of them, each at its optimum, the most probable first.
        screened: every effect that the log could show, in the linear model about the robot file's numbers, the most
            probable first.
        failures: a sentence for each part of the search that was left out, and for simulations that failed.

    """

    candidates: CandidateSet
    fits: tuple[Fit, ...]
    screened: tuple[ScoredHypothesis, ...]
    failures: tuple[str, ...] = ()


def search_hypotheses(
    shooting: MultipleShooting, words: CandidateSet, on_stage: StageListener, named: Collection[str] = ()
) -> SearchResult:
    """Search the effects that explain a record. All effects are screened in one linear model and at several sizes, the
    leading ones are fitted, then sets of them.

    Args:
        shooting: the record and its model.
        words: all candidates.
        on_stage: receives each stage as it begins.
        named: effects that a search named which took the robot file as right, name@joint.

    Returns:
        The fits, and the screening.

    """
    on_stage(Stage.SCREENING)
    LOGGER.info("screening %d candidates", len(words.members))
    at = compute_sensitivities(shooting, words, make_nominal_point(shooting, words))
    screened = _screen_candidates(at.with_visible_columns())
    regression = TorqueRegression.from_record(shooting.arm, shooting.record, words)
    far = {}
    if regression:
        far = regression.distant_effects()
    none = next(s for s in screened if not s.effects)
    field = [start_fit(at, words, (), none.posterior.s)]
    if shooting.budget.is_left_out("fits of single effects", (atom.name for atom in words.members)):
        return SearchResult(words, tuple(field), tuple(screened))
    if regression and list_absent_inertias(words):
        field.append(fit_whole_drives(regression, at, words, none.posterior.s))
        if not leaves_much(field[1], field):
            return SearchResult(words, tuple(run_races(at, words, field, on_stage)), tuple(screened))
    starts = scan_sizes(at, words, far=far)
    at.cross_products.drop_caches()
    field += start_promising(at, words, screened, starts, (), SEARCH.race_sizes[0], SEARCH.least_evidence_gain)
    if regression:
        field += start_regressed_sets(regression, at, none.posterior.s)
        if words.has_numbers and not shooting.budget.is_left_out("all numbers of the robot file together"):
            field.append(fit_whole_file(regression, at, words, named, none.posterior.s))
    if len(numbers := choose_wrong_numbers(field[0])) > 1:
        field.append(start_fit(at, words, numbers, none.posterior.s))
    at.drop_products()
    fits = run_races(at, words, field, on_stage)
    if regression and not shooting.budget.is_left_out("ordinary frictions in place of the leading ones"):
        fits = drop_columns(sort_by_evidence([*fits, *fit_ordinary_frictions(regression, at, words, fits)]))
    return SearchResult(words, tuple(fits), tuple(screened))


def _add_wrong_numbers(fitted: list[Fit], words: CandidateSet) -> list[Fit]:
    """Add the best fit with the numbers of the robot file that explain most of what it leaves."""
    more = free_wrong_numbers(first_with_columns(fitted), words)
    if more is None:
        return fitted
    return drop_undeserved(sort_by_promise([more, *fitted]))


def _add_numbers_alone(fitted: list[Fit], words: CandidateSet) -> list[Fit]:
    """Add the best fit's wrong numbers alone, with those that stand in for its effects: these were chosen while the
    robot file was taken as right."""
    lead = first_with_columns(fitted)
    numbers = list_numbers(lead)
    budget = lead.sensitivities.shooting.budget
    if not numbers or len(numbers) == len(lead.effects) or budget.is_left_out("wrong numbers alone"):
        return fitted
    alone = take_further_steps(refit_without(lead, words, numbers), words)
    alone = free_wrong_numbers(alone, words) or alone
    return drop_undeserved(sort_by_promise([alone, *fitted]))


def _screen_candidates(at: Sensitivities) -> list[ScoredHypothesis]:
    """Score the null model and every effect that a channel shows, in the linear model, the most probable first."""
    silent, words, arm = at.undetectable_candidates(), at.candidates, at.shooting.arm
    singles = [(), *((k,) for k in range(len(words.members)) if k not in silent)]
    scored, spike = (
        score_candidate_sets(compute_posteriors(at.linear_model(), words.spike_widths), words, singles),
        words.spike_widths,
    )

    def sized(one: ScoredHypothesis) -> ScoredHypothesis:
        if not one.effects:
            return one
        bounds = words.with_active(one.effects).theta_bounds(arm)
        return replace(
            one,
            presence_probability=compute_presence_probability(
                one.posterior,
                spike,
                words.amplitude_columns(one.effects),
                words.presence_threshold(*one.effects),
                bounds,
            ),
        )

    return [sized(one) for one in scored]


def run_races(
    at: Sensitivities, words: CandidateSet, field: list[Fit], on_stage: StageListener, least: float = -np.inf
) -> list[Fit]:
    """Fit hypotheses in a race, and the best one with one more effect as long as that is better. Where the best fit
    leaves much of the misfit, one more effect is tried beside the next best, too: of two effects the apparently larger
    one may be a third that stands in for both.

    Args:
        at: sensitivities about the robot file's numbers.
        words: all candidates.
        field: the hypotheses, which are used up.
        on_stage: receives each stage as it begins.
        least: log evidence that the best must reach before effects are added to it.

    Returns:
        The fits, the best first, the others without their columns.

    """
    fitted = drop_undeserved(run_race(field, words, SEARCH.race_sizes, on_stage, least))
    fitted = _add_wrong_numbers(fitted, words)
    if is_beyond_known_effects(fitted) or sort_by_evidence(fitted)[0].evidence_here < least:
        return drop_columns(sort_by_evidence(fitted))
    fitted, words = adopt_spike_scale(fitted, words)
    fitted = _add_numbers_alone(fitted, words)
    lead = first_with_columns(fitted)
    leads = [
        lead,
        *[f for f in fitted if f is not lead and f.has_columns and f.effects and leaves_much(lead, fitted)][:1],
    ]
    budget = at.shooting.budget
    while may_grow(leads[0]) and not budget.is_left_out("one more effect beside the leading set"):
        before = leads[0]
        for lead in leads:
            words = add_ripple_orders(lead, words)
        further = [fit for lead in leads for fit in start_with_one_more(at, words, lead)]
        leads, fitted = [], drop_columns(fitted)
        if further:
            fitted, words = adopt_spike_scale(
                sort_by_promise([*fitted, *run_race(further, words, SEARCH.further_race_sizes, on_stage)]), words
            )
            fitted = _add_wrong_numbers(fitted, words)
        lead, stood = first_with_columns(fitted), next(f for f in fitted if f.effects == before.effects)
        if lead.evidence_here < stood.evidence_here + SEARCH.least_lead * stood.misfit_temperature:
            if stood.has_columns:
                lead = stood
            break
        leads, fitted = [lead], drop_columns(fitted)
    on_stage(Stage.RIVALS)
    return settle_close_calls([*fitted, *_fit_rivals(at, lead, fitted, words)], words, on_stage)


def _fit_rivals(at: Sensitivities, lead: Fit, fitted: list[Fit], words: CandidateSet) -> list[Fit]:
    """Fit the leading set without one of its effects or all of them, its look-alikes, sets that move the arm alike, and
    several effects once more from the robot file's numbers, as long as there is time."""
    fewer = [atoms for atoms in lead.subsets[:-1] if len(atoms) in {0, len(lead.effects) - 1}]
    fewer = [
        atoms
        for atoms in fewer
        if lead.predicted_evidence(atoms) > lead.evidence_here - SEARCH.look_alike_margin * lead.misfit_temperature
    ]
    begin: list[RefitCall] = [
        *((refit_without, atoms) for atoms in fewer),
        *((refit_swapping, atoms) for atoms in find_look_alikes(lead, fitted, words)),
        *((partial(refit_at_point, one.point), one.effects) for one in find_equal_motions(lead, words)),
    ]
    if len(lead.effects) > 1:
        begin.append((partial(refit_from_start, at.point), lead.effects))

    def fit_in_time(rival: RefitCall) -> Fit | None:
        if at.shooting.budget.is_left_out("rivals of the leading set"):
            return None
        return fit_from_leader(lead, words, rival)

    return [fit for fit in map_in_threads(fit_in_time, begin) if fit]
