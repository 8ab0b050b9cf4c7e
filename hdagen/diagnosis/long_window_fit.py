"""Sizes of effects fitted to long windows: the cost of a set of effects, its optimum, and its cross-validated misfit.

The cost is

    W Σ_i log e_i² + Σ (θ / v)²,

e_i being the root mean square error of channel i over that of the model without any effect. θ are the sizes of the
named effects, in usual ones (v = 1), and those of the base parameters, in which v is their tolerance.

Legend: W windows, S sampled rows, M channels, L lanes, C columns of the dictionary, P of those free in a set of
effects; θ (C) is 0 but for these.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdagen.adoption.verdict import MOST_TOLERANCES
from hdagen.arm.arrays import Array
from hdagen.diagnosis.data.split import Mask
from hdagen.diagnosis.decision.direct_evidence_settings import DIRECT_EVIDENCE
from hdagen.diagnosis.inference.bounded_least_squares import solve_box_qp
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.long_horizon_settings import LONG_HORIZON
from hdagen.diagnosis.long_window_errors import LongWindowErrors


@dataclass(frozen=True, eq=False)
class EffectModel:
    """Effects (atoms of a dictionary) with sizes θ (C), their errors (S, M), and their cost."""

    atoms: tuple[int, ...]
    theta: Array
    errors: Array
    cost: float


@dataclass(frozen=True, eq=False)
class LongWindowFit:
    """Fits sets of effects among ``candidates`` to the ``errors`` of long windows."""

    errors: LongWindowErrors
    candidates: CandidateSet

    def limit_base_parameters(self, model: EffectModel) -> EffectModel:
        """Fit a model again with its base parameters only as far as a verdict may move them.

        Args:
            model: as it was found.

        Returns:
            The model with these bounds.

        """
        theta = model.theta.copy()
        free, wide = self._list_free_columns(model.atoms)
        base = [self.candidates.columns[k].candidate not in model.atoms for k in free]
        theta[free] = np.where(base, np.clip(theta[free], -MOST_TOLERANCES * wide, MOST_TOLERANCES * wide), theta[free])
        return self.fit_model(self.evaluate_model(model.atoms, theta), reach=MOST_TOLERANCES)

    def parameters_at(self, model: EffectModel) -> Array:
        """Place a model's sizes in the parameters.

        Args:
            model: with its sizes.

        Returns:
            The parameters (np,) in SI, within their bounds.

        """
        return self.place_sizes(model.atoms, model.theta)

    def place_sizes(self, atoms: Sequence[int], theta: Array) -> Array:
        """Place the sizes of effects in the parameters.

        Args:
            atoms: the effects.
            theta: sizes (C).

        Returns:
            The parameters (np,) in SI, within their bounds.

        """
        p, arm = self.errors.p.copy(), self.errors.shooting.arm
        described = list(arm.parameters.described.values())
        for k in atoms:
            self.candidates.members[k].apply_shapes(arm, p)
        for c, size in zip(self.candidates.columns, theta, strict=True):
            if size:
                q = described[c.index]
                p[c.index] = min(max(p[c.index] + float(size) * c.unit, q.low), q.high)
        return p

    def _list_free_columns(self, atoms: Sequence[int]) -> tuple[Array, Array]:
        """The free columns (P) of a model, and their prior standard deviations (P)."""
        free = [k for k, c in enumerate(self.candidates.columns) if c.in_every_hypothesis or c.candidate in atoms]
        wide = [
            CANDIDATES.slab_width
            if self.candidates.columns[k].candidate in atoms
            else self.candidates.columns[k].spike_width
            for k in free
        ]
        return np.array(free, int), np.array(wide)

    def compute_cost(
        self, atoms: Sequence[int], errors: Array, thetas: Array, rows: Mask | slice = slice(None)
    ) -> Array:
        """Compute the cost of errors.

        Args:
            atoms: the effects.
            errors: errors (L, S, M).
            thetas: sizes (L, C).
            rows: the sampled rows that count.

        Returns:
            The costs (L).

        """
        free, wide = self._list_free_columns(atoms)
        return np.asarray(self.errors.log_misfit(errors, rows) + ((thetas[:, free] / wide) ** 2).sum(1))

    def evaluate_model(self, atoms: tuple[int, ...], theta: Array) -> EffectModel:
        """Simulate effects of given sizes.

        Args:
            atoms: the effects.
            theta: their sizes (C).

        Returns:
            The model with its errors and its cost.

        """
        errors = self.errors.simulate_errors([self.place_sizes(atoms, theta)])
        return EffectModel(atoms, theta, errors[0], float(self.compute_cost(atoms, errors, theta[None])[0]))

    def differentiate_errors(self, model: EffectModel) -> Array:
        """Differentiate the errors of a model by its free sizes.

        Args:
            model: the model.

        Returns:
            Derivatives (P, S, M).

        """
        free, wide = self._list_free_columns(model.atoms)
        steps = np.zeros((len(free), len(model.theta)))
        steps[range(len(free)), free] = LONG_HORIZON.difference_step * wide * np.where(model.theta[free] < 0, -1.0, 1.0)
        moved = self.errors.simulate_errors([self.place_sizes(model.atoms, model.theta + step) for step in steps])
        return np.asarray((moved - model.errors) / steps.sum(1)[:, None, None])

    def _normal_equations(
        self, model: EffectModel, slopes: Array, errors: Array, rows: Mask | slice = slice(None)
    ) -> tuple[Array, Array]:
        """Normal equations of Newton's steps of θ from a model with other ``errors`` (L, S, M), by some ``rows`` alone:
        (P, P) and (L, P)."""
        free, wide = self._list_free_columns(model.atoms)
        weight = self.errors.weigh_channels(model.errors, rows)
        J = slopes[:, rows].reshape(len(free), -1)
        weighted = (slopes[:, rows] * weight).reshape(len(free), -1)
        gradient = errors[:, rows].reshape(len(errors), -1) @ weighted.T + model.theta[free] / wide**2
        return weighted @ J.T + np.diag(wide**-2), -gradient

    def fit_model(
        self,
        model: EffectModel,
        rows: Mask | slice = slice(None),
        steps: int = LONG_HORIZON.most_fit_steps,
        reach: float = np.inf,
    ) -> EffectModel:
        """Fit the sizes of a model.

        Args:
            model: where the fit begins.
            rows: the sampled rows that count.
            steps: of the fit at most.
            reach: bound of the base parameters, in their prior standard deviations.

        Returns:
            The fitted model, its cost being that in these rows.

        """
        model = replace(
            model, cost=float(self.compute_cost(model.atoms, model.errors[None], model.theta[None], rows)[0])
        )
        free, wide = self._list_free_columns(model.atoms)
        most = np.where([self.candidates.columns[k].candidate in model.atoms for k in free], np.inf, reach * wide)
        for _ in range(steps):
            H, (g,) = self._normal_equations(model, self.differentiate_errors(model), model.errors[None], rows)
            step, here = np.zeros_like(model.theta), model.theta[free]
            step[free] = solve_box_qp(H, g, np.linalg.solve(H, g), (-most - here, most - here))
            thetas = model.theta + np.outer(LONG_HORIZON.step_fractions, step)
            errors = self.errors.simulate_errors([self.place_sizes(model.atoms, theta) for theta in thetas])
            costs = self.compute_cost(model.atoms, errors, thetas, rows)
            nearest = int(np.argmin(costs))
            gain = model.cost - float(costs[nearest])
            if gain > 0:
                model = EffectModel(model.atoms, thetas[nearest], errors[nearest], float(costs[nearest]))
            if gain < LONG_HORIZON.least_step_gain:
                break
        return model

    def predict_optima(self, model: EffectModel, slopes: Array, errors: Array) -> Iterator[tuple[Array, Array]]:
        """Predict the linear optimum beside a model for other errors than its own.

        Args:
            model: the model.
            slopes: derivatives (P, S, M) of its errors.
            errors: the other errors (L, S, M).

        Yields:
            For each lane the step of θ (C) and the errors (S, M) after it.

        """
        free = self._list_free_columns(model.atoms)[0]
        H, g = self._normal_equations(model, slopes, errors)
        for one, step in zip(errors, np.linalg.solve(H, g.T).T, strict=True):
            whole = np.zeros_like(model.theta)
            whole[free] = step
            yield whole, one + np.tensordot(step, slopes, 1)

    def drop_effect(self, model: EffectModel, k: int) -> EffectModel:
        """Drop one effect of a model, all else staying as it is.

        Args:
            model: the model.
            k: the effect.

        Returns:
            The model without it.

        """
        theta = model.theta.copy()
        theta[self.candidates.amplitude_columns((k,))] = 0.0
        return self.evaluate_model(tuple(i for i in model.atoms if i != k), theta)

    def cross_validate(self, model: EffectModel) -> float:
        """Cross-validate a fitted model over parts of the log.

        Args:
            model: the model.

        Returns:
            The misfit Σ W log e² of the parts, each told by what is fitted to the others.

        """
        misfit = 0.0
        for windows in np.array_split(np.unique(self.errors.window_index), DIRECT_EVIDENCE.folds):
            part = np.isin(self.errors.window_index, windows)
            misfit += float(
                self.errors.log_misfit(self.fit_model(model, ~part, LONG_HORIZON.most_fold_steps).errors[None], part)[0]
            )
        return misfit
