"""The search: screen all effects in one linear model, race the leading ones, then add further effects to the winner."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.gauss_newton import LEAST_EVIDENCE_STEP, place_candidate
from hdagen.diagnosis.inference.local_fit import (
    Fit,
    advance_fit,
    refit_from_start,
    refit_swapping,
    refit_without,
    rescale_spikes,
    restore_columns,
    start_fit,
)
from hdagen.diagnosis.inference.marginal_likelihood import (
    ScoredHypothesis,
    compute_posteriors,
    compute_presence_probability,
    score_candidate_sets,
)
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import Sensitivities, compute_sensitivities, select_columns
from hdagen.diagnosis.initialization.torque_regression import TorqueRegression, begin_sets
from hdagen.diagnosis.search.fit_order import (
    charge_effects,
    drop_columns,
    first_with_columns,
    is_beyond_known_effects,
    keep_best_starts,
    leaves_much,
    place_by_size,
    sort_by_evidence,
    sort_by_promise,
)
from hdagen.diagnosis.search.multistart import Start, scan_sizes
from hdagen.diagnosis.search.null_model import choose_spike_scale, make_nominal_point
from hdagen.diagnosis.search.ripple_order import add_ripple_orders
from hdagen.diagnosis.stages.stage import Stage, StageListener
from hdagen.support.parallel import map_in_threads

LOGGER = logging.getLogger(__name__)
RACE_STAGES = (Stage.RACE_ROUND_1, Stage.RACE_ROUND_2, Stage.RACE_ROUND_3)
RACE_SIZES = (9, 5, 3)  # hypotheses beside the null model in each round of the race
MOST_EFFECTS_OF_SET = 3  # effects at once
FURTHER_RACE_SIZES = (5, 3, 2)  # the same as FIELD for further effects beside a leader
AT_BOUND_DEVIATIONS, MOST_AT_BOUND = (
    2.5,
    2,
)  # spike widths, from which a nuisance effect is at its bound; at most so many are tried
LEAST_EVIDENCE_GAIN = 1.0  # temperatures of log evidence that a further effect must promise to be fitted
LEAST_PROMISE_SHARE = (
    0.05  # of the largest promise, that another effect must reach to be fitted; the effects named in 11
)
# development logs promised 0.61 of it or more
LEAST_LEAD = 3.0  # temperatures by which a larger set must lead: as much may still be gained
MOST_FURTHER_STEPS = 3  # further steps at most, each for another temperature of log evidence
REFIT_ROUNDS = 3  # rounds for hypotheses that start at the leader's point: its subsets and look-alikes
LOOK_ALIKE_MARGIN, MOST_LOOK_ALIKES = (
    40.0,
    3,
)  # temperatures behind the leader, in its linear model, of a look-alike; at most so many
FINALIST_COUNT = 2  # hypotheses beside the null model that go on after the race
MERGING_ROUND = 2  # round after which a set with two starts keeps the better one
TRAILING_SHARE = 1 / 3  # of the leader's gain over the null model, below which a hypothesis is dropped
FIRST_ROUND_SHARE = 0.1  # the same before the first step
OUTDONE_RATIO = 10.0  # times the best one's misfit, from which the null model is dropped
HOPELESS_MARGIN = 20.0  # temperatures behind the leader, from which a hypothesis is not fitted to its end
CLOSE_CALL_MARGIN, MOST_CLOSE_CALLS = (
    10.0,
    4,
)  # temperatures behind the best, that make a close call; at most so many are settled
CLOSE_CALL_STEPS = 8  # further steps of each of them at most
CLEAN_LEVELS = 0.05, 1.02  # unexplained torque and squared noise scale, below which no large effect is left to be found


RefitCall = tuple[Callable[[Fit, CandidateSet, tuple[int, ...]], Fit], tuple[int, ...]]


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


def search_hypotheses(shooting: MultipleShooting, words: CandidateSet, on_stage: StageListener) -> SearchResult:
    """Search the effects that explain a record. All effects are screened in one linear model and at several sizes, the
    leading ones are fitted, then sets of them.

    Args:
        shooting: the record and its model.
        words: all candidates.
        on_stage: receives each stage as it begins.

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
    starts = scan_sizes(at, words, far=far)
    at.cross_products.drop_caches()
    none = next(s for s in screened if not s.effects)
    field = [
        start_fit(at, words, (), none.posterior.s),
        *_start_promising(at, words, screened, starts, (), RACE_SIZES[0], LEAST_EVIDENCE_GAIN),
    ]
    if regression:
        field += begin_sets(regression, at, none.posterior.s)
    return SearchResult(words, tuple(run_races(at, words, field, on_stage)), tuple(screened))


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


