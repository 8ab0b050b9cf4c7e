"""The linear model of all windows, and the evidence for a set of prior widths in closed form.

    r_w = S_w δx_w + B_w d_w + J_w θ + e,     e ~ N(0, κ² I),  d_w ~ N(0, κ² s² I),  θ ~ N(0, diag v),  δx_w free

r residual in units of noise; δx_w change of a window's first state; d_w torques that no parameter explains, in steps
over the window; θ parameters in units of what is usual. δx and d are eliminated window by window, so that every
hypothesis, a width v for each parameter, costs one small factorisation.

Source: Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), 2.7 (explicit basis functions) and 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.plant import Array

RIDGE = 1e-12


@dataclass(frozen=True, eq=False)
class Linear:
    """Cross products of [S | B | J | r], a window each: (W, C, C); ``m`` and ``k`` columns of S and B; ``rows`` of
    data."""

    products: Array
    m: int
    k: int
    rows: int

    def reduced(self, s: Array) -> Reduced:
        """With first states and torques of standard deviation ``s`` (k) eliminated."""
        m, k = self.m, self.k
        active = np.flatnonzero(s > 0)
        inner = np.concatenate([np.arange(m), m + active])
        outer = np.arange(m + k, self.products.shape[1])
        A = self.products[:, inner[:, None], inner].copy()
        scale = np.concatenate([np.ones(m), s[active]])
        A *= scale[:, None] * scale
        d = range(m, len(inner))
        A[:, d, d] += 1.0
        x = range(m)
        A[:, x, x] *= 1.0 + RIDGE
        B = self.products[:, inner[:, None], outer] * scale[:, None]
        L = np.linalg.cholesky(A)
        half = np.linalg.solve(L, B)
        logdet = 2.0 * float(np.log(np.diagonal(L, axis1=1, axis2=2)[:, m:]).sum())
        rest = self.products[:, outer[:, None], outer] - half.swapaxes(1, 2) @ half
        return Reduced(
            rest[:, :-1, :-1].sum(0), rest[:, :-1, -1].sum(0), rest[:, -1, -1], logdet, self.rows - m * len(A)
        )


@dataclass(frozen=True, eq=False)
class Reduced:
    """What is left for θ: J'CJ (P, P), J'Cr (P), r'Cr by window (W), log determinant, degrees of freedom."""

    N: Array
    b: Array
    c: Array
    logdet: float
    freedom: int

    def cost(self, theta: Array, kappa2: float, prior: Array) -> float:
        """Minus twice the log posterior of θ under prior standard deviations ``prior`` (P), but for constants."""
        chi2 = float(self.c.sum()) - 2 * float(self.b @ theta) + float(theta @ self.N @ theta)
        return chi2 / kappa2 + float((theta**2 / prior**2).sum())
