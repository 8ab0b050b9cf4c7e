"""The race of hypotheses: who starts, the rounds in which they are fitted side by side, and who goes on."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.fit_settings import FIT
from hdagen.diagnosis.inference.fit_steps import advance_fit
from hdagen.diagnosis.inference.gauss_newton import place_candidate
from hdagen.diagnosis.inference.local_fit import Fit, rescale_spikes, restore_columns, start_fit
from hdagen.diagnosis.inference.marginal_likelihood import ScoredHypothesis, compute_posteriors, score_candidate_sets
from hdagen.diagnosis.inference.sensitivities import Sensitivities, select_columns
from hdagen.diagnosis.search.fit_ranking import first_with_columns, keep_best_starts, place_by_size, sort_by_promise
from hdagen.diagnosis.search.multistart import Start, scan_sizes
from hdagen.diagnosis.search.null_model import choose_spike_scale
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.diagnosis.stages.stage import Stage, StageListener
from hdagen.support.parallel import map_in_threads

LOGGER = logging.getLogger(__name__)
RACE_STAGES = (Stage.RACE_ROUND_1, Stage.RACE_ROUND_2, Stage.RACE_ROUND_3)


def adopt_spike_scale(fitted: list[Fit], words: CandidateSet) -> tuple[list[Fit], CandidateSet]:
    """Give all fits, and the candidates, the spike width that is most probable for the best fit.

    Args:
        fitted: the fits, at least one of them with columns.
        words: all candidates.

    Returns:
        The fits, the most promising first, and the candidates.

    """
    lead = first_with_columns(fitted)
    moved_to = choose_spike_scale(lead)
    share = moved_to.sensitivities.candidates.spike_scale
    if share == words.spike_scale:
        return fitted, words
    words = words.with_spike_scale(share)

    def adopt(fit: Fit) -> Fit:
        if fit is lead:
            return moved_to
        return rescale_spikes(fit, share)

    def go_on(fit: Fit) -> Fit:
        if not fit.has_columns:
            return fit
        return take_further_steps(fit, words)

    moved = sort_by_promise([adopt(fit) for fit in fitted])
    further = [fit for fit in moved if not fit.effects][:1] + [fit for fit in moved if fit.effects and fit.has_columns][
        : SEARCH.finalist_count
    ]
    gone = map_in_threads(go_on, further)
    return sort_by_promise([*(fit.without_columns() for fit in moved if fit not in further), *gone]), words


def continue_fit(fit: Fit, words: CandidateSet, steps: int, enough: float) -> Fit:
    """Take more steps with a fit, as long as one brings enough.

    Args:
        fit: the fit.
        words: all candidates.
        steps: number of steps at most.
        enough: log evidence that a step must bring, in temperatures.

    Returns:
        The fit after the step of most evidence reached.

    """
    best, gain = fit, np.inf
    for _ in range(steps):
        before, fit = fit, advance_fit(fit, words)
        gain = max(fit.score.evidence - before.score.evidence, fit.evidence_here - best.evidence_here)
        best = max(best, fit, key=lambda one: one.evidence_here)
        if gain < enough * best.misfit_temperature:
            break
    if (
        best is not fit and gain < FIT.least_evidence_step * best.misfit_temperature
    ):  # the steps after the best one brought next to nothing
        return replace(best, has_converged=True)
    return best


def take_further_steps(fit: Fit, words: CandidateSet) -> Fit:
    """Take the further steps of a fit that has begun, as long as each brings a temperature of log evidence.

    Args:
        fit: the fit.
        words: all candidates.

    Returns:
        The fit after the step of most evidence reached.

    """
    return continue_fit(fit, words, SEARCH.most_further_steps, 1.0)


def start_promising(
    at: Sensitivities,
    words: CandidateSet,
    scored: Sequence[ScoredHypothesis],
    starts: dict[int, Start],
    lead: tuple[int, ...],
    most: int,
    worth: float,
) -> list[Fit]:
    """Start the effects that promise most beside a set, each in the linear model or at its best scanned size.

    Args:
        at: design with the columns of all candidates.
        words: all candidates.
        scored: the set, and the set with one more effect each, in the linear model.
        starts: the best scanned size of each candidate that gains by one.
        lead: places of the set's candidates.
        most: number of fits at most.
        worth: log evidence that an effect must promise.

    Returns:
        The fits before their first step, the most promising first.

    """
    lead_score = next(s for s in scored if s.effects == lead)
    found: dict[str, tuple[float, int]] = {}
    linear = {s.effects[-1]: s.evidence - lead_score.evidence for s in scored if len(s.effects) > len(lead)}
    for k, gain in linear.items():
        if not words.is_compatible(at.shooting.arm, k, lead):
            continue
        at_size = starts[k].gain if k in starts else -np.inf
        name, best = words.members[k].name, max(gain, at_size)
        if best > worth and best > found.get(name, (-np.inf, k))[0]:
            found[name] = best, k
    ranked = sorted(found.values(), reverse=True)[:most]
    leading = [k for gain, k in ranked if gain >= SEARCH.least_promise_share * ranked[0][0]]

    def begin(k: int) -> Fit:
        start = None
        if k in starts and starts[k].gain > linear[k]:
            start = starts[k].point
        return start_fit(at, words, (*lead, k), lead_score.posterior.s, start)

    return map_in_threads(begin, leading)


def run_race(
    field: list[Fit], words: CandidateSet, sizes: tuple[int, ...], on_stage: StageListener, least: float = -np.inf
) -> list[Fit]:
    """Fit hypotheses in rounds, and drop those that trail far behind.

    Args:
        field: the hypotheses, which are used up.
        words: all candidates.
        sizes: hypotheses beside the null model in each round.
        on_stage: receives each stage as it begins.
        least: log evidence that the best must reach: one far behind it is not fitted to its end.

    Returns:
        All fits, the most promising first.

    """
    budget = field[0].sensitivities.shooting.budget
    field[:], out = _keep_promising(
        sort_by_promise(field), SEARCH.first_round_share, SEARCH.close_call_margin, len(field)
    )
    for number, most in enumerate((*sizes[1:], len(field)), 1):
        on_stage(RACE_STAGES[number - 1])
        given = (field.pop(0) for _ in range(len(field)))  # each old fit frees its memory as soon as its step is done
        step = partial(_advance_in_time, words, f"round {number} of {len(sizes)}", number == 1)
        moved = sort_by_promise([fit for fit in map_in_threads(step, enumerate(given)) if fit])
        if budget.is_up:
            budget.note_untried("further steps of fits")
        if number == SEARCH.merging_round:
            moved, left_behind = keep_best_starts(moved)
            out += left_behind
        margin = SEARCH.close_call_margin
        if number == 1:  # after its first step a fit may be far from its end
            margin = SEARCH.hopeless_margin
        field, left = _keep_promising(moved, SEARCH.trailing_share, margin, most)
        out += left
        del moved
    return sort_by_promise([*out, *_settle_finalists(field, words, least)])


def _settle_finalists(field: list[Fit], words: CandidateSet, least: float) -> list[Fit]:
    """Take the finalists a few steps further, but for hopeless ones. The leader gets all of its columns anew, as what
    comes next rests on them."""
    best = [f for f, place in place_by_size(sort_by_promise(field)) if not f.effects or place < SEARCH.finalist_count]
    reached = max(best[0].score.evidence, least)
    hopeless = reached - SEARCH.hopeless_margin * best[0].misfit_temperature
    finalists = [f for f in best if f.score.evidence >= hopeless]
    settled = sort_by_promise(map_in_threads(lambda f: take_further_steps(f, words), finalists))
    settled[:1] = [restore_columns(f, words) for f in settled[:1]]
    return [*(f for f in field if f not in finalists), *settled]


def _advance_in_time(words: CandidateSet, when: str, is_first: bool, turn: tuple[int, Fit]) -> Fit | None:
    """Take a step of the fit whose ``turn`` it is. Where the time is up, a fit that has taken none is noted and left
    out; the most promising one and the null model stay."""
    place, fit = turn
    budget, part, names = fit.sensitivities.shooting.budget, "fits of single effects", fit.names
    if len(names) > 1:
        part, names = "fits of sets of effects", ()
    if is_first and place and fit.effects and budget.is_left_out(part, names):
        return None
    moved = advance_with_note(words, when, fit)
    moved.sensitivities.drop_products()  # until the fit's next turn
    return moved


def _keep_promising(fits: list[Fit], share: float, margin: float, most: int) -> tuple[list[Fit], list[Fit]]:
    """Split fits, the best first, into those that go on and the others, without their columns. The null model goes on
    unless it is outdone. Of the others the first ``most`` go on that gain a ``share`` of the best one's gain or are
    within a ``margin`` of it, in temperatures."""
    none, lead = next((f.score.evidence for f in fits if not f.effects), -np.inf), fits[0]
    least = -np.inf
    if none > -np.inf:
        least = min(
            none + share * (lead.score.evidence - none),
            lead.score.evidence - margin * lead.misfit_temperature,
        )

    def goes_on(place: int, fit: Fit) -> bool:
        if not fit.effects:
            return not _is_outdone(fit, lead)
        return place < most and fit.score.evidence >= least

    further = [f for f, place in place_by_size(fits) if goes_on(place, f)]
    return further, [f.without_columns() for f in fits if f not in further]


def _is_outdone(none: Fit, lead: Fit) -> bool:
    """Tell whether the null model will leave many times the misfit of the best fit."""
    return none.noise_only_evidence - none.score.evidence > SEARCH.outdone_ratio * max(
        lead.misfit, lead.misfit_temperature
    )


def advance_with_note(words: CandidateSet, when: str, fit: Fit) -> Fit:
    """Log a step of a fit and take it.

    Args:
        words: all candidates.
        when: the place of the step in the search.
        fit: the fit.

    Returns:
        The fit after the step.

    """
    LOGGER.info("fitting %s, %s", join_effect_names(fit), when)
    return advance_fit(fit, words)


def join_effect_names(fit: Fit) -> str:
    """Join the names of a fit's effects.

    Args:
        fit: the fit.

    Returns:
        The effects in words.

    """
    return " + ".join(fit.names) or "none"


def _is_clean(fit: Fit) -> bool:
    """Tell whether a fit leaves nothing for a large effect to explain."""
    return fit.score.posterior.s <= SEARCH.clean_levels[0] and fit.score.posterior.noise_level <= SEARCH.clean_levels[1]


def start_with_one_more(at: Sensitivities, words: CandidateSet, lead: Fit) -> list[Fit]:
    """Start the leader with one more effect: with those that promise most, with those at their nuisance bound, and with
    ripples of an order that the leader's residual shows. In a bent valley, the slope promises little of an effect at
    its bound.

    Args:
        at: design with the columns of all candidates.
        words: all candidates.
        lead: the leader, with its columns.

    Returns:
        The fits before their first step.

    """
    full = select_columns(at, words.columns_for(lead.effects, every=True), lead.sensitivities)
    others = [k for k in range(len(words.members)) if words.members[k].name not in full.candidates.active]
    hypotheses = [lead.effects, *((*lead.effects, k) for k in others)]
    scored = score_candidate_sets(
        compute_posteriors(full.linear_model(), full.candidates.spike_widths, lead.score.posterior.s),
        full.candidates,
        hypotheses,
    )
    starts = {}
    if not _is_clean(lead):
        starts = scan_sizes(full, full.candidates, lead.score)
    found = start_promising(
        full,
        words,
        scored,
        starts,
        lead.effects,
        SEARCH.further_race_sizes[0],
        SEARCH.least_evidence_gain * lead.misfit_temperature,
    )
    tried = {name for fit in found for name in fit.names}
    new = [k for k in _find_at_bound(lead) if words.members[k].name not in tried]
    brimming = [k for k in new if words.is_compatible(full.shooting.arm, k, lead.effects)]
    late = [k for k in others if k >= len(at.candidates.members)]

    def begin(k: int) -> Fit:
        start = None
        if k in late:
            start = place_candidate(full, words.members[k], {})
        return start_fit(full, words, (*lead.effects, k), lead.score.posterior.s, start)

    return [*found, *map_in_threads(begin, [*brimming[: SEARCH.most_at_bound], *late])]


def _find_at_bound(lead: Fit) -> list[int]:
    """List the candidates at the bound of a nuisance effect, the largest first."""
    candidates, mean = lead.sensitivities.candidates, lead.posterior[0]
    reach: dict[int, float] = {}
    for c, value in zip(candidates.columns, mean, strict=True):
        if candidates.is_nuisance(c):
            reach[c.candidate] = max(reach.get(c.candidate, 0.0), abs(float(value)) / c.spike_width)
    return [k for k in sorted(reach, key=lambda k: -reach[k]) if reach[k] >= SEARCH.at_bound_deviations]
