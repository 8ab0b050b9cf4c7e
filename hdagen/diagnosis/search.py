"""The search: all hypotheses in one linear model, then a race of those that lead, then what else the winners miss."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hdagen.diagnosis.candidates import Dictionary
from hdagen.diagnosis.design import Design, chosen, design
from hdagen.diagnosis.evidence import Scored, large, posteriors, score
from hdagen.diagnosis.first_look import first, likeliest
from hdagen.diagnosis.fitting import ENOUGH, Fitted, advanced, again, anew, begun, instead, lessened, sharing
from hdagen.diagnosis.orders import heard
from hdagen.diagnosis.regression_start import Regression, begin_sets
from hdagen.diagnosis.scan import Start, put, scan
from hdagen.diagnosis.shooting import Shooting
from hdagen.together import together

FIELD = (9, 5, 3)  # how many hypotheses beside none are in each round of the race
MOST = 3  # effects at once
FURTHER = (5, 3, 2)  # the same of further effects beside a leader
BRIM, MOST_BRIMMING = 2.5, 2  # standard deviations from which what is tolerated is as large as it may be; how many such
WORTH = 1.0  # temperatures of log evidence that a further effect must promise to be fitted
FAINTLY = 0.05  # of what the most promising one promises, below which it is not; what was named of 11 development logs
# promised 0.61 of it or more
DEAR = 5.0  # temperatures of log evidence that the prior of one more effect takes, or a little less
BARELY = 3.0  # of these, by which a larger set must lead to be gone on from: what is left to gain may be as much again
LONGEST = 3  # further steps at most, each for another temperature of log evidence
FEWER = 3  # rounds of what has fewer effects than the leader, or another one instead, from where that stands
ALIKE, MOST_ALIKE = 40.0, 3  # temperatures behind the leader, in its linear model, of what looks like it; how many such
SETTLING = 2  # how many hypotheses beside none go on
ALONE = 2  # round after which a set that began in two places goes on from the better one
TRAILING = 1 / 3  # of the leader's gain over none, below which a hypothesis is not fitted further
FAINT = 0.1  # the same before the first step
MUCH = 0.25  # of the log evidence that none lacks, that the best leaves, from where something else may stand for two
BEYOND = 0.85  # of the same, that the best leaves, from where no second effect is looked for: of 16 logs of two effects
# none left more than 0.76, of 12 of something unknown 7 did
LOST = 500.0  # that it must be at least, the likelihood being tempered
OUTDONE = 10.0  # times what the best leaves, that none leaves, from which on it is not fitted further
HOPELESS = 20.0  # temperatures behind the leader
CLOSE, MOST_CLOSE = 10.0, 4  # temperatures behind the best, within which nothing is decided yet; how many such
STEPS = 8  # that each of them goes on at most
CLEAN = 0.05, 1.02  # unexplained torque and noise scale below which no large effect is left to be found


Begin = tuple[Callable[[Fitted, Dictionary, tuple[int, ...]], Fitted], tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Search:
    """``fitted``: none, the leading effects and sets of them where they stand, the most probable first; ``screened``:
    every effect that the log could show in the linear model about the robot file's own numbers, the most probable
    first."""

    words: Dictionary
    fitted: tuple[Fitted, ...]
    screened: tuple[Scored, ...]


def search(shooting: Shooting, words: Dictionary, say: Callable[[str], None]) -> Search:
    """Every effect of ``words`` in one linear model about the robot file's numbers, and at several sizes; those that
    lead where they stand; then sets."""
    say(f"screening {len(words.atoms)} candidates")
    at = design(shooting, words, first(shooting, words))
    screened = _screened(at.whole())
    regression = Regression.of(shooting.arm, shooting.record, words)
    starts = scan(at, words, far=regression.far() if regression else {})
    at.gram.forget()
    none = next(s for s in screened if not s.atoms)
    field = [
        begun(at, words, (), none.at.s),
        *_promising(at, words, screened, starts, (), FIELD[0], WORTH),
        *(begin_sets(regression, at, none.at.s) if regression else []),
    ]
    return Search(words, tuple(raced(at, words, field, say)), tuple(screened))


def _screened(at: Design) -> list[Scored]:
    """None and every effect of which a channel shows anything, in the linear model, the most probable first."""
    silent, words, arm = at.silent(), at.words, at.shooting.arm
    singles = [(), *((k,) for k in range(len(words.atoms)) if k not in silent)]
    scored, spike = score(posteriors(at.linear(), words.spike), words, singles), words.spike

    def sized(one: Scored) -> Scored:
        bounds = words.meaning(one.atoms).bounds(arm)
        return replace(one, large=large(one.at, spike, words.free(one.atoms), words.counts(*one.atoms), bounds))

    return [sized(one) if one.atoms else one for one in scored]


def _shared(fitted: list[Fitted], words: Dictionary) -> tuple[list[Fitted], Dictionary]:
    """The same with all tolerated to the share that is the best's, and the words for that."""
    lead = first_whole(fitted)
    moved_to = likeliest(lead)
    share = moved_to.design.words.share
    if share == words.share:
        return fitted, words
    words = words.sharing(share)
    moved = _promising_first([moved_to if fit is lead else sharing(fit, share) for fit in fitted])
    further = [fit for fit in moved if not fit.atoms][:1] + [fit for fit in moved if fit.atoms and fit.whole][:SETTLING]
    gone = together(lambda fit: _on(fit, words, LONGEST, 1.0) if fit.whole else fit, further)
    return _promising_first([*(fit.bare() for fit in moved if fit not in further), *gone]), words


