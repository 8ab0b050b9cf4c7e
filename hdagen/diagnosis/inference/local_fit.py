"""The local fit of one hypothesis: its point, the linear model and the score there, and where it starts.

Every hypothesis starts at the robot file's own numbers. From another hypothesis' optimum it would not find its own: the
base parameters have moved to replace the effects that the other one lacks, and a curved valley lies between.

Legend: θ parameters in typical sizes; s size of unexplained torque; κ noise scale of a window.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.fit_settings import FIT
from hdagen.diagnosis.inference.gauss_newton import compute_hypothesis_widths, move_to_theta, try_point
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.inference.linear_gaussian import TotalNormalEquations
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.marginal_likelihood import (
    Posterior,
    ScoredHypothesis,
    apply_laplace,
    compute_posteriors,
    solve_at_scales,
)
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import (
    OperatingPoint,
    Sensitivities,
    count_torque_steps,
    measure_input_noise,
    select_columns,
)


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis at its present point, with the linear model and the score there."""

    effects: tuple[int, ...]
    sensitivities: Sensitivities
    score: ScoredHypothesis
    unexplained_torque: Array  # torque that it leaves unexplained at each joint (n), rms, in its unit
    noise_only_evidence: float  # log evidence that it would have with a residual of noise alone
    predicted_gain: float  # part of its log evidence that only the linear model predicts, at a θ not yet reached
    has_converged: bool = False  # whether no further step helps
    summary: tuple[TotalNormalEquations, Mapping[tuple[int, ...], float]] | None = (
        None  # summary of the columns, once they are dropped
    )

    @property
    def has_kept_columns(self) -> bool:
        """Whether its columns of nuisance effects are, or were, those of an earlier point."""
        return self.sensitivities.torques_of_nuisance is not None

    @property
    def has_columns(self) -> bool:
        """Whether the fit still has its columns."""
        return self.summary is None

    def without_columns(self) -> Fit:
        """Return all that a decision needs of the fit, without the columns, which would fill the memory."""
        if self.summary:
            return self
        return replace(
            self,
            sensitivities=self.sensitivities.without_columns(),
            summary=(self._total_equations, self._prediction_errors),
        )

    @property
    def subsets(self) -> list[tuple[int, ...]]:
        """The hypothesis and its subsets. Each subset costs a simulation, so of many effects only sets that have nearly
        all or nearly none of them are listed."""
        many = len(self.effects)
        counts = sorted({count for count in range(many + 1) if min(count, many - count) < FIT.subset_margin})
        return [some for count in counts for some in combinations(self.effects, count)]

    @property
    def evidence_here(self) -> float:
        """Log evidence at the present point; `score` adds the gain that the linear model predicts nearby."""
        return self.score.evidence - self.predicted_gain

    def tempered_evidence(self, temperature: float, atoms: tuple[int, ...] | None = None) -> float:
        """Compute the log evidence of the hypothesis or of a subset at this point, where the effects left out become
        nuisance effects, as far as the linear model holds.

        Args:
            temperature: the likelihood counts as its root of this order.
            atoms: places of the subset's candidates; default: the whole hypothesis.

        Returns:
            The log evidence.

        """
        if atoms is None:
            atoms = self.effects
        summed, overrated = self.summary or (self._total_equations, self._prediction_errors)
        return (
            self._evidence_of(summed, atoms, temperature)
            - 0.5 * overrated[atoms] * LIKELIHOOD.likelihood_temperature / temperature
        )

    def predicted_evidence(self, atoms: tuple[int, ...]) -> float:
        """Predict the log evidence of any hypothesis by the linear model at this point.

        Args:
            atoms: places of its candidates.

        Returns:
            The log evidence.

        """
        return self._evidence_of(self._total_equations, atoms, LIKELIHOOD.likelihood_temperature)

    def optimum_with(self, atoms: tuple[int, ...]) -> Array:
        """Predict the optimum of any hypothesis by the linear model at this point.

        Args:
            atoms: places of its candidates.

        Returns:
            θ (P).

        """
        return self._posterior_of(self._total_equations, atoms, LIKELIHOOD.likelihood_temperature).mean

    def evidence_with_widths(self, columns: Sequence[int], widths: Sequence[float]) -> float:
        """Predict the log evidence of the hypothesis with wider priors of some columns by the linear model.

        Args:
            columns: places of the columns, which then have no bounds.
            widths: their prior standard deviations.

        Returns:
            The log evidence, in which these columns pay Occam's factor, too.

        """
        own, prior = np.array(columns, int), compute_hypothesis_widths(self.sensitivities, self.effects)
        low, high = self.sensitivities.candidates.theta_bounds(self.sensitivities.shooting.arm)
        prior[own], low[own], high[own] = widths, -np.inf, np.inf
        summed, at = self.summary[0] if self.summary else self._total_equations, self.score.posterior
        found = apply_laplace(summed, prior, at.s, at.kappa2, (low, high), LIKELIHOOD.likelihood_temperature)
        paying = np.union1d(own, self.sensitivities.candidates.hypothesis_columns(self.effects))
        return found.evidence_paid_by(prior, paying)

    def _evidence_of(self, summed: TotalNormalEquations, atoms: tuple[int, ...], temperature: float) -> float:
        found, prior = (
            self._posterior_of(summed, atoms, temperature),
            compute_hypothesis_widths(self.sensitivities, atoms),
        )
        return found.evidence_paid_by(prior, self.sensitivities.candidates.hypothesis_columns(atoms))

    def _posterior_of(self, summed: TotalNormalEquations, atoms: tuple[int, ...], temperature: float) -> Posterior:
        at, bounds = (
            self.score.posterior,
            self.sensitivities.candidates.with_active(atoms).theta_bounds(self.sensitivities.shooting.arm),
        )
        return apply_laplace(
            summed, compute_hypothesis_widths(self.sensitivities, atoms), at.s, at.kappa2, bounds, temperature
        )

    @cached_property
    def _total_equations(self) -> TotalNormalEquations:
        """Normal equations of its columns at its present point."""
        return (
            self.sensitivities.linear_model()
            .normal_equations(self.score.posterior.s)
            .sum_windows(self.score.posterior.kappa2)
        )

    @cached_property
    def _prediction_errors(self) -> dict[tuple[int, ...], float]:
        """Error of the linear model's prediction for each subset, in minus twice the log posterior: without a large
        effect, a model linearized about it does not hold."""
        found = {self.effects: 2.0 * self.predicted_gain}
        linear, s = self.sensitivities.linear_model(), self.score.posterior.s
        reduced = linear.normal_equations(s)
        for atoms in self.subsets[:-1]:
            theta, prior = self.optimum_with(atoms), compute_hypothesis_widths(self.sensitivities, atoms)
            there = try_point(self.sensitivities, linear, s, move_to_theta(self.sensitivities, linear, s, theta))[1]
            found[atoms] = max(there.cost(s, prior) - reduced.cost(theta, prior), 0.0)
        return found

    @property
    def temperature(self) -> float:
        """Temperature of the likelihood in a decision. Another model might explain the remaining misfit, so an effect
        must gain a share of it."""
        return LIKELIHOOD.likelihood_temperature * self.misfit_temperature

    @property
    def misfit(self) -> float:
        """Log evidence that is left at the present point: what a residual of noise alone would add."""
        return self.noise_only_evidence - self.evidence_here

    @property
    def misfit_temperature(self) -> float:
        """That temperature in multiples of the least."""
        return max(1.0, self.misfit / FIT.misfit_of_temperature)

    @property
    def names(self) -> tuple[str, ...]:
        """The effects as name@joint, sorted; empty for none."""
        return self.sensitivities.candidates.names_of(self.effects)

    @property
    def posterior(self) -> tuple[Array, Array]:
        """The most probable θ within its bounds, and its covariance."""
        return self.score.posterior.mean, self.score.posterior.covariance


