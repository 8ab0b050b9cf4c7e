"""The search: screen all effects in one linear model, race the leading ones, then add further effects to the winner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hdagen.diagnosis.inference.candidate_priors import Dictionary
from hdagen.diagnosis.inference.gauss_newton import ENOUGH, put
from hdagen.diagnosis.inference.local_fit import Fitted, advanced, again, anew, begun, instead, lessened, sharing
from hdagen.diagnosis.inference.marginal_likelihood import Scored, large, posteriors, score
from hdagen.diagnosis.inference.multiple_shooting import Shooting
from hdagen.diagnosis.inference.sensitivities import Design, chosen, design
from hdagen.diagnosis.initialization.torque_regression import Regression, begin_sets
from hdagen.diagnosis.search.fit_order import (
    bared,
    best_first,
    charge_effects,
    first_whole,
    is_beyond,
    keep_best_starts,
    leaves_much,
    place_by_size,
    promising_first,
)
from hdagen.diagnosis.search.multistart import Start, scan
from hdagen.diagnosis.search.null_model import first, likeliest
from hdagen.diagnosis.search.ripple_order import heard
from hdagen.support.parallel import together

FIELD = (9, 5, 3)  # hypotheses beside the null model in each round of the race
MOST = 3  # effects at once
FURTHER = (5, 3, 2)  # the same as FIELD for further effects beside a leader
BRIM, MOST_BRIMMING = 2.5, 2  # spike widths, from which a nuisance effect is at its bound; at most so many are tried
WORTH = 1.0  # temperatures of log evidence that a further effect must promise to be fitted
FAINTLY = 0.05  # of the largest promise, that another effect must reach to be fitted; the effects named in 11
# development logs promised 0.61 of it or more
BARELY = 3.0  # temperatures by which a larger set must lead: as much may still be gained
LONGEST = 3  # further steps at most, each for another temperature of log evidence
FEWER = 3  # rounds for hypotheses that start at the leader's point: its subsets and look-alikes
ALIKE, MOST_ALIKE = 40.0, 3  # temperatures behind the leader, in its linear model, of a look-alike; at most so many
SETTLING = 2  # hypotheses beside the null model that go on after the race
ALONE = 2  # round after which a set with two starts keeps the better one
TRAILING = 1 / 3  # of the leader's gain over the null model, below which a hypothesis is dropped
FAINT = 0.1  # the same before the first step
OUTDONE = 10.0  # times the best one's misfit, from which the null model is dropped
HOPELESS = 20.0  # temperatures behind the leader, from which a hypothesis is not fitted to its end
CLOSE, MOST_CLOSE = 10.0, 4  # temperatures behind the best, that make a close call; at most so many are settled
STEPS = 8  # further steps of each of them at most
CLEAN = 0.05, 1.02  # unexplained torque and squared noise scale, below which no large effect is left to be found


Begin = tuple[Callable[[Fitted, Dictionary, tuple[int, ...]], Fitted], tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Search:
    """The result of a search. ``fitted``: the null model, the leading effects and sets of them, each at its optimum,
    the most probable first. ``screened``: every effect that the log could show, in the linear model about the robot
    file's numbers, the most probable first."""

    words: Dictionary
    fitted: tuple[Fitted, ...]
    screened: tuple[Scored, ...]


def search(shooting: Shooting, words: Dictionary, say: Callable[[str], None]) -> Search:
    """Search the effects that explain a record. All effects are screened in one linear model and at several sizes, the
    leading ones are fitted, then sets of them.

    Args:
        shooting: the record and its model.
        words: all candidates.
        say: receives a sentence as each stage begins.

    Returns:
        The fits, and the screening.

    """
    say(f"screening {len(words.atoms)} candidates")
    at = design(shooting, words, first(shooting, words))
    screened = _screened(at.whole())
    regression = Regression.of(shooting.arm, shooting.record, words)
    far = {}
    if regression:
        far = regression.far()
    starts = scan(at, words, far=far)
    at.gram.forget()
    none = next(s for s in screened if not s.atoms)
    field = [begun(at, words, (), none.at.s), *_promising(at, words, screened, starts, (), FIELD[0], WORTH)]
    if regression:
        field += begin_sets(regression, at, none.at.s)
    return Search(words, tuple(raced(at, words, field, say)), tuple(screened))


def _screened(at: Design) -> list[Scored]:
    """Score the null model and every effect that a channel shows, in the linear model, the most probable first."""
    silent, words, arm = at.silent(), at.words, at.shooting.arm
    singles = [(), *((k,) for k in range(len(words.atoms)) if k not in silent)]
    scored, spike = score(posteriors(at.linear(), words.spike), words, singles), words.spike

    def sized(one: Scored) -> Scored:
        if not one.atoms:
            return one
        bounds = words.meaning(one.atoms).bounds(arm)
        return replace(one, large=large(one.at, spike, words.free(one.atoms), words.counts(*one.atoms), bounds))

    return [sized(one) for one in scored]