def raced(
    at: Design, words: Dictionary, field: list[Fitted], say: Callable[[str], None], least: float = -np.inf
) -> list[Fitted]:
    """The hypotheses of ``field``, which is used up, fitted, and those with one more effect beside the best as long as
    that gets better; the best first, the others without their columns. Where the best leaves much, one more effect is
    tried beside the next best, too: of two effects the one that seems the larger may be a third one that stands in for
    both. Nothing is tried beside what does not reach ``least`` log evidence."""
    fitted = _deserved(_race(field, words, FIELD, say))
    if _beyond(fitted) or best_first(fitted)[0].reached < least:
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
            fitted, words = _shared(_promising_first([*fitted, *_race(further, words, FURTHER, say)]), words)
        lead, stood = first_whole(fitted), next(f for f in fitted if f.atoms == before.atoms)
        if lead.reached < stood.reached + BARELY * stood.excess:
            lead = stood if stood.whole else lead
            break
        leads, fitted = [lead], bared(fitted)
    fewer = [atoms for atoms in lead.lesser[:-1] if len(atoms) in {0, len(lead.atoms) - 1}]
    fewer = [atoms for atoms in fewer if lead.promised(atoms) > lead.reached - ALIKE * lead.excess]
    begin = [*((lessened, atoms) for atoms in fewer), *((instead, atoms) for atoms in _alike(lead, fitted, words))]
    begin += [(partial(anew, at.point), lead.atoms)] if len(lead.atoms) > 1 else []
    return _contested([*fitted, *together(partial(_from, lead, words, say), begin)], words, say)


def _alike(lead: Fitted, fitted: Sequence[Fitted], words: Dictionary) -> list[tuple[int, ...]]:
    """Sets with another effect in the place of one of the lead's that promise nearly as much where it stands, and more
    than they came to where they were fitted, the most promising first; before them the lead's with a twin."""
    known: dict[tuple[str, ...], float] = {}
    for fit in fitted:
        known[fit.names] = max(fit.reached, known.get(fit.names, -np.inf))
    here = sorted({c.atom for c in lead.design.words.columns} - {-1, *lead.atoms})
    found = []
    for one in lead.atoms:
        rest = tuple(i for i in lead.atoms if i != one)
        alone = lead.promised(rest) + WORTH * lead.excess  # what says nothing promises as much as the rest does
        for k in (k for k in here if words.fits(lead.design.shooting.arm, k, rest)):
            twin = words.atoms[k].twin(words.atoms[one])
            promise = np.inf if twin else lead.promised((*rest, k))
            names = words.names((*rest, k))
            if promise > max(known.get(names, -np.inf), lead.reached - ALIKE * lead.excess, alone):
                found.append((promise, (*rest, k)))
    return [atoms for _, atoms in sorted(found, reverse=True)[:MOST_ALIKE]]


