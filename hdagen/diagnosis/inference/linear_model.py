"""Columns with a residual: their normal equations for θ, and the initial states and torques that go with θ.

Legend: W windows, C columns [S | B | J], m columns of S, k of B, P of J, as in
`hdagen.diagnosis.inference.linear_gaussian`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.linear_gaussian import CrossProducts, NormalEquations


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Columns with a residual.

    ``z``: products of the columns with the residual (W, C); ``r2``: its square (W); ``rows`` of data (W); ``theta``:
    where it was measured (P); ``temperature``: the likelihood counts as its root of this order; ``least_torque``: size
    of the torques that the inputs' uncertainty alone causes.
    """

    cross_products: CrossProducts
    z: Array
    r2: Array
    rows: Array
    theta: Array
    temperature: float = 1.0
    least_torque: float = 0.0
    residual_cache: dict[float, tuple[Array, Array]] = field(init=False, repr=False, default_factory=dict)
    misfit_cache: dict[float, Array] = field(init=False, repr=False, default_factory=dict)

    @property
    def m(self) -> int:
        """Columns of first states."""
        return self.cross_products.m

    @property
    def k(self) -> int:
        """Columns of torques."""
        return self.cross_products.k

    def normal_equations(self, s: float) -> NormalEquations:
        """Eliminate initial states and torques.

        Args:
            s: prior standard deviation of the torques.

        Returns:
            Normal equations of each window for θ.

        """
        e = self.cross_products.eliminated_states
        if s not in self.residual_cache:
            b, c = e.eliminate_torques(self._projections, self.r2[:, None], s)
            self.residual_cache[s] = b[..., 0], c[:, 0]
        return NormalEquations(
            e.reduced_products(s),
            *self.residual_cache[s],
            e.log_determinant(s),
            self.cross_products.degrees_of_freedom(self.rows),
            self.temperature,
        )

    def chi2(self, s: float) -> Array:
        """Return the misfit (W) at the point of measurement, as `NormalEquations.chi2` defines it.

        Args:
            s: prior standard deviation of the torques.

        """
        if s not in self.misfit_cache:
            self.misfit_cache[s] = self.normal_equations(s).chi2(self.theta)
        return self.misfit_cache[s]

    def cost(self, s: float, prior: Array) -> float:
        """Return minus twice the log posterior at the point of measurement, as `NormalEquations.cost` defines it.

        Args:
            s: prior standard deviation of the torques.
            prior: prior standard deviations of θ (P).

        """
        return self.normal_equations(s).cost_from_misfit(self.theta, prior, self.chi2(s))

    def solve_inner(self, s: float, theta: Array) -> tuple[Array, Array]:
        """Solve for the initial states and torques that go with θ.

        Args:
            s: prior standard deviation of the torques.
            theta: θ (P).

        Returns:
            Changes of the initial states (W, m) and torques (W, k), in their units.

        """
        e = self.cross_products.eliminated_states
        first, turned = (part[..., 0] for part in self._projections[:2])
        torques = np.einsum("wij,wj->wi", e.eigenvectors, e.torque_variances(s) * (turned - e.cross @ theta))
        at = first - np.einsum("wmc,wc->wm", e.whitened, np.column_stack([torques, np.tile(theta, (len(torques), 1))]))
        return np.linalg.solve(e.L.swapaxes(1, 2), at[..., None])[..., 0], torques

    @cached_property
    def _projections(self) -> tuple[Array, Array, Array]:
        """Projections of the residual."""
        return self.cross_products.eliminated_states.project(self.z[..., None])
