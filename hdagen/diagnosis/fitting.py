"""A hypothesis where it stands: Newton's steps in the linear model, which is made anew about each point.

Every hypothesis begins at the robot file's own numbers. From the best fit of another it would not find its own: what
the other bent base parameters by lies behind a curved valley.

Source: Marquardt, J. Soc. Indust. Appl. Math. 11 (1963) 431 (steps held near, so far as the linear model holds).
Legend: θ parameters in usual sizes; s size of unexplained torque; κ scale of what a window leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hdagen.diagnosis.candidates import SLAB, TOLERATED, Dictionary, is_broad
from hdagen.diagnosis.design import TEMPERATURE, Design, Point, chosen, design, knots
from hdagen.diagnosis.evidence import Posterior, Scored, laplace, posterior, posteriors, settled
from hdagen.diagnosis.linear import Linear, Summed
from hdagen.diagnosis.shooting import Shooting
from hdagen.plant import Array, PlantError

FEW = 2  # effects, so few less than all of a set, or so few alone, are looked at
DEPENDENT = 100.0  # of the log evidence that is still to be gained, what an effect must bring as its unit
STIFF = 0.1  # of the unexplained torque where a hypothesis stands, that its steps allow first: the whole of it would
# answer for what the parameters still lack
LOUD = 2.0  # scale of the noise, squared, from which the whole comes first: much is left then that no parameter answers
CHORDS = 3
REACHES = (np.inf, 0.3, 0.1, 0.03)  # prior standard deviations about where it stands, to which a step is held
KEPT = 0.25  # of what a step promises in the linear model, from which it is far short enough
WORSE = 4.0  # by which chi² of a window may grow before its first state is taken back
FAR = 2.0  # of what noise leaves of a window in the mean, from which it is
ENOUGH = 0.1  # of log evidence that a step must bring, or promise, for another one


@dataclass(frozen=True, eq=False)
class Fitted:
    """A hypothesis where it stands: its design, and its score there."""

    atoms: tuple[int, ...]
    design: Design
    score: Scored
    unexplained: Array  # torque that it leaves unexplained at each joint (n), rms, in its unit
    clean: float  # log evidence that it would have if it left noise alone
    ahead: float  # of its log evidence, what only the linear model promises: where its most probable θ is not yet
    stands: bool = False  # whether no further step helps
    kept: tuple[Summed, Mapping[tuple[int, ...], float]] | None = None  # of one without its columns: what they told

    @property
    def whole(self) -> bool:
        """Whether it has its columns still."""
        return self.kept is None

    def bare(self) -> Fitted:
        """What a decision needs of it, without the columns, which would fill the memory."""
        return self if self.kept else replace(self, design=self.design.bare(), kept=(self._summed, self._overrated))

    @property
    def lesser(self) -> list[tuple[int, ...]]:
        """Its own atoms, and those of the hypotheses that have fewer of them; of a set of many, as each costs a
        simulation, those that have next to all or next to none."""
        many = len(self.atoms)
        counts = sorted({count for count in range(many + 1) if min(count, many - count) < FEW})
        return [some for count in counts for some in combinations(self.atoms, count)]

    @property
    def reached(self) -> float:
        """Log evidence that it has where it is; `score` has what its linear model promises nearby, which the next step
        comes to or not."""
        return self.score.evidence - self.ahead

    def evidence(self, temperature: float, atoms: tuple[int, ...] | None = None) -> float:
        """Log evidence where the likelihood counts as its root of order ``temperature``; of the hypothesis with some of
        its ``atoms`` where this one stands, the others being tolerated there: it could stand there, too, as far as the
        linear model holds."""
        atoms = self.atoms if atoms is None else atoms
        summed, overrated = self.kept or (self._summed, self._overrated)
        return self._worth(summed, atoms, temperature) - 0.5 * overrated[atoms] * TEMPERATURE / temperature

    def promised(self, atoms: tuple[int, ...]) -> float:
        """Log evidence of a hypothesis with any ``atoms``, in the linear model where this one stands."""
        return self._worth(self._summed, atoms, TEMPERATURE)

    def standing(self, atoms: tuple[int, ...]) -> Array:
        """The θ of that hypothesis there (P)."""
        return self._without(self._summed, atoms, TEMPERATURE).mean

    def _worth(self, summed: Summed, atoms: tuple[int, ...], temperature: float) -> float:
        found, prior = self._without(summed, atoms, temperature), _prior(self.design, atoms)
        return found.worth(prior, self.design.words.own(atoms))

    def _without(self, summed: Summed, atoms: tuple[int, ...], temperature: float) -> Posterior:
        at, bounds = self.score.at, self.design.words.meaning(atoms).bounds(self.design.shooting.arm)
        return laplace(summed, _prior(self.design, atoms), at.s, at.kappa2, bounds, temperature)

    @cached_property
    def _summed(self) -> Summed:
        """What its columns tell, where it stands."""
        return self.design.linear().reduced(self.score.at.s).summed(self.score.at.kappa2)

    @cached_property
    def _overrated(self) -> dict[tuple[int, ...], float]:
        """By how much the linear model promises too little of minus twice the log posterior where a hypothesis with
        fewer atoms would stand: without what is large it is no model of theirs."""
        found = {self.atoms: 2.0 * self.ahead}
        linear, s = self.design.linear(), self.score.at.s
        reduced = linear.reduced(s)
        for atoms in self.lesser[:-1]:
            theta, prior = self.standing(atoms), _prior(self.design, atoms)
            there = _tried(self.design, linear, s, _moved(self.design, linear, s, theta))[1]
            found[atoms] = max(there.cost(s, prior) - reduced.cost(theta, prior), 0.0)
        return found

    @property
    def temperature(self) -> float:
        """The root of the likelihood that a decision counts: what this one still leaves would be worth as much to a
        better one, so an effect must bring a share of that."""
        return TEMPERATURE * self.excess

    @property
    def excess(self) -> float:
        """That root in multiples of the least."""
        return max(1.0, (self.clean - self.reached) / DEPENDENT)

    @property
    def names(self) -> tuple[str, ...]:
        """Its effects as name@joint, sorted; empty for none."""
        return self.design.words.names(self.atoms)

    @property
    def posterior(self) -> tuple[Array, Array]:
        """The most probable θ within its bounds, and the covariance."""
        return self.score.at.mean, self.score.at.covariance


def begun(at: Design, words: Dictionary, atoms: tuple[int, ...], near: float, start: Point | None = None) -> Fitted:
    """A hypothesis in the columns of ``at``, at its point with the shapes where its atoms have them; or at ``start``,
    with columns made anew there. ``near``: a size of unexplained torque to begin from."""
    if start is not None:
        return _there(at.shooting, words, atoms, start, near)
    own = chosen(at, words.focused(atoms))
    p = at.point.p.copy()
    for k in atoms:
        words.atoms[k].shape(at.shooting.arm, p)
    if not np.array_equal(p, at.point.p):
        own.point = Point(p, at.point.begun)
    return _scored(own, atoms, near)


def lessened(fit: Fitted, words: Dictionary, atoms: tuple[int, ...]) -> Fitted:
    """The hypothesis with some of a fit's atoms, begun where that stands, the others at what is tolerated of them: it
    could stand there, too, and about its own numbers it may not have found it."""
    p = fit.design.point.p.copy()
    for c in words.columns:
        if c.atom in fit.atoms and c.atom not in atoms:
            most = TOLERATED * c.spike * abs(c.unit)
            p[c.index] = min(max(p[c.index], c.center - most), c.center + most)
    point = Point(fit.design.shooting.arm.parameters.within(p), fit.design.point.begun)
    return _there(fit.design.shooting, words, atoms, point, fit.score.at.s, fit.clean)


def instead(fit: Fitted, words: Dictionary, atoms: tuple[int, ...]) -> Fitted:
    """The hypothesis with these atoms, begun where the linear model about a fit has it: what looks alike lies there,
    and about its own numbers it may not have found it."""
    at, arm, s = fit.design, fit.design.shooting.arm, fit.score.at.s
    point = _moved(at, at.linear(), s, fit.standing(atoms))
    for k in set(atoms) - set(fit.atoms):
        words.atoms[k].shape(arm, point.p)
    return _there(at.shooting, words, atoms, point, s, fit.clean)


def anew(start: Point, fit: Fitted, words: Dictionary, atoms: tuple[int, ...]) -> Fitted:
    """The hypothesis with these atoms of a fit as they are there and all else as it is at ``start``: what was fitted
    before they were all there bent the robot file's numbers in their place, and may have left them behind a valley."""
    p, names = start.p.copy(), list(fit.design.shooting.arm.parameters.described)
    for k in atoms:
        for name in (*words.atoms[k].amplitudes, *words.atoms[k].shapes):
            p[names.index(name)] = fit.design.point.p[names.index(name)]
    point = Point(p, fit.design.shooting.begun(p))
    return _there(fit.design.shooting, words, atoms, point, fit.score.at.s, fit.clean)