def _contested(fits: list[Fitted], words: Dictionary, say: Callable[[str], None]) -> list[Fitted]:
    """``fits``, which are used up, those that are close to the best each where it stands in the end: what is close is
    not decided by who was left on the way. The best first."""
    ordered = best_first(fits)
    excess = ordered[0].excess
    least = max(_charged(fit.reached, fit, excess) for fit in ordered) - CLOSE * excess
    best: dict[tuple[str, ...], Fitted] = {}  # each set where it is best
    for fit in ordered:
        if fit is ordered[0] or _charged(fit.score.evidence, fit, excess) >= least:
            best.setdefault(fit.names, fit)
    close = list(best.values())[:MOST_CLOSE]
    if len(close) < 2:
        return bared(ordered)
    say(f"going on with {', '.join(' + '.join(fit.names) or 'none' for fit in close)}")
    rest = [fit.bare() for fit in ordered if fit not in close]
    del ordered, best, fits[:]  # what is not close is let go of
    done = [fit.names for fit in close[1:] if fit.stands]  # the best is needed with its columns

    def in_the_end(fit: Fitted) -> Fitted:
        whole = fit if fit.whole or fit.names in done else again(fit, words)
        return _on(whole, words, STEPS, ENOUGH)

    stood = together(in_the_end, (close.pop(0) for _ in range(len(close))))
    return bared(best_first([*stood, *rest]))


def _charged(evidence: float, fit: Fitted, excess: float) -> float:
    """Log evidence less what the prior takes for the effects of a fit, in temperatures of so much ``excess``."""
    return evidence - DEAR * excess * len(fit.atoms)


def _on(fit: Fitted, words: Dictionary, steps: int, enough: float) -> Fitted:
    """A hypothesis that goes on for so many steps, as long as one brings ``enough`` temperatures of log evidence."""
    best, gain = fit, np.inf
    for _ in range(steps):
        before, fit = fit, advanced(fit, words)
        gain = max(fit.score.evidence - before.score.evidence, fit.reached - best.reached)
        best = max(best, fit, key=lambda one: one.reached)
        if gain < enough * best.excess:
            break
    # what came after where it is best brought next to nothing in the end, and would again
    return replace(best, stands=True) if best is not fit and gain < ENOUGH * best.excess else best


def _from(lead: Fitted, words: Dictionary, say: Callable[[str], None], begin: Begin) -> Fitted:
    """A hypothesis that begins where the lead stands; one that does not come close, without its columns: it ends where
    it would not, were each further step to bring what the last one did."""
    how, atoms = begin
    fit = how(lead, words, atoms)
    least = _charged(lead.reached, lead, lead.excess) - CLOSE * lead.excess
    for number in range(1, FEWER + 1):
        before = fit
        fit = _further(words, say, f"from {' + '.join(lead.names)}, round {number} of {FEWER}", before)
        gain = max(fit.score.evidence - before.score.evidence, fit.reached - before.reached)
        behind = least - _charged(fit.score.evidence, fit, lead.excess)
        if fit.reached < lead.reached and behind > gain * (FEWER - number):
            return fit.bare()
    return fit


def leaves_much(lead: Fitted, fitted: Sequence[Fitted]) -> bool:
    """Whether the best leaves much of what none does."""
    none = next((f for f in fitted if not f.atoms), lead)
    return lead.clean - lead.reached > MUCH * (none.clean - none.reached)