def start_fit(
    at: Sensitivities, words: CandidateSet, atoms: tuple[int, ...], near: float, start: OperatingPoint | None = None
) -> Fit:
    """Start the fit of a hypothesis.

    Args:
        at: design with the columns to select from.
        words: all candidates.
        atoms: places of the hypothesis' candidates.
        near: size of unexplained torque to start from.
        start: where to linearize again, with the nuisance columns of ``at`` kept; default: the point of ``at``, with
            the shapes of the hypothesis.

    Returns:
        The fit before its first step, without cross products until its turn.

    """
    if start is not None:
        begun = start_fit_at(at.shooting, words, atoms, start, near, beside=at)
        begun.sensitivities.drop_products()
        return begun
    own = select_columns(at, words.columns_for(atoms))
    p = at.point.p.copy()
    for k in atoms:
        words.members[k].apply_shapes(at.shooting.arm, p)
    if not np.array_equal(p, at.point.p):
        own.point = OperatingPoint(p, at.point.initial_states)
    begun = _score_fit(own, atoms, near)
    own.drop_products()
    return begun


def restore_columns(fit: Fit, words: CandidateSet) -> Fit:
    """Compute the columns of a fit at its present point, where they were dropped or kept from an earlier point.

    Args:
        fit: the fit.
        words: all candidates.

    Returns:
        The fit with all of its own columns; with those that it has, where the time of the diagnosis is up.

    """
    at = fit.sensitivities
    if fit.has_columns and (not fit.has_kept_columns or at.shooting.budget.is_up):
        return fit
    restored = start_fit_at(at.shooting, words, fit.effects, at.point, fit.score.posterior.s, fit.noise_only_evidence)
    return replace(restored, has_converged=fit.has_converged)