def again(fit: Fitted, words: Dictionary) -> Fitted:
    """A hypothesis whose columns were let go of, with all of them, where it is."""
    return _there(fit.design.shooting, words, fit.atoms, fit.design.point, fit.score.at.s, fit.clean)


def sharing(fit: Fitted, share: float) -> Fitted:
    """A hypothesis where it is, what it does not mean tolerated to another share: of one without its columns what they
    told, and what it lacks is the same."""
    at = fit.design.sharing(share)
    if fit.kept is None:
        return _scored(at, fit.atoms, fit.score.at.s)
    other = replace(fit, design=at, stands=False)
    found = other._without(fit.kept[0], fit.atoms, TEMPERATURE)
    evidence = found.worth(_prior(at, fit.atoms), at.words.own(fit.atoms))
    return replace(other, score=Scored(fit.atoms, evidence, found), clean=fit.clean + evidence - fit.score.evidence)


def advanced(fit: Fitted, words: Dictionary) -> Fitted:
    """A hypothesis one step further, its columns made anew there: about another point those of what is tolerated tell
    it a likelihood that is not its own. One that stands is left as it is; it stands where its linear model promises no
    more, where no step makes it better than what it has reached, and where a step fails, which is counted."""
    if fit.stands:
        return fit
    try:
        return _stepped(fit, words)
    except (PlantError, np.linalg.LinAlgError):
        fit.design.shooting.fail()
        return replace(fit, stands=True)