def _adopt_spike_scale(fitted: list[Fit], words: CandidateSet) -> tuple[list[Fit], CandidateSet]:
    """Give all fits, and the candidates, the spike width that is most probable for the best fit."""
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
        return _continue_fit(fit, words, MOST_FURTHER_STEPS, 1.0)

    moved = sort_by_promise([adopt(fit) for fit in fitted])
    further = [fit for fit in moved if not fit.effects][:1] + [fit for fit in moved if fit.effects and fit.has_columns][
        :FINALIST_COUNT
    ]
    gone = map_in_threads(go_on, further)
    return sort_by_promise([*(fit.without_columns() for fit in moved if fit not in further), *gone]), words


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
    fitted = _drop_undeserved(_run_race(field, words, RACE_SIZES, on_stage))
    if is_beyond_known_effects(fitted) or sort_by_evidence(fitted)[0].evidence_here < least:
        return drop_columns(sort_by_evidence(fitted))
    fitted, words = _adopt_spike_scale(fitted, words)
    lead = first_with_columns(fitted)
    leads = [
        lead,
        *[f for f in fitted if f is not lead and f.has_columns and f.effects and leaves_much(lead, fitted)][:1],
    ]
    while len(leads[0].effects) < MOST_EFFECTS_OF_SET:
        before = leads[0]
        for lead in leads:
            words = add_ripple_orders(lead, words)
        further = [fit for lead in leads for fit in _start_with_one_more(at, words, lead)]
        leads, fitted = [], drop_columns(fitted)
        if further:
            fitted, words = _adopt_spike_scale(
                sort_by_promise([*fitted, *_run_race(further, words, FURTHER_RACE_SIZES, on_stage)]), words
            )
        lead, stood = first_with_columns(fitted), next(f for f in fitted if f.effects == before.effects)
        if lead.evidence_here < stood.evidence_here + LEAST_LEAD * stood.misfit_temperature:
            if stood.has_columns:
                lead = stood
            break
        leads, fitted = [lead], drop_columns(fitted)
    fewer = [atoms for atoms in lead.subsets[:-1] if len(atoms) in {0, len(lead.effects) - 1}]
    fewer = [
        atoms
        for atoms in fewer
        if lead.predicted_evidence(atoms) > lead.evidence_here - LOOK_ALIKE_MARGIN * lead.misfit_temperature
    ]
    on_stage(Stage.RIVALS)
    begin = [
        *((refit_without, atoms) for atoms in fewer),
        *((refit_swapping, atoms) for atoms in _find_look_alikes(lead, fitted, words)),
    ]
    if len(lead.effects) > 1:
        begin.append((partial(refit_from_start, at.point), lead.effects))
    return _settle_close_calls(
        [*fitted, *map_in_threads(partial(_fit_from_leader, lead, words), begin)], words, on_stage
    )


def _find_look_alikes(lead: Fit, fitted: Sequence[Fit], words: CandidateSet) -> list[tuple[int, ...]]:
    """List sets with another effect in place of one of the leader's. Each must predict nearly as much at the leader's
    point, and more than it reached in its own fit. Sets with a twin come first, then the most promising ones."""
    known: dict[tuple[str, ...], float] = {}
    for fit in fitted:
        known[fit.names] = max(fit.evidence_here, known.get(fit.names, -np.inf))
    here = sorted({c.candidate for c in lead.sensitivities.candidates.columns} - {-1, *lead.effects})
    found = []
    for one in lead.effects:
        rest = tuple(i for i in lead.effects if i != one)
        alone = (
            lead.predicted_evidence(rest) + LEAST_EVIDENCE_GAIN * lead.misfit_temperature
        )  # an effect that does not show promises as much as the rest
        for k in (k for k in here if words.is_compatible(lead.sensitivities.shooting.arm, k, rest)):
            promise = np.inf
            if not words.members[k].is_twin_of(words.members[one]):
                promise = lead.predicted_evidence((*rest, k))
            names = words.names_of((*rest, k))
            if promise > max(
                known.get(names, -np.inf), lead.evidence_here - LOOK_ALIKE_MARGIN * lead.misfit_temperature, alone
            ):
                found.append((promise, (*rest, k)))
    return [atoms for _, atoms in sorted(found, reverse=True)[:MOST_LOOK_ALIKES]]


