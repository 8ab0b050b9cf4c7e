"""The linear model of all windows, and the evidence for a set of prior widths in closed form.

    r_w = S_w δx_w + B_w d_w + J_w θ + e,     e ~ N(0, κ_w² I),  d_w ~ N(0, κ_w² s² I),  θ ~ N(0, diag v),  δx_w free

r residual in units of noise; δx_w change of a window's first state; d_w torques that no parameter explains, in steps
over the window; θ parameters in units of what is usual; κ_w scale of what a window leaves, at least 1: what no model of
ours tells comes in bursts, and one window that cannot be told must not bend what all others say. δx and d are
eliminated window by window, so that every hypothesis, a width v for each parameter, costs one small factorisation; and
every residual only a product, as what is eliminated depends on the columns alone.

Source: Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), 2.7 (explicit basis functions) and 5.4;
Lange, Little, Taylor, J. Am. Stat. Assoc. 84 (1989) 881 (scales by group, found by reweighting).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hdagen.plant import Array

RIDGE = 1e-10  # of a first state that a window does not tell
ROOT = 1.0  # of what a window leaves beyond chance, that its scale is: Huber's weights would be 0.5
CHANCE = 3.0  # standard deviations of chi² that chance is granted in a window


@dataclass(frozen=True, eq=False)
class Eliminated:
    """First states and torques of size s eliminated: L factor (W, i, i), half = L⁻¹ [S | s B]' J (W, i, P), N = J'CJ
    (W, P, P), log determinant."""

    scale: Array
    L: Array
    half: Array
    N: Array
    logdet: float


@dataclass(frozen=True, eq=False)
class Gram:
    """Cross products of [S | B | J], a window each: (W, C, C); ``m`` and ``k`` columns of S and B."""

    products: Array
    m: int
    k: int
    kept: dict[float, Eliminated] = field(default_factory=dict)

    def eliminated(self, s: float) -> Eliminated:
        """With first states and torques of standard deviation ``s``; the last one is kept."""
        if s not in self.kept:
            self.kept.clear()
            self.kept[s] = self._eliminated(s)
        return self.kept[s]

    def _eliminated(self, s: float) -> Eliminated:
        m, inner = self.m, self.m + (self.k if s > 0 else 0)
        scale = np.concatenate([np.ones(m), np.full(inner - m, s)])
        A = self.products[:, :inner, :inner] * scale[:, None] * scale
        A[:, range(m, inner), range(m, inner)] += 1.0
        A[:, range(m), range(m)] += RIDGE * (A[:, range(m), range(m)] + 1.0)
        outer = self.m + self.k
        L = np.linalg.cholesky(A)
        half = np.linalg.solve(L, self.products[:, :inner, outer:] * scale[:, None])
        # a first state gains by chance what it costs, so that models of as many as they like can be compared
        logdet = 2.0 * float(np.log(np.diagonal(L, axis1=1, axis2=2)[:, m:]).sum()) + m * len(L)
        N = self.products[:, outer:, outer:] - half.swapaxes(1, 2) @ half
        return Eliminated(scale, L, half, N, logdet)


@dataclass(frozen=True, eq=False)
class Linear:
    """Columns with a residual: ``z`` their products with it (W, C), ``r2`` its own (W); ``rows`` of data (W); ``theta``
    where it was measured (P)."""

    gram: Gram
    z: Array
    r2: Array
    rows: Array
    theta: Array

    @property
    def m(self) -> int:
        """Columns of first states."""
        return self.gram.m

    @property
    def k(self) -> int:
        """Columns of torques."""
        return self.gram.k

    def reduced(self, s: float) -> Reduced:
        """With first states and torques of standard deviation ``s`` eliminated."""
        e, outer = self.gram.eliminated(s), self.m + self.k
        half = self._half(e, self.z[:, : len(e.scale)])
        b = self.z[:, outer:] - np.einsum("wip,wi->wp", e.half, half, optimize=True)
        return Reduced(e.N, b, self.r2 - (half**2).sum(1), e.logdet, np.maximum(self.rows - self.m, 1))

    def inner(self, s: float, theta: Array) -> tuple[Array, Array]:
        """Change of the first states (W, m) and torques (W, k), in their units, that go with θ; no torques at s = 0."""
        e, m = self.gram.eliminated(s), self.m
        left = self.z[:, : len(e.scale)] - self.gram.products[:, : len(e.scale), m + self.k :] @ theta
        found = np.linalg.solve(e.L.swapaxes(1, 2), self._half(e, left)[..., None])[..., 0] * e.scale
        return found[:, :m], found[:, m:]

    def _half(self, e: Eliminated, z: Array) -> Array:
        return np.asarray(np.linalg.solve(e.L, (z * e.scale)[..., None])[..., 0])


@dataclass(frozen=True, eq=False)
class Reduced:
    """What is left for θ, a window each: J'CJ (W, P, P), J'Cr (W, P), r'Cr (W), degrees of freedom (W); log
    determinant of all."""

    N: Array
    b: Array
    c: Array
    logdet: float
    freedom: Array

    def about(self, center: Array) -> Reduced:
        """The same for θ less ``center`` (P)."""
        N = self.N @ center
        return Reduced(self.N, self.b - N, self.c + (N - 2 * self.b) @ center, self.logdet, self.freedom)

    def chi2(self, theta: Array) -> Array:
        """What each window (W) leaves at θ, in units of noise, squared."""
        return np.asarray(np.maximum(self.c - 2 * self.b @ theta + (self.N @ theta) @ theta, 0.0))

    def scales(self, theta: Array) -> Array:
        """κ² of each window (W) at θ: 1, or a root of what it leaves where chance does not leave as much: with the
        whole of it a model would rather give windows up than explain them."""
        chance = self.freedom * (1.0 + CHANCE * np.sqrt(2.0 / self.freedom))
        return np.asarray(np.maximum(self.chi2(theta) / chance, 1.0) ** ROOT)

    def cost(self, theta: Array, prior: Array, kappa2: Array | None = None) -> float:
        """Minus twice the log posterior of θ under prior standard deviations ``prior`` (P), but for constants, with the
        windows at scales ``kappa2`` (W), else each at its own."""
        if kappa2 is None:
            kappa2 = self.scales(theta)
        return float((self.chi2(theta) / kappa2 + self.freedom * np.log(kappa2)).sum() + (theta**2 / prior**2).sum())