def _shared(fitted: list[Fitted], words: Dictionary) -> tuple[list[Fitted], Dictionary]:
    """Give all fits, and the candidates, the spike width that is most probable for the best fit."""
    lead = first_whole(fitted)
    moved_to = likeliest(lead)
    share = moved_to.design.words.share
    if share == words.share:
        return fitted, words
    words = words.sharing(share)

    def adopt(fit: Fitted) -> Fitted:
        if fit is lead:
            return moved_to
        return sharing(fit, share)

    def go_on(fit: Fitted) -> Fitted:
        if not fit.whole:
            return fit
        return _on(fit, words, LONGEST, 1.0)

    moved = promising_first([adopt(fit) for fit in fitted])
    further = [fit for fit in moved if not fit.atoms][:1] + [fit for fit in moved if fit.atoms and fit.whole][:SETTLING]
    gone = together(go_on, further)
    return promising_first([*(fit.bare() for fit in moved if fit not in further), *gone]), words


def raced(
    at: Design, words: Dictionary, field: list[Fitted], say: Callable[[str], None], least: float = -np.inf
) -> list[Fitted]:
    """Fit hypotheses in a race, and the best one with one more effect as long as that is better. Where the best fit
    leaves much of the misfit, one more effect is tried beside the next best, too: of two effects the apparently larger
    one may be a third that stands in for both.

    Args:
        at: sensitivities about the robot file's numbers.
        words: all candidates.
        field: the hypotheses, which are used up.
        say: receives a sentence as each fit begins.
        least: log evidence that the best must reach before effects are added to it.

    Returns:
        The fits, the best first, the others without their columns.

    """
    fitted = _deserved(_race(field, words, FIELD, say))
    if is_beyond(fitted) or best_first(fitted)[0].reached < least:
        return bared(best_first(fitted))
    fitted, words = _shared(fitted, words)
    lead = first_whole(fitted)
    leads = [lead, *[f for f in fitted if f is not lead and f.whole and f.atoms and leaves_much(lead, fitted)][:1]]
    while len(leads[0].atoms) < MOST:
        before = leads[0]
        for lead in leads:
            words = heard(lead, words)
        further = [fit for lead in leads for fit in _beside(at, words, lead)]
        leads, fitted = [], bared(fitted)
        if further:
            fitted, words = _shared(promising_first([*fitted, *_race(further, words, FURTHER, say)]), words)
        lead, stood = first_whole(fitted), next(f for f in fitted if f.atoms == before.atoms)
        if lead.reached < stood.reached + BARELY * stood.excess:
            if stood.whole:
                lead = stood
            break
        leads, fitted = [lead], bared(fitted)
    fewer = [atoms for atoms in lead.lesser[:-1] if len(atoms) in {0, len(lead.atoms) - 1}]
    fewer = [atoms for atoms in fewer if lead.promised(atoms) > lead.reached - ALIKE * lead.excess]
    begin = [*((lessened, atoms) for atoms in fewer), *((instead, atoms) for atoms in _alike(lead, fitted, words))]
    if len(lead.atoms) > 1:
        begin.append((partial(anew, at.point), lead.atoms))
    return _contested([*fitted, *together(partial(_from, lead, words, say), begin)], words, say)


def _alike(lead: Fitted, fitted: Sequence[Fitted], words: Dictionary) -> list[tuple[int, ...]]:
    """List sets with another effect in place of one of the leader's. Each must predict nearly as much at the leader's
    point, and more than it reached in its own fit. Sets with a twin come first, then the most promising ones."""
    known: dict[tuple[str, ...], float] = {}
    for fit in fitted:
        known[fit.names] = max(fit.reached, known.get(fit.names, -np.inf))
    here = sorted({c.atom for c in lead.design.words.columns} - {-1, *lead.atoms})
    found = []
    for one in lead.atoms:
        rest = tuple(i for i in lead.atoms if i != one)
        alone = lead.promised(rest) + WORTH * lead.excess  # an effect that does not show promises as much as the rest
        for k in (k for k in here if words.fits(lead.design.shooting.arm, k, rest)):
            promise = np.inf
            if not words.atoms[k].twin(words.atoms[one]):
                promise = lead.promised((*rest, k))
            names = words.names((*rest, k))
            if promise > max(known.get(names, -np.inf), lead.reached - ALIKE * lead.excess, alone):
                found.append((promise, (*rest, k)))
    return [atoms for _, atoms in sorted(found, reverse=True)[:MOST_ALIKE]]