def _settle_close_calls(fits: list[Fit], words: CandidateSet, on_stage: StageListener) -> list[Fit]:
    """Fit all hypotheses close to the best to their end, so that a close call does not depend on who was dropped on the
    way. ``fits`` are used up; the best comes first."""
    ordered = sort_by_evidence(fits)
    excess = ordered[0].misfit_temperature
    least = max(charge_effects(fit.evidence_here, fit, excess) for fit in ordered) - CLOSE_CALL_MARGIN * excess
    best: dict[tuple[str, ...], Fit] = {}  # the best fit of each set
    for fit in ordered:
        if fit is ordered[0] or charge_effects(fit.score.evidence, fit, excess) >= least:
            best.setdefault(fit.names, fit)
    close = list(best.values())[:MOST_CLOSE_CALLS]
    if len(close) < 2:
        return drop_columns(ordered)
    on_stage(Stage.CLOSE_CALLS)
    LOGGER.info("going on with %s", ", ".join(_join_names(fit) for fit in close))
    rest = [fit.without_columns() for fit in ordered if fit not in close]
    del ordered, best, fits[:]  # the other fits free their memory
    done = [fit.names for fit in close[1:] if fit.has_converged]  # the best one must have its columns

    def in_the_end(fit: Fit) -> Fit:
        if not fit.has_columns and fit.names not in done:
            return _continue_fit(restore_columns(fit, words), words, CLOSE_CALL_STEPS, LEAST_EVIDENCE_STEP)
        return _continue_fit(fit, words, CLOSE_CALL_STEPS, LEAST_EVIDENCE_STEP)

    stood = map_in_threads(in_the_end, (close.pop(0) for _ in range(len(close))))
    return drop_columns(sort_by_evidence([*stood, *rest]))


def _continue_fit(fit: Fit, words: CandidateSet, steps: int, enough: float) -> Fit:
    """Take more steps with a fit, as long as one brings ``enough`` temperatures of log evidence."""
    best, gain = fit, np.inf
    for _ in range(steps):
        before, fit = fit, advance_fit(fit, words)
        gain = max(fit.score.evidence - before.score.evidence, fit.evidence_here - best.evidence_here)
        best = max(best, fit, key=lambda one: one.evidence_here)
        if gain < enough * best.misfit_temperature:
            break
    if (
        best is not fit and gain < LEAST_EVIDENCE_STEP * best.misfit_temperature
    ):  # the steps after the best one brought next to nothing
        return replace(best, has_converged=True)
    return best


def _fit_from_leader(lead: Fit, words: CandidateSet, begin: RefitCall) -> Fit:
    """Fit a hypothesis that starts at the leader's point. Without its columns where it cannot come close, even if each
    further step brought as much as the last one."""
    how, atoms = begin
    fit = how(lead, words, atoms)
    least = (
        charge_effects(lead.evidence_here, lead, lead.misfit_temperature) - CLOSE_CALL_MARGIN * lead.misfit_temperature
    )
    for number in range(1, REFIT_ROUNDS + 1):
        before = fit
        fit = _advance_with_note(words, f"from {_join_names(lead)}, round {number} of {REFIT_ROUNDS}", before)
        gain = max(fit.score.evidence - before.score.evidence, fit.evidence_here - before.evidence_here)
        behind = least - charge_effects(fit.score.evidence, fit, lead.misfit_temperature)
        if fit.evidence_here < lead.evidence_here and behind > gain * (REFIT_ROUNDS - number):
            return fit.without_columns()
    return fit


def _start_promising(
    at: Sensitivities,
    words: CandidateSet,
    scored: Sequence[ScoredHypothesis],
    starts: dict[int, Start],
    lead: tuple[int, ...],
    most: int,
    worth: float,
) -> list[Fit]:
    """Start the effects that promise most beside ``lead``, each in the linear model or at its best scanned size."""
    alone = next(s for s in scored if s.effects == lead)
    found: dict[str, tuple[float, int]] = {}
    linear = {s.effects[-1]: s.evidence - alone.evidence for s in scored if len(s.effects) > len(lead)}
    for k, gain in linear.items():
        if not words.is_compatible(at.shooting.arm, k, lead):
            continue
        at_size = starts[k].gain if k in starts else -np.inf
        name, best = words.members[k].name, max(gain, at_size)
        if best > worth and best > found.get(name, (-np.inf, k))[0]:
            found[name] = best, k
    ranked = sorted(found.values(), reverse=True)[:most]
    leading = [k for gain, k in ranked if gain >= LEAST_PROMISE_SHARE * ranked[0][0]]

    def begin(k: int) -> Fit:
        start = None
        if k in starts and starts[k].gain > linear[k]:
            start = starts[k].point
        return start_fit(at, words, (*lead, k), alone.posterior.s, start)

    return map_in_threads(begin, leading)