def _stepped(fit: Fitted, words: Dictionary) -> Fitted:
    """`advanced` of one that does not stand yet."""
    if fit.ahead < ENOUGH * fit.excess:
        return replace(fit, stands=True)
    tried: list[Fitted] = []
    for share in (1.0, STIFF) if fit.score.at.level > LOUD else (STIFF, 1.0):
        there = descend(fit.design, fit.atoms, fit.score, share)
        if there is not fit.design:
            there.gram.forget()
            tried.append(_there(there.shooting, words, fit.atoms, there.point, fit.score.at.s, fit.clean))
            if tried[-1].score.evidence >= fit.score.evidence + ENOUGH * fit.excess:
                break
    best = max(tried, key=lambda one: one.score.evidence, default=fit)
    gain = best.score.evidence - fit.score.evidence
    if best is fit or best.score.evidence <= fit.reached:
        fit.design.gram.forget()
        return replace(fit, stands=True)
    return replace(best, stands=abs(gain) < ENOUGH * fit.excess)


def _there(
    shooting: Shooting, words: Dictionary, atoms: tuple[int, ...], point: Point, near: float, clean: float | None = None
) -> Fitted:
    """The hypothesis at a point, all its columns made anew there."""
    return _scored(design(shooting, words.about(shooting.arm, atoms, point.p), point), atoms, near, clean)


def _scored(at: Design, atoms: tuple[int, ...], near: float, clean: float | None = None) -> Fitted:
    linear = at.linear()
    prior, bounds = _prior(at, atoms), at.words.bounds(at.shooting.arm)
    found = posteriors(linear, prior, near, bounds)
    best = max(found, key=lambda one: one.evidence)
    torque, own = linear.inner(best.s, best.mean)[1], at.words.own(atoms)
    if clean is None:
        nothing, noise = linear.reduced(0.0), np.ones(len(linear.rows))
        exact = posterior(nothing, prior, 0.0, noise, bounds)
        left = nothing.cost(exact.mean, prior, noise) - nothing.freedom.sum() / linear.temperature
        clean = exact.worth(prior, own) + 0.5 * left
    reduced = linear.reduced(best.s)
    ahead = 0.5 * max(linear.cost(best.s, prior) - reduced.cost(best.mean, prior), 0.0)
    linear.gram.forget()
    return Fitted(atoms, at, Scored(atoms, best.worth(prior, own), best), _by_joint(at, torque), clean, ahead)