def _contested(fits: list[Fitted], words: Dictionary, say: Callable[[str], None]) -> list[Fitted]:
    """Fit all hypotheses close to the best to their end, so that a close call does not depend on who was dropped on the
    way. ``fits`` are used up; the best comes first."""
    ordered = best_first(fits)
    excess = ordered[0].excess
    least = max(charge_effects(fit.reached, fit, excess) for fit in ordered) - CLOSE * excess
    best: dict[tuple[str, ...], Fitted] = {}  # the best fit of each set
    for fit in ordered:
        if fit is ordered[0] or charge_effects(fit.score.evidence, fit, excess) >= least:
            best.setdefault(fit.names, fit)
    close = list(best.values())[:MOST_CLOSE]
    if len(close) < 2:
        return bared(ordered)
    say(f"going on with {', '.join(' + '.join(fit.names) or 'none' for fit in close)}")
    rest = [fit.bare() for fit in ordered if fit not in close]
    del ordered, best, fits[:]  # the other fits free their memory
    done = [fit.names for fit in close[1:] if fit.stands]  # the best one must have its columns

    def in_the_end(fit: Fitted) -> Fitted:
        if not fit.whole and fit.names not in done:
            return _on(again(fit, words), words, STEPS, ENOUGH)
        return _on(fit, words, STEPS, ENOUGH)

    stood = together(in_the_end, (close.pop(0) for _ in range(len(close))))
    return bared(best_first([*stood, *rest]))


def _on(fit: Fitted, words: Dictionary, steps: int, enough: float) -> Fitted:
    """Take more steps with a fit, as long as one brings ``enough`` temperatures of log evidence."""
    best, gain = fit, np.inf
    for _ in range(steps):
        before, fit = fit, advanced(fit, words)
        gain = max(fit.score.evidence - before.score.evidence, fit.reached - best.reached)
        best = max(best, fit, key=lambda one: one.reached)
        if gain < enough * best.excess:
            break
    if best is not fit and gain < ENOUGH * best.excess:  # the steps after the best one brought next to nothing
        return replace(best, stands=True)
    return best


def _from(lead: Fitted, words: Dictionary, say: Callable[[str], None], begin: Begin) -> Fitted:
    """Fit a hypothesis that starts at the leader's point. Without its columns where it cannot come close, even if each
    further step brought as much as the last one."""
    how, atoms = begin
    fit = how(lead, words, atoms)
    least = charge_effects(lead.reached, lead, lead.excess) - CLOSE * lead.excess
    for number in range(1, FEWER + 1):
        before = fit
        fit = _further(words, say, f"from {' + '.join(lead.names)}, round {number} of {FEWER}", before)
        gain = max(fit.score.evidence - before.score.evidence, fit.reached - before.reached)
        behind = least - charge_effects(fit.score.evidence, fit, lead.excess)
        if fit.reached < lead.reached and behind > gain * (FEWER - number):
            return fit.bare()
    return fit


def _promising(
    at: Design,
    words: Dictionary,
    scored: Sequence[Scored],
    starts: dict[int, Start],
    lead: tuple[int, ...],
    most: int,
    worth: float,
) -> list[Fitted]:
    """Start the effects that promise most beside ``lead``, each in the linear model or at its best scanned size."""
    alone = next(s for s in scored if s.atoms == lead)
    found: dict[str, tuple[float, int]] = {}
    linear = {s.atoms[-1]: s.evidence - alone.evidence for s in scored if len(s.atoms) > len(lead)}
    for k, gain in linear.items():
        if not words.fits(at.shooting.arm, k, lead):
            continue
        at_size = starts[k].gain if k in starts else -np.inf
        name, best = words.atoms[k].name, max(gain, at_size)
        if best > worth and best > found.get(name, (-np.inf, k))[0]:
            found[name] = best, k
    ranked = sorted(found.values(), reverse=True)[:most]
    leading = [k for gain, k in ranked if gain >= FAINTLY * ranked[0][0]]

    def begin(k: int) -> Fitted:
        start = None
        if k in starts and starts[k].gain > linear[k]:
            start = starts[k].point
        return begun(at, words, (*lead, k), alone.at.s, start)

    return together(begin, leading)


def _race(field: list[Fitted], words: Dictionary, sizes: tuple[int, ...], say: Callable[[str], None]) -> list[Fitted]:
    """Fit all of ``field``, which is used up, in rounds, and drop the hypotheses that trail far behind; the best
    first."""
    field[:], out = _parted(promising_first(field), FAINT, len(field))
    for number, most in enumerate((*sizes[1:], len(field)), 1):
        given = (field.pop(0) for _ in range(len(field)))  # each old fit frees its memory as soon as its step is done
        moved = promising_first(together(partial(_further, words, say, f"round {number} of {len(sizes)}"), given))
        if number == ALONE:
            moved, left_behind = keep_best_starts(moved)
            out += left_behind
        field, left = _parted(moved, TRAILING, most)
        out += left
        del moved
    best = [f for f, place in place_by_size(promising_first(field)) if not f.atoms or place < SETTLING]
    rest = [f for f in field if f not in best]
    hopeless = best[0].score.evidence - HOPELESS * best[0].excess
    rest += [f for f in best if f.score.evidence < hopeless]
    settled = together(lambda f: _on(f, words, LONGEST, 1.0), [f for f in best if f not in rest])
    return promising_first([*out, *rest, *settled])


