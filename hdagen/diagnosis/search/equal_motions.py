"""Sets of effects that move an arm as a fit does, by its mass matrix and its weight alone.

Links move an arm by a few sums of their numbers: a heavier link moves it as one whose mass lies farther out and whose
rotor is smaller. The linear model of a fit shows that for small changes; mass matrix and weight show it for large ones,
without a simulation.

Source: the sums are the base parameters of Gautier and Khalil, IEEE Trans. Robotics and Automation 6 (1990) 368.
Legend: θ parameters in typical sizes (P); y entries of M(q) and g(q) at poses of the log.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.gauss_newton import compute_hypothesis_widths, place_theta
from hdagen.diagnosis.inference.local_fit import Fit, start_fit_at
from hdagen.diagnosis.inference.sensitivities import OperatingPoint
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.prediction.measurement_model import read_joint_angles

_RANK_PRECISION = float(np.sqrt(np.finfo(float).eps))  # of the largest sum of numbers, below which a sum is none


@dataclass(frozen=True, eq=False)
class EqualMotion:
    """A set of effects with the point at which it moves the arm as another set does.

    Attributes:
        effects: places of the candidates.
        point: the point.
        cost: minus the log posterior of mass matrix, weight and θ, each charged for the number of effects.

    """

    effects: tuple[int, ...]
    point: OperatingPoint
    cost: float


def find_equal_motions(lead: Fit, words: CandidateSet) -> list[EqualMotion]:
    """Find sets that move the arm about as a fit does, with other numbers of links and rotors in place of its own.

    Args:
        lead: the fit, with its columns.
        words: all candidates.

    Returns:
        The most probable ones; none where the fit has no effect on mass matrix or weight.

    """
    motion = _ArmMotion(lead)
    acting = [k for k in motion.acting_candidates if words.members[k].has_default_shapes]
    own = [k for k in lead.effects if k in acting]
    if not own:
        return []
    rest = [k for k in lead.effects if k not in acting]
    limit = motion.find_set(lead.effects).cost + SEARCH.close_call_margin * lead.misfit_temperature
    sets = (some for count in range(len(own) + 1) for some in combinations(acting, count) if set(some) != {*own})
    arm, found = lead.sensitivities.shooting.arm, []
    for some in islice(sets, SEARCH.most_equal_motions_tried):
        atoms = tuple(sorted((*rest, *some)))
        if all(words.is_compatible(arm, k, [i for i in atoms if i != k]) for k in some):
            found.append(motion.find_set(atoms))
    close = sorted((one for one in found if one.cost <= limit), key=lambda one: one.cost)
    return close[: SEARCH.most_equal_motions]


def refit_at_point(point: OperatingPoint, fit: Fit, words: CandidateSet, atoms: tuple[int, ...]) -> Fit:
    """Start a hypothesis at a point.

    Args:
        point: the point.
        fit: the fit of another hypothesis.
        words: all candidates.
        atoms: places of the hypothesis' candidates.

    Returns:
        The fit before its first step.

    """
    return start_fit_at(fit.sensitivities.shooting, words, atoms, point, fit.score.posterior.s, fit.noise_only_evidence)


@dataclass(frozen=True, eq=False)
class _ArmMotion:
    """Mass matrix and weight about the point of a fit, and what its log says of them."""

    fit: Fit

    @cached_property
    def poses(self) -> Array:
        """Angles of the joints (poses, n)."""
        shooting = self.fit.sensitivities.shooting
        angles = read_joint_angles(shooting.arm, shooting.record.log)
        rows = np.linspace(0, len(angles) - 1, SEARCH.compared_poses).astype(int)
        return np.asarray(angles[rows])

    def compute_motion(self, p: Array) -> Array:
        """Compute y of parameters (np)."""
        arm = self.fit.sensitivities.shooting.arm.with_parameters(p)
        parts = (arm.evaluate("mass_matrix", q=self.poses)["M"], arm.evaluate("gravity_torque", q=self.poses)["g"])
        return np.concatenate([part.ravel() for part in parts])

    @cached_property
    def here(self) -> Array:
        """Y at the fit's point."""
        return self.compute_motion(self.fit.sensitivities.point.p)

    @cached_property
    def slopes(self) -> Array:
        """The change of y with each θ (y, P): exact where y is at most quadratic in it, as in numbers of links."""
        at, found = self.fit.sensitivities, []
        for c, width in zip(at.candidates.columns, at.candidates.spike_widths, strict=True):
            ends = []
            for theta in (width, -width):
                p = at.point.p.copy()
                p[c.index] += theta * c.unit
                ends.append(self.compute_motion(p))
            found.append((ends[0] - ends[1]) / (2.0 * width))
        return np.stack(found, axis=1)

    @cached_property
    def columns(self) -> NDArray[np.intp]:
        """Places of the columns that change y."""
        return np.flatnonzero(self.slopes.any(axis=0))

    @cached_property
    def acting_candidates(self) -> list[int]:
        """Places of the candidates that change y."""
        columns = self.fit.sensitivities.candidates.columns
        return sorted({columns[k].candidate for k in self.columns} - {-1})

    @cached_property
    def weights(self) -> Array:
        """Of each entry of y: |weights (y − y_0)|² / 2 is the log likelihood that the log takes away."""
        own, widths = self.columns, compute_hypothesis_widths(self.fit.sensitivities, self.fit.effects)
        covariance = self.fit.posterior[1][np.ix_(own, own)]
        told = np.linalg.pinv(covariance, hermitian=True) - np.diag(1.0 / widths[own] ** 2)
        values, vectors = np.linalg.eigh(0.5 * (told + told.T))
        return np.asarray(
            np.sqrt(np.maximum(values, 0.0))[:, None]
            * vectors.T
            @ np.linalg.pinv(self.slopes[:, own], rcond=_RANK_PRECISION)
        )

    @cached_property
    def weighted_slopes(self) -> Array:
        """The change of the weighted y with each θ that changes it."""
        return np.asarray(self.weights @ self.slopes[:, self.columns])

    def find_set(self, effects: tuple[int, ...]) -> EqualMotion:
        """Find the most probable point of a set at which y is as at the fit's point."""
        at, own = self.fit.sensitivities, self.columns
        words, theta = at.candidates.with_active(effects), at.candidates.to_theta(at.point.p)
        widths = compute_hypothesis_widths(at, effects)[own]
        low, high = (end[own] for end in words.theta_bounds(at.shooting.arm))
        slopes = np.vstack([self.weighted_slopes, np.diag(1.0 / widths)])

        def place(values: Array) -> OperatingPoint:
            moved = theta.copy()
            moved[own] = values
            return place_theta(at, moved, at.point.initial_states)

        def compute_residual(values: Array) -> Array:
            return np.concatenate([self.weights @ (self.compute_motion(place(values).p) - self.here), values / widths])

        values = np.clip(theta[own], low, high)
        residual = compute_residual(values)
        for _ in range(SEARCH.most_matching_steps):
            step = np.linalg.lstsq(slopes, -residual)[0]
            moved = np.clip(values + step, low, high)
            left = compute_residual(moved)
            if left @ left >= residual @ residual:
                break
            values, residual = moved, left
        cost = 0.5 * residual @ residual + SEARCH.effect_penalty * self.fit.misfit_temperature * len(effects)
        return EqualMotion(effects, place(values), float(cost))