def _prior(at: Design, atoms: tuple[int, ...]) -> Array:
    """Standard deviations of θ (P) with the effects of a hypothesis free."""
    return widths(at, at.words.free(atoms), at.point)


def widths(at: Design, free: NDArray[np.intp], point: Point) -> Array:
    """Standard deviations of θ (P) at ``point`` with the columns ``free``: of what comes in all orders of magnitude as
    wide as it is large, if that is more than usual."""
    prior = at.words.spike
    described = list(at.shooting.arm.parameters.described.values())
    broad = np.array([is_broad(described[at.words.columns[k].index]) for k in free], bool)
    prior[free] = np.where(broad, np.maximum(np.abs(at.words.theta(point.p)[free]), SLAB), SLAB)
    return prior


def _by_joint(at: Design, torque: Array) -> Array:
    """Root mean square of torques (W, k) at each joint (n), at its motor and its link together."""
    arm = at.shooting.arm
    owners = np.repeat([*range(1, arm.n + 1), *arm.manifest["flexible"]], knots(at.shooting))
    return np.array([np.sqrt(np.mean(torque[:, owners == j] ** 2)) for j in range(1, arm.n + 1)])


def descend(at: Design, atoms: tuple[int, ...], lead: Scored, share: float) -> Design:
    """Newton's steps with the columns kept, towards the most probable point of a hypothesis, each as far as the linear
    model holds: what it tells only roughly is a valley, along which a whole step would fly. With ``share`` of the
    torque unexplained that it leaves where it stands."""
    words, s, prior = at.words, share * lead.at.s, _prior(at, atoms)
    at = _freed(at, s)
    bounds, linear = words.bounds(at.shooting.arm), at.linear()
    cost = linear.cost(s, prior)
    for _ in range(CHORDS):
        best = cost, at, linear
        for reach in REACHES:
            theta = settled(linear, prior, s, bounds, reach).mean
            promised = cost - linear.reduced(s).cost(theta, prior)
            trial, there = _tried(at, linear, s, _moved(at, linear, s, theta))
            value = there.cost(s, prior)
            worse = best[0] <= value
            if not worse:
                best = value, trial, there
            if cost - value >= KEPT * promised or (worse and best[1] is not at):
                break
        gain, (cost, at, linear) = cost - best[0], best
        if gain < ENOUGH:
            break
    return at


def _freed(at: Design, s: float) -> Design:
    """The same with those windows begun anew where the encoders say that are far off, if that is better: a first state
    on the wrong side of a reversal, or of play, is not left by small steps."""
    linear = at.linear()
    kept, left = at.shooting.record.kept, linear.chi2(s)
    far = left > FAR * linear.reduced(s).freedom
    if not far.any():
        return at
    begun = at.point.begun.copy()
    begun[kept[far]] = at.shooting.begun(at.point.p)[kept[far]]
    again = at.moved(at.point.with_begun(begun)).linear()
    stays = again.chi2(s) > left - WORSE
    begun[kept[stays]] = at.point.begun[kept[stays]]
    return at.moved(at.point.with_begun(begun)) if (far & ~stays).any() else at


def _moved(at: Design, linear: Linear, s: float, theta: Array) -> Point:
    """The point at θ, each window beginning where that goes best with it."""
    begun = at.point.begun.copy()
    begun[at.shooting.record.kept] += linear.inner(s, theta)[0]
    return placed(at, theta, begun)


def _tried(at: Design, linear: Linear, s: float, point: Point) -> tuple[Design, Linear]:
    """The model at ``point``, windows that its first states make worse with those of ``at``: from where a joint
    sticks, or flies apart, their columns say little."""
    trial = at.moved(point)
    there = trial.linear()
    left = [one.chi2(s) for one in (linear, there)]
    worse = at.shooting.record.kept[left[1] > left[0] + WORSE]
    if not len(worse):
        return trial, there
    begun = point.begun.copy()
    begun[worse] = at.point.begun[worse]
    trial = at.moved(trial.point.with_begun(begun))
    return trial, trial.linear()


def placed(at: Design, theta: Array, begun: Array) -> Point:
    """The point at θ within the bounds. What is not meant moves too: what is tolerated of an effect may be far above
    the noise, and its column tells it only roughly."""
    p = at.point.p.copy()
    for value, c in zip(theta, at.words.columns, strict=True):
        p[c.index] = c.center + float(value) * c.unit
    return Point(at.shooting.arm.parameters.within(p), begun)