def _run_race(field: list[Fit], words: CandidateSet, sizes: tuple[int, ...], on_stage: StageListener) -> list[Fit]:
    """Fit all of ``field``, which is used up, in rounds, and drop the hypotheses that trail far behind; the best
    first."""
    field[:], out = _keep_promising(sort_by_promise(field), FIRST_ROUND_SHARE, len(field))
    for number, most in enumerate((*sizes[1:], len(field)), 1):
        on_stage(RACE_STAGES[number - 1])
        given = (field.pop(0) for _ in range(len(field)))  # each old fit frees its memory as soon as its step is done
        moved = sort_by_promise(
            map_in_threads(partial(_advance_with_note, words, f"round {number} of {len(sizes)}"), given)
        )
        if number == MERGING_ROUND:
            moved, left_behind = keep_best_starts(moved)
            out += left_behind
        field, left = _keep_promising(moved, TRAILING_SHARE, most)
        out += left
        del moved
    best = [f for f, place in place_by_size(sort_by_promise(field)) if not f.effects or place < FINALIST_COUNT]
    rest = [f for f in field if f not in best]
    hopeless = best[0].score.evidence - HOPELESS_MARGIN * best[0].misfit_temperature
    rest += [f for f in best if f.score.evidence < hopeless]
    settled = map_in_threads(
        lambda f: _continue_fit(f, words, MOST_FURTHER_STEPS, 1.0), [f for f in best if f not in rest]
    )
    return sort_by_promise([*out, *rest, *settled])


def _keep_promising(fits: list[Fit], share: float, most: int) -> tuple[list[Fit], list[Fit]]:
    """Split fits, the best first, into those that go on and the others, without their columns. The null model goes on
    unless it is outdone. Of the others the first ``most`` go on that gain a ``share`` of the best one's gain or are
    close to it."""
    none, lead = next((f.score.evidence for f in fits if not f.effects), -np.inf), fits[0]
    least = -np.inf
    if none > -np.inf:
        least = min(
            none + share * (lead.score.evidence - none),
            lead.score.evidence - CLOSE_CALL_MARGIN * lead.misfit_temperature,
        )

    def goes_on(place: int, fit: Fit) -> bool:
        if not fit.effects:
            return not _is_outdone(fit, lead)
        return place < most and fit.score.evidence >= least

    further = [f for f, place in place_by_size(fits) if goes_on(place, f)]
    return further, [f.without_columns() for f in fits if f not in further]


def _drop_undeserved(fits: list[Fit]) -> list[Fit]:
    """Drop the columns, and so the lead, of fits that have more effects than another one without the evidence to pay
    for them."""
    fewest = min((len(fit.effects) for fit in fits if fit.effects), default=0)
    if all(len(fit.effects) in (0, fewest) for fit in fits):
        return fits
    excess = sort_by_evidence(fits)[0].misfit_temperature
    lead = max(
        (fit for fit in fits if fit.has_columns), key=lambda fit: charge_effects(fit.score.evidence, fit, excess)
    )
    return [fit if fit is lead or len(fit.effects) <= fewest else fit.without_columns() for fit in fits]


def _is_outdone(none: Fit, lead: Fit) -> bool:
    """Tell whether the null model will leave many times the misfit of the best fit."""
    return none.noise_only_evidence - none.score.evidence > OUTDONE_RATIO * max(
        lead.noise_only_evidence - lead.evidence_here, lead.misfit_temperature
    )


def _advance_with_note(words: CandidateSet, when: str, fit: Fit) -> Fit:
    """Log a step of a fit and take it."""
    LOGGER.info("fitting %s, %s", _join_names(fit), when)
    return advance_fit(fit, words)


def _join_names(fit: Fit) -> str:
    """The effects of a fit in words."""
    return " + ".join(fit.names) or "none"


def _is_clean(fit: Fit) -> bool:
    """Tell whether a fit leaves nothing for a large effect to explain."""
    return fit.score.posterior.s <= CLEAN_LEVELS[0] and fit.score.posterior.noise_level <= CLEAN_LEVELS[1]


def _start_with_one_more(at: Sensitivities, words: CandidateSet, lead: Fit) -> list[Fit]:
    """Start the leader with one more effect: with those that promise most, with those at their nuisance bound, and with
    ripples of an order that the leader's residual shows. In a bent valley, the slope promises little of an effect at
    its bound."""
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
    found = _start_promising(
        full, words, scored, starts, lead.effects, FURTHER_RACE_SIZES[0], LEAST_EVIDENCE_GAIN * lead.misfit_temperature
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

    return [*found, *map_in_threads(begin, [*brimming[:MOST_AT_BOUND], *late])]


def _find_at_bound(lead: Fit) -> list[int]:
    """List the candidates at the bound of a nuisance effect, the largest first."""
    words, mean = lead.sensitivities.candidates, lead.posterior[0]
    reach: dict[int, float] = {}
    for c, value in zip(words.columns, mean, strict=True):
        if c.candidate >= 0 and words.members[c.candidate].name not in words.active:
            reach[c.candidate] = max(reach.get(c.candidate, 0.0), abs(float(value)) / c.spike_width)
    return [k for k in sorted(reach, key=lambda k: -reach[k]) if reach[k] >= AT_BOUND_DEVIATIONS]