def rescale_spikes(fit: Fit, share: float) -> Fit:
    """Return a fit with another spike width of its inactive effects. Without columns, the fit's summary stands in for
    them.

    Args:
        fit: the fit.
        share: spike width in typical sizes.

    """
    at = fit.sensitivities.with_spike_scale(share)
    if fit.summary is None:
        return _score_fit(at, fit.effects, fit.score.posterior.s)
    other = replace(fit, sensitivities=at, has_converged=False)
    found = other._posterior_of(fit.summary[0], fit.effects, LIKELIHOOD.likelihood_temperature)
    evidence = found.evidence_paid_by(
        compute_hypothesis_widths(at, fit.effects), at.candidates.hypothesis_columns(fit.effects)
    )
    return replace(
        other,
        score=ScoredHypothesis(fit.effects, evidence, found),
        noise_only_evidence=fit.noise_only_evidence + evidence - fit.score.evidence,
    )


def start_fit_at(
    shooting: MultipleShooting,
    words: CandidateSet,
    atoms: tuple[int, ...],
    point: OperatingPoint,
    near: float,
    clean: float | None = None,
    beside: Sensitivities | None = None,
) -> Fit:
    """Start the fit of a hypothesis at a point, with its columns computed there.

    Args:
        shooting: the record and its model.
        words: all candidates.
        atoms: places of the hypothesis' candidates.
        point: where to linearize.
        near: size of unexplained torque to start from.
        clean: log evidence with a residual of noise alone; computed from the columns if it is not known.
        beside: sensitivities about a point near by, whose columns of nuisance effects are kept; None: every column is
            computed.

    Returns:
        The fit before its first step.

    """
    own = words.columns_near(shooting.arm, atoms, point.p)
    return _score_fit(compute_sensitivities(shooting, own, point, beside), atoms, near, clean)


def _score_fit(at: Sensitivities, atoms: tuple[int, ...], near: float, clean: float | None = None) -> Fit:
    """Score a hypothesis in its linear model."""
    linear = at.linear_model()
    prior, bounds = compute_hypothesis_widths(at, atoms), at.candidates.theta_bounds(at.shooting.arm)
    found = compute_posteriors(linear, prior, near, bounds)
    best = max(found, key=lambda one: one.evidence)
    torque, own = linear.solve_inner(best.s, best.mean)[1], at.candidates.hypothesis_columns(atoms)
    if clean is None:
        nothing, noise = linear.normal_equations(0.0), np.ones(len(linear.rows))
        exact = solve_at_scales(nothing, prior, 0.0, noise, bounds)
        left = nothing.cost(exact.mean, prior, noise) - nothing.degrees_of_freedom.sum() / linear.temperature
        clean = exact.evidence_paid_by(prior, own) + 0.5 * left
    reduced = linear.normal_equations(best.s)
    ahead = 0.5 * max(linear.cost(best.s, prior) - reduced.cost(best.mean, prior), 0.0)
    linear.cross_products.drop_caches()
    return Fit(
        atoms,
        at,
        ScoredHypothesis(atoms, best.evidence_paid_by(prior, own), best),
        _rms_by_joint(at, torque),
        clean,
        ahead,
    )


def _rms_by_joint(at: Sensitivities, torque: Array) -> Array:
    """Return the root mean square of torques (W, k) at each joint (n), at its motor and its link together. The noise of
    a measured input acts at the motor, is no torque of the machine, and is taken off."""
    arm, steps = at.shooting.arm, count_torque_steps(at.shooting)
    owners = np.repeat([*range(1, arm.n + 1), *arm.manifest["flexible"]], steps)
    squares = np.array([np.sum(torque[:, owners == j] ** 2) for j in range(1, arm.n + 1)])
    noise = len(torque) * steps * measure_input_noise(at.shooting) ** 2
    counts = len(torque) * np.array([np.sum(owners == j) for j in range(1, arm.n + 1)])
    return np.sqrt(np.maximum(squares - noise, 0.0) / counts)
