"""Evidence of many residuals of the same columns, all at once.

For one residual, `hdagen.diagnosis.inference.marginal_likelihood.settled` multiplies one large matrix by small vectors,
window by window. For all residuals together these are products of matrices, which take a small part of the time.

Legend: as in `hdagen.diagnosis.inference.linear_gaussian`; B residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.linear_gaussian import Gram, Summed, left, scaled
from hdagen.diagnosis.inference.marginal_likelihood import SCALES, STILL, laplace


@dataclass(frozen=True, eq=False)
class Bundle:
    """Columns with residuals: ``z``, products with them (B, W, C); ``r2``, their squares (B, W); ``rows`` of data (W);
    ``theta`` where each was measured (B, P); ``temperature``: the likelihood counts as its root of this order."""

    gram: Gram
    z: Array
    r2: Array
    rows: Array
    theta: Array
    temperature: float

    def evidences(self, s: float, spikes: Array) -> Array:
        """Compute the log evidence of each residual, with the windows reweighted until their noise scales converge.

        Args:
            s: size of unexplained torque.
            spikes: prior standard deviations of θ for each residual (B, P).

        Returns:
            Log evidence (B).

        """
        spectrum, N = self.gram.spectrum, self.gram.left(s)
        b, c = spectrum.residuals(spectrum.heard(self.z.transpose(1, 2, 0)), self.r2.T, s)
        windows, P = b.shape[:2]
        freedom, logdet = self.gram.freedom(self.rows), spectrum.logdet(s)

        def scales(theta: Array, of: np.ndarray) -> Array:
            """κ² (W, A) of some at θ (P, A)."""
            return scaled(left(N, b[..., of], c[:, of], theta), freedom[:, None])

        found, still = np.empty(len(self.z)), np.arange(len(self.z))
        kappa2 = scales(self.theta.T, still)
        for _ in range(SCALES):
            weight, log = 1.0 / kappa2, logdet + freedom @ np.log(kappa2)
            H = (weight.T @ N.reshape(windows, -1)).reshape(-1, P, P)
            told, squares = np.einsum("wa,wpa->ap", weight, b[..., still]), (weight * c[:, still]).sum(0)
            means = np.empty((P, len(still)))
            for place, (k, *summed) in enumerate(zip(still, H, told, squares.tolist(), log.tolist(), strict=True)):
                at = laplace(Summed(*summed), spikes[k], s, kappa2[:, place], None, self.temperature)
                means[:, place], found[k] = at.mean, at.evidence
            old, kappa2 = kappa2, scales(means, still)
            moves = np.abs(np.log(kappa2 / old)).max(0) >= STILL
            still, kappa2 = still[moves], kappa2[:, moves]
            if not len(still):
                break
        return found