def _beyond(fitted: Sequence[Fitted]) -> bool:
    """Whether no effect tells anything of much that none leaves: then no two of what is known will, either."""
    best = best_first(fitted)[0]
    none = next((f for f in fitted if not f.atoms), best)
    return best.clean - best.reached > max(BEYOND * (none.clean - none.reached), LOST)


def _promising(
    at: Design,
    words: Dictionary,
    scored: Sequence[Scored],
    starts: dict[int, Start],
    lead: tuple[int, ...],
    most: int,
    worth: float,
) -> list[Fitted]:
    """The effects that promise most beside ``lead``, in the linear model or at one of their sizes, each begun there."""
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
        start = starts[k].point if k in starts and starts[k].gain > linear[k] else None
        return begun(at, words, (*lead, k), alone.at.s, start)

    return together(begin, leading)


def _race(field: list[Fitted], words: Dictionary, sizes: tuple[int, ...], say: Callable[[str], None]) -> list[Fitted]:
    """All of ``field``, which is used up, fitted, round after round, those that trail far behind not to the end; the
    best first."""
    field[:], out = _parted(_promising_first(field), FAINT, len(field))
    for number in range(1, len(sizes) + 1):
        given = (field.pop(0) for _ in range(len(field)))  # each is let go of as soon as it has moved
        moved = _promising_first(together(partial(_further, words, say, f"round {number} of {len(sizes)}"), given))
        if number == ALONE:
            moved, left_behind = _single(moved)
            out += left_behind
        field, left = _parted(moved, TRAILING, sizes[number] if number < len(sizes) else len(moved))
        out += left
        del moved
    best = [f for f, place in _placed(_promising_first(field)) if not f.atoms or place < SETTLING]
    rest = [f for f in field if f not in best]
    hopeless = best[0].score.evidence - HOPELESS * best[0].excess
    rest += [f for f in best if f.score.evidence < hopeless]
    settled = together(lambda f: _on(f, words, LONGEST, 1.0), [f for f in best if f not in rest])
    return _promising_first([*out, *rest, *settled])


def _single(fits: list[Fitted]) -> tuple[list[Fitted], list[Fitted]]:
    """Of each set the first of ``fits``; and the others, without their columns."""
    first: dict[tuple[str, ...], Fitted] = {}
    for fit in fits:
        first.setdefault(fit.names, fit)
    return list(first.values()), [fit.bare() for fit in fits if first[fit.names] is not fit]


def _parted(fits: list[Fitted], share: float, most: int) -> tuple[list[Fitted], list[Fitted]]:
    """Those of ``fits``, the best first, that are fitted further: none, unless it is outdone, and of the first so many
    who gain that share of what the best gains over none, or are close to it; and the others, without their columns."""
    none, lead = next((f.score.evidence for f in fits if not f.atoms), -np.inf), fits[0]
    trailing = none + share * (lead.score.evidence - none) if none > -np.inf else none
    least = min(trailing, lead.score.evidence - CLOSE * lead.excess)

    def goes_on(place: int, fit: Fitted) -> bool:
        return place < most and fit.score.evidence >= least if fit.atoms else not _outdone(fit, lead)

    further = [f for f, place in _placed(fits) if goes_on(place, f)]
    return further, [f.bare() for f in fits if f not in further]


def _placed(fits: Sequence[Fitted]) -> Iterator[tuple[Fitted, int]]:
    """Each fit with how many before it have as many effects, none counting as one: sets that begin by themselves take
    no place from what is alone."""
    before: Counter[int] = Counter()
    for fit in fits:
        yield fit, before[max(len(fit.atoms), 1)]
        before[max(len(fit.atoms), 1)] += 1