def _parted(fits: list[Fitted], share: float, most: int) -> tuple[list[Fitted], list[Fitted]]:
    """Split fits, the best first, into those that go on and the others, without their columns. The null model goes on
    unless it is outdone. Of the others the first ``most`` go on that gain a ``share`` of the best one's gain or are
    close to it."""
    none, lead = next((f.score.evidence for f in fits if not f.atoms), -np.inf), fits[0]
    least = -np.inf
    if none > -np.inf:
        least = min(none + share * (lead.score.evidence - none), lead.score.evidence - CLOSE * lead.excess)

    def goes_on(place: int, fit: Fitted) -> bool:
        if not fit.atoms:
            return not _outdone(fit, lead)
        return place < most and fit.score.evidence >= least

    further = [f for f, place in place_by_size(fits) if goes_on(place, f)]
    return further, [f.bare() for f in fits if f not in further]


def _deserved(fits: list[Fitted]) -> list[Fitted]:
    """Drop the columns, and so the lead, of fits that have more effects than another one without the evidence to pay
    for them."""
    fewest = min((len(fit.atoms) for fit in fits if fit.atoms), default=0)
    if all(len(fit.atoms) in (0, fewest) for fit in fits):
        return fits
    excess = best_first(fits)[0].excess
    lead = max((fit for fit in fits if fit.whole), key=lambda fit: charge_effects(fit.score.evidence, fit, excess))
    return [fit if fit is lead or len(fit.atoms) <= fewest else fit.bare() for fit in fits]


def _outdone(none: Fitted, lead: Fitted) -> bool:
    """Tell whether the null model will leave many times the misfit of the best fit."""
    return none.clean - none.score.evidence > OUTDONE * max(lead.clean - lead.reached, lead.excess)


def _further(words: Dictionary, say: Callable[[str], None], when: str, fit: Fitted) -> Fitted:
    """Announce a step of a fit and take it."""
    say(f"fitting {' + '.join(fit.names) or 'none'}, {when}")
    return advanced(fit, words)


def _clean(fit: Fitted) -> bool:
    """Tell whether a fit leaves nothing for a large effect to explain."""
    return fit.score.at.s <= CLEAN[0] and fit.score.at.level <= CLEAN[1]


def _beside(at: Design, words: Dictionary, lead: Fitted) -> list[Fitted]:
    """Start the leader with one more effect: with those that promise most, with those at their nuisance bound, and with
    ripples of an order that the leader's residual shows. In a bent valley, the slope promises little of an effect at
    its bound."""
    full = chosen(at, words.focused(lead.atoms, every=True), lead.design)
    others = [k for k in range(len(words.atoms)) if words.atoms[k].name not in full.words.meant]
    hypotheses = [lead.atoms, *((*lead.atoms, k) for k in others)]
    scored = score(posteriors(full.linear(), full.words.spike, lead.score.at.s), full.words, hypotheses)
    starts = {}
    if not _clean(lead):
        starts = scan(full, full.words, lead.score)
    found = _promising(full, words, scored, starts, lead.atoms, FURTHER[0], WORTH * lead.excess)
    tried = {name for fit in found for name in fit.names}
    new = [k for k in _brimming(lead) if words.atoms[k].name not in tried]
    brimming = [k for k in new if words.fits(full.shooting.arm, k, lead.atoms)]
    late = [k for k in others if k >= len(at.words.atoms)]

    def begin(k: int) -> Fitted:
        start = None
        if k in late:
            start = put(full, words.atoms[k], {})
        return begun(full, words, (*lead.atoms, k), lead.score.at.s, start)

    return [*found, *together(begin, [*brimming[:MOST_BRIMMING], *late])]


def _brimming(lead: Fitted) -> list[int]:
    """List the candidates at the bound of a nuisance effect, the largest first."""
    words, mean = lead.design.words, lead.posterior[0]
    reach: dict[int, float] = {}
    for c, value in zip(words.columns, mean, strict=True):
        if c.atom >= 0 and words.atoms[c.atom].name not in words.meant:
            reach[c.atom] = max(reach.get(c.atom, 0.0), abs(float(value)) / c.spike)
    return [k for k in sorted(reach, key=lambda k: -reach[k]) if reach[k] >= BRIM]
