"""Evidence of many residuals of the same columns, all at once.

For one residual, `hdagen.diagnosis.inference.marginal_likelihood.solve_with_scales` multiplies one large matrix by
small vectors, window by window. For all residuals together these are products of matrices, which take a small part of
the time.

Legend: as in `hdagen.diagnosis.inference.linear_gaussian`; B residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.inference.linear_gaussian import (
    CrossProducts,
    TotalNormalEquations,
    compute_misfit,
    compute_window_scales,
)
from hdagen.diagnosis.inference.marginal_likelihood import apply_laplace


@dataclass(frozen=True, eq=False)
class ResidualBatch:
    """Columns with residuals: ``z``, products with them (B, W, C); ``r2``, their squares (B, W); ``rows`` of data (W);
    ``theta`` where each was measured (B, P); ``temperature``: the likelihood counts as its root of this order."""

    cross_products: CrossProducts
    z: Array
    r2: Array
    rows: Array
    theta: Array
    temperature: float

    def log_evidences(self, s: float, spikes: Array) -> Array:
        """Compute the log evidence of each residual, with the windows reweighted until their noise scales converge.

        Args:
            s: size of unexplained torque.
            spikes: prior standard deviations of θ for each residual (B, P).

        Returns:
            Log evidence (B).

        """
        spectrum, products = self.cross_products.eliminated_states, self.cross_products.dense_products(s)
        b, c = spectrum.eliminate_torques(spectrum.project(self.z.transpose(1, 2, 0)), self.r2.T, s)
        windows, P = b.shape[:2]
        freedom, logdet = self.cross_products.degrees_of_freedom(self.rows), spectrum.log_determinant(s)

        def scales(theta: Array, of: np.ndarray) -> Array:
            """κ² (W, A) of some at θ (P, A)."""
            return compute_window_scales(compute_misfit(products, b[..., of], c[:, of], theta), freedom[:, None])

        found, still = np.empty(len(self.z)), np.arange(len(self.z))
        kappa2 = scales(self.theta.T, still)
        for _ in range(LIKELIHOOD.most_reweightings):
            weight, log = 1.0 / kappa2, logdet + freedom @ np.log(kappa2)
            H = (weight.T @ products.whole.reshape(windows, -1)).reshape(-1, P, P)
            projections, squares = np.einsum("wa,wpa->ap", weight, b[..., still]), (weight * c[:, still]).sum(0)
            means = np.empty((P, len(still)))
            for place, (k, *summed) in enumerate(
                zip(still, H, projections, squares.tolist(), log.tolist(), strict=True)
            ):
                at = apply_laplace(
                    TotalNormalEquations(*summed), spikes[k], s, kappa2[:, place], None, self.temperature
                )
                means[:, place], found[k] = at.mean, at.evidence
            old, kappa2 = kappa2, scales(means, still)
            moves = np.abs(np.log(kappa2 / old)).max(0) >= LIKELIHOOD.scale_tolerance
            still, kappa2 = still[moves], kappa2[:, moves]
            if not len(still):
                break
        return found
