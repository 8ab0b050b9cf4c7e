"""The local fit of one hypothesis: Gauss-Newton steps, with the linear model computed again about each point.

Every hypothesis starts at the robot file's own numbers. From another hypothesis' optimum it would not find its own: the
base parameters have moved to replace the effects that the other one lacks, and a curved valley lies between.

Legend: θ parameters in typical sizes; s size of unexplained torque; κ noise scale of a window.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis.inference.candidate_priors import TOLERATED, Dictionary
from hdagen.diagnosis.inference.gauss_newton import ENOUGH, descend, move_to, prior_widths, try_point
from hdagen.diagnosis.inference.linear_gaussian import Summed
from hdagen.diagnosis.inference.marginal_likelihood import Posterior, Scored, laplace, posterior, posteriors
from hdagen.diagnosis.inference.multiple_shooting import Shooting
from hdagen.diagnosis.inference.sensitivities import TEMPERATURE, Design, Point, chosen, design, knots

FEW = 2  # a subset is evaluated if it has fewer effects than this, or lacks fewer than this
DEPENDENT = 100.0  # log evidence still to be gained, for each multiple of the least temperature
STIFF = 0.1  # of the unexplained torque, that a step allows first: all of it would replace the parameters' own change
LOUD = 2.0  # squared noise scale from which a step allows all of it first: no parameter explains most of the misfit


@dataclass(frozen=True, eq=False)
class Fitted:
    """A hypothesis at its present point, with the linear model and the score there."""

    atoms: tuple[int, ...]
    design: Design
    score: Scored
    unexplained: Array  # torque that it leaves unexplained at each joint (n), rms, in its unit
    clean: float  # log evidence that it would have with a residual of noise alone
    ahead: float  # part of its log evidence that only the linear model predicts, at a θ not yet reached
    stands: bool = False  # whether no further step helps
    kept: tuple[Summed, Mapping[tuple[int, ...], float]] | None = None  # summary of the columns, once they are dropped

    @property
    def whole(self) -> bool:
        """Whether the fit still has its columns."""
        return self.kept is None

    def bare(self) -> Fitted:
        """Return all that a decision needs of the fit, without the columns, which would fill the memory."""
        if self.kept:
            return self
        return replace(self, design=self.design.bare(), kept=(self._summed, self._overrated))

    @property
    def lesser(self) -> list[tuple[int, ...]]:
        """The hypothesis and its subsets. Each subset costs a simulation, so of many effects only sets that have nearly
        all or nearly none of them are listed."""
        many = len(self.atoms)
        counts = sorted({count for count in range(many + 1) if min(count, many - count) < FEW})
        return [some for count in counts for some in combinations(self.atoms, count)]

    @property
    def reached(self) -> float:
        """Log evidence at the present point; `score` adds the gain that the linear model predicts nearby."""
        return self.score.evidence - self.ahead

    def evidence(self, temperature: float, atoms: tuple[int, ...] | None = None) -> float:
        """Compute the log evidence of the hypothesis or of a subset at this point, where the effects left out become
        nuisance effects, as far as the linear model holds.

        Args:
            temperature: the likelihood counts as its root of this order.
            atoms: places of the subset's candidates; default: the whole hypothesis.

        Returns:
            The log evidence.

        """
        if atoms is None:
            atoms = self.atoms
        summed, overrated = self.kept or (self._summed, self._overrated)
        return self._worth(summed, atoms, temperature) - 0.5 * overrated[atoms] * TEMPERATURE / temperature

    def promised(self, atoms: tuple[int, ...]) -> float:
        """Predict the log evidence of any hypothesis by the linear model at this point.

        Args:
            atoms: places of its candidates.

        Returns:
            The log evidence.

        """
        return self._worth(self._summed, atoms, TEMPERATURE)

    def standing(self, atoms: tuple[int, ...]) -> Array:
        """Predict the optimum of any hypothesis by the linear model at this point.

        Args:
            atoms: places of its candidates.

        Returns:
            θ (P).

        """
        return self._without(self._summed, atoms, TEMPERATURE).mean

    def _worth(self, summed: Summed, atoms: tuple[int, ...], temperature: float) -> float:
        found, prior = self._without(summed, atoms, temperature), prior_widths(self.design, atoms)
        return found.worth(prior, self.design.words.own(atoms))

    def _without(self, summed: Summed, atoms: tuple[int, ...], temperature: float) -> Posterior:
        at, bounds = self.score.at, self.design.words.meaning(atoms).bounds(self.design.shooting.arm)
        return laplace(summed, prior_widths(self.design, atoms), at.s, at.kappa2, bounds, temperature)

    @cached_property
    def _summed(self) -> Summed:
        """Normal equations of its columns at its present point."""
        return self.design.linear().reduced(self.score.at.s).summed(self.score.at.kappa2)

    @cached_property
    def _overrated(self) -> dict[tuple[int, ...], float]:
        """Error of the linear model's prediction for each subset, in minus twice the log posterior: without a large
        effect, a model linearized about it does not hold."""
        found = {self.atoms: 2.0 * self.ahead}
        linear, s = self.design.linear(), self.score.at.s
        reduced = linear.reduced(s)
        for atoms in self.lesser[:-1]:
            theta, prior = self.standing(atoms), prior_widths(self.design, atoms)
            there = try_point(self.design, linear, s, move_to(self.design, linear, s, theta))[1]
            found[atoms] = max(there.cost(s, prior) - reduced.cost(theta, prior), 0.0)
        return found

    @property
    def temperature(self) -> float:
        """Temperature of the likelihood in a decision. Another model might explain the remaining misfit, so an effect
        must gain a share of it."""
        return TEMPERATURE * self.excess

    @property
    def excess(self) -> float:
        """That temperature in multiples of the least."""
        return max(1.0, (self.clean - self.reached) / DEPENDENT)

    @property
    def names(self) -> tuple[str, ...]:
        """The effects as name@joint, sorted; empty for none."""
        return self.design.words.names(self.atoms)

    @property
    def posterior(self) -> tuple[Array, Array]:
        """The most probable θ within its bounds, and its covariance."""
        return self.score.at.mean, self.score.at.covariance


def begun(at: Design, words: Dictionary, atoms: tuple[int, ...], near: float, start: Point | None = None) -> Fitted:
    """Start the fit of a hypothesis.

    Args:
        at: design with the columns to select from.
        words: all candidates.
        atoms: places of the hypothesis' candidates.
        near: size of unexplained torque to start from.
        start: where to linearize again; default: the point of ``at``, with the shapes of the hypothesis.

    Returns:
        The fit before its first step.

    """
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
    """Start a hypothesis with fewer effects at the point of a fit, with the others reduced to the largest nuisance
    size. From the robot file's numbers it may not have found this optimum.

    Args:
        fit: the fit of the larger hypothesis.
        words: all candidates.
        atoms: places of the smaller hypothesis' candidates.

    Returns:
        The fit before its first step.

    """
    p = fit.design.point.p.copy()
    for c in words.columns:
        if c.atom in fit.atoms and c.atom not in atoms:
            most = TOLERATED * c.spike * abs(c.unit)
            p[c.index] = min(max(p[c.index], c.center - most), c.center + most)
    point = Point(fit.design.shooting.arm.parameters.within(p), fit.design.point.begun)
    return _there(fit.design.shooting, words, atoms, point, fit.score.at.s, fit.clean)


def instead(fit: Fitted, words: Dictionary, atoms: tuple[int, ...]) -> Fitted:
    """Start a hypothesis where the linear model of a fit predicts its optimum. Look-alike effects have it there, and
    from the robot file's numbers the hypothesis may not have found it.

    Args:
        fit: the fit of another hypothesis.
        words: all candidates.
        atoms: places of the hypothesis' candidates.

    Returns:
        The fit before its first step.

    """
    at, arm, s = fit.design, fit.design.shooting.arm, fit.score.at.s
    point = move_to(at, at.linear(), s, fit.standing(atoms))
    for k in set(atoms) - set(fit.atoms):
        words.atoms[k].shape(arm, point.p)
    return _there(at.shooting, words, atoms, point, s, fit.clean)


def anew(start: Point, fit: Fitted, words: Dictionary, atoms: tuple[int, ...]) -> Fitted:
    """Start the effects of a fit at the base parameters of another point. Before all effects were in the hypothesis,
    the base parameters moved in their place, and may be stuck behind a valley.

    Args:
        start: the point with the base parameters.
        fit: the fit with the effects' parameters.
        words: all candidates.
        atoms: places of the effects' candidates.

    Returns:
        The fit before its first step.

    """
    p, names = start.p.copy(), list(fit.design.shooting.arm.parameters.described)
    for k in atoms:
        for name in (*words.atoms[k].amplitudes, *words.atoms[k].shapes):
            p[names.index(name)] = fit.design.point.p[names.index(name)]
    point = Point(p, fit.design.shooting.begun(p))
    return _there(fit.design.shooting, words, atoms, point, fit.score.at.s, fit.clean)


def again(fit: Fitted, words: Dictionary) -> Fitted:
    """Compute the dropped columns of a fit again at its present point.

    Args:
        fit: the fit without columns.
        words: all candidates.

    Returns:
        The fit with its columns.

    """
    return _there(fit.design.shooting, words, fit.atoms, fit.design.point, fit.score.at.s, fit.clean)


def sharing(fit: Fitted, share: float) -> Fitted:
    """Return a fit with another spike width of its inactive effects. Without columns, the fit's summary stands in for
    them.

    Args:
        fit: the fit.
        share: spike width in typical sizes.

    """
    at = fit.design.sharing(share)
    if fit.kept is None:
        return _scored(at, fit.atoms, fit.score.at.s)
    other = replace(fit, design=at, stands=False)
    found = other._without(fit.kept[0], fit.atoms, TEMPERATURE)
    evidence = found.worth(prior_widths(at, fit.atoms), at.words.own(fit.atoms))
    return replace(other, score=Scored(fit.atoms, evidence, found), clean=fit.clean + evidence - fit.score.evidence)


def advanced(fit: Fitted, words: Dictionary) -> Fitted:
    """Take one step and linearize again there: about another point the columns of nuisance effects give a wrong
    likelihood. A fit has converged where the linear model predicts no gain, where no step improves on the evidence
    reached, and where a step fails, which is counted.

    Args:
        fit: the fit; returned as it is if it has converged.
        words: all candidates.

    Returns:
        The fit after the step.

    """
    if fit.stands:
        return fit
    try:
        return _stepped(fit, words)
    except (PlantError, np.linalg.LinAlgError):
        fit.design.shooting.fail()
        return replace(fit, stands=True)


def _stepped(fit: Fitted, words: Dictionary) -> Fitted:
    """Take one step of a fit that has not converged."""
    if fit.ahead < ENOUGH * fit.excess:
        return replace(fit, stands=True)
    tried: list[Fitted] = []
    shares = [STIFF, 1.0]
    if fit.score.at.level > LOUD:
        shares.reverse()
    for share in shares:
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
    """Start a hypothesis at a point, with all its columns computed there."""
    return _scored(design(shooting, words.about(shooting.arm, atoms, point.p), point), atoms, near, clean)


def _scored(at: Design, atoms: tuple[int, ...], near: float, clean: float | None = None) -> Fitted:
    """Score a hypothesis in its linear model."""
    linear = at.linear()
    prior, bounds = prior_widths(at, atoms), at.words.bounds(at.shooting.arm)
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


def _by_joint(at: Design, torque: Array) -> Array:
    """Return the root mean square of torques (W, k) at each joint (n), at its motor and its link together."""
    arm = at.shooting.arm
    owners = np.repeat([*range(1, arm.n + 1), *arm.manifest["flexible"]], knots(at.shooting))
    return np.array([np.sqrt(np.mean(torque[:, owners == j] ** 2)) for j in range(1, arm.n + 1)])