def _deserved(fits: list[Fitted]) -> list[Fitted]:
    """``fits``, those without their columns, and so no leaders, that have more effects than another one and are not as
    far ahead of it as the prior takes for them."""
    fewest = min((len(fit.atoms) for fit in fits if fit.atoms), default=0)
    if all(len(fit.atoms) in (0, fewest) for fit in fits):
        return fits
    excess = best_first(fits)[0].excess
    lead = max((fit for fit in fits if fit.whole), key=lambda fit: _charged(fit.score.evidence, fit, excess))
    return [fit if fit is lead or len(fit.atoms) <= fewest else fit.bare() for fit in fits]


def _outdone(none: Fitted, lead: Fitted) -> bool:
    """Whether none promises to leave many times what the best has reached: nothing more is to be learnt of it then."""
    return none.clean - none.score.evidence > OUTDONE * max(lead.clean - lead.reached, lead.excess)


def _further(words: Dictionary, say: Callable[[str], None], when: str, fit: Fitted) -> Fitted:
    say(f"fitting {' + '.join(fit.names) or 'none'}, {when}")
    return advanced(fit, words)


def _clean(fit: Fitted) -> bool:
    return fit.score.at.s <= CLEAN[0] and fit.score.at.level <= CLEAN[1]


def _beside(at: Design, words: Dictionary, lead: Fitted) -> list[Fitted]:
    """The lead with each further effect that promises most about it, begun there, and with those that stand in it as
    large as it tolerates: in a valley that bends, the slope promises little of them. Ripples of an order that was heard
    about a lead begin where that stands."""
    full = chosen(at, words.focused(lead.atoms, every=True), lead.design)
    others = [k for k in range(len(words.atoms)) if words.atoms[k].name not in full.words.meant]
    hypotheses = [lead.atoms, *((*lead.atoms, k) for k in others)]
    scored = score(posteriors(full.linear(), full.words.spike, lead.score.at.s), full.words, hypotheses)
    starts = {} if _clean(lead) else scan(full, full.words, lead.score)
    found = _promising(full, words, scored, starts, lead.atoms, FURTHER[0], WORTH * lead.excess)
    tried = {name for fit in found for name in fit.names}
    new = [k for k in _brimming(lead) if words.atoms[k].name not in tried]
    brimming = [k for k in new if words.fits(full.shooting.arm, k, lead.atoms)]
    late = [k for k in others if k >= len(at.words.atoms)]

    def begin(k: int) -> Fitted:
        start = put(full, words.atoms[k], {}) if k in late else None
        return begun(full, words, (*lead.atoms, k), lead.score.at.s, start)

    return [*found, *together(begin, [*brimming[:MOST_BRIMMING], *late])]


def _brimming(lead: Fitted) -> list[int]:
    """The atoms that are as large as the lead tolerates, the largest first."""
    words, mean = lead.design.words, lead.posterior[0]
    reach: dict[int, float] = {}
    for c, value in zip(words.columns, mean, strict=True):
        if c.atom >= 0 and words.atoms[c.atom].name not in words.meant:
            reach[c.atom] = max(reach.get(c.atom, 0.0), abs(float(value)) / c.spike)
    return [k for k in sorted(reach, key=lambda k: -reach[k]) if reach[k] >= BRIM]


def first_whole(fits: Sequence[Fitted]) -> Fitted:
    """The best that has its columns still: one that was better may have lost them on the way."""
    return next(fit for fit in fits if fit.whole)


def bared(fits: Sequence[Fitted]) -> list[Fitted]:
    """The best that is whole as it is, of the others only what a decision needs."""
    best = first_whole(fits)
    return [fit if fit is best else fit.bare() for fit in fits]


def _promising_first(fits: Sequence[Fitted]) -> list[Fitted]:
    """On their way, by what the next step may reach."""
    return sorted(fits, key=lambda f: -f.score.evidence)


def best_first(fits: Sequence[Fitted]) -> list[Fitted]:
    """In the end, by what they have reached."""
    return sorted(fits, key=lambda f: -f.reached)
