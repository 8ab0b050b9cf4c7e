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

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from hdagen.plant import Array

ROUNDED = 1e-12  # of terms that cancel, what is left of them by rounding
RIDGE = 1e-10  # of a first state that a window does not tell
ROOT = 1.0  # of what a window leaves beyond chance, that its scale is: Huber's weights would be 0.5
CHANCE = 3.0  # standard deviations of chi² that chance is granted in a window


@dataclass(frozen=True, eq=False)
class Spectrum:
    """First states eliminated, and the torques turned, window by window, so that none of them answers for another one:
    any size s of theirs then costs a product.

    ``L`` factor of S'S (W, m, m); ``first`` = L⁻¹ S'[B | J] (W, m, k + P); ``turn`` (W, k, k) and ``power`` (W, k) of
    B'B = Q λ Q'; ``told`` = Q'B'J (W, k, P); ``N`` = J'J (W, P, P), all without what first states tell.
    """

    L: Array
    first: Array
    turn: Array
    power: Array
    told: Array
    N: Array

    @classmethod
    def of(cls, products: Array, m: int, k: int) -> Spectrum:
        """From the cross products (W, C, C) of [S | B | J]."""
        A = products[:, :m, :m].copy()
        A[:, range(m), range(m)] += RIDGE * (A[:, range(m), range(m)] + 1.0)
        L = np.asarray(np.linalg.cholesky(A), float)
        first = np.linalg.solve(L, products[:, :m, m:])
        left = products[:, m : m + k, m:] - first[..., :k].swapaxes(1, 2) @ first
        power, turn = (np.asarray(part, float) for part in np.linalg.eigh(left[..., :k]))
        N = _less(products[:, m + k :, m + k :], first[..., k:])
        return cls(L, first, turn, np.maximum(power, 0.0), turn.swapaxes(1, 2) @ left[..., k:], N)

    def weights(self, s: float) -> Array:
        """Variances (W, k) of the turned torques, of standard deviation ``s`` before, in what the data then tell."""
        return np.asarray(s**2 / (1.0 + s**2 * self.power))

    def logdet(self, s: float) -> float:
        """Log determinant of what is eliminated at size ``s``: a first state gains by chance what it costs, so that
        models of as many as they like can be compared."""
        return float(np.log1p(s**2 * self.power).sum()) + self.L.shape[1] * len(self.L)

    def heard(self, z: Array) -> tuple[Array, Array, Array]:
        """What products with residuals, z (W, C, B), tell first states (W, m, B), then the turned torques (W, k, B),
        and parameters (W, P, B)."""
        m, k = self.L.shape[1], self.turn.shape[1]
        first = np.asarray(np.linalg.solve(self.L, z[:, :m]), float)
        left = z[:, m:] - self.first.swapaxes(1, 2) @ first
        return first, self.turn.swapaxes(1, 2) @ left[:, :k], left[:, k:]

    def residuals(self, heard: tuple[Array, Array, Array], r2: Array, s: float) -> tuple[Array, Array]:
        """J'Cr (W, P, B) and r'Cr (W, B) of residuals of which `heard` is known and ``r2`` (W, B), with torques of size
        ``s`` eliminated, too."""
        first, turned, own = heard
        weighted = turned * self.weights(s)[..., None]
        return own - self.told.swapaxes(1, 2) @ weighted, r2 - (first**2).sum(1) - (turned * weighted).sum(1)

    def left(self, s: float) -> Array:
        """J'CJ (W, P, P) with torques of size ``s`` eliminated, too."""
        return self.N if s == 0.0 else _less(self.N, self.told * np.sqrt(self.weights(s))[..., None])


def _less(products: Array, of: Array) -> Array:
    """``products`` (W, C, C) less ``of``'``of`` of each window (W, r, C)."""
    told = np.matmul(of.swapaxes(1, 2), of)
    return np.asarray(np.subtract(products, told, out=told))


@dataclass(frozen=True, eq=False)
class Gram:
    """Cross products of [S | B | J], a window each: (W, C, C); ``m`` and ``k`` columns of S and B."""

    products: Array
    m: int
    k: int
    kept: dict[float, Array] = field(default_factory=dict)

    def some(self, columns: Sequence[int]) -> Array:
        """The products of some columns (W, c, c), in memory as they are read: fancy indices would turn them."""
        found = np.empty((len(self.products), len(columns), len(columns)))
        for one, of in zip(found, self.products, strict=True):
            np.take(of[columns], columns, 1, out=one, mode="clip")
        return found

    @cached_property
    def spectrum(self) -> Spectrum:
        """First states eliminated, torques turned."""
        return Spectrum.of(self.products, self.m, self.k)

    def freedom(self, rows: Array) -> Array:
        """Degrees of freedom of windows (W) with so many rows of data."""
        return np.maximum(rows - self.m, 1)

    def forget(self) -> None:
        """Let go of what can be had again from the products: it is several times as large."""
        self.kept.clear()
        self.__dict__.pop("spectrum", None)

    def left(self, s: float) -> Array:
        """J'CJ (W, P, P) with torques of standard deviation ``s``; the last two are kept."""
        found = self.kept.get(s)
        if found is None:
            for old in list(self.kept)[:-1]:
                self.kept.pop(old, None)
            self.kept[s] = found = self.spectrum.left(s)
        return found


@dataclass(frozen=True, eq=False)
class Linear:
    """Columns with a residual: ``z`` their products with it (W, C), ``r2`` its own (W); ``rows`` of data (W); ``theta``
    where it was measured (P); ``temperature``: the likelihood counts as its root of that order; ``least``: size of the
    torques that is known of, as the inputs are uncertain by it."""

    gram: Gram
    z: Array
    r2: Array
    rows: Array
    theta: Array
    temperature: float = 1.0
    least: float = 0.0
    kept: dict[float, tuple[Array, Array]] = field(init=False, repr=False, default_factory=dict)
    stood: dict[float, Array] = field(init=False, repr=False, default_factory=dict)

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
        e = self.gram.spectrum
        if s not in self.kept:
            b, c = e.residuals(self._heard, self.r2[:, None], s)
            self.kept[s] = b[..., 0], c[:, 0]
        return Reduced(self.gram.left(s), *self.kept[s], e.logdet(s), self.gram.freedom(self.rows), self.temperature)

    def chi2(self, s: float) -> Array:
        """What each window (W) leaves where it was measured, as `Reduced.chi2` has it."""
        if s not in self.stood:
            self.stood[s] = self.reduced(s).chi2(self.theta)
        return self.stood[s]

    def cost(self, s: float, prior: Array) -> float:
        """Minus twice the log posterior where it was measured, as `Reduced.cost` has it."""
        return self.reduced(s).costs(self.theta, prior, self.chi2(s))

    def inner(self, s: float, theta: Array) -> tuple[Array, Array]:
        """Change of the first states (W, m) and torques (W, k), in their units, that go with θ."""
        e = self.gram.spectrum
        first, turned = (part[..., 0] for part in self._heard[:2])
        torques = np.einsum("wij,wj->wi", e.turn, e.weights(s) * (turned - e.told @ theta))
        at = first - np.einsum("wmc,wc->wm", e.first, np.column_stack([torques, np.tile(theta, (len(torques), 1))]))
        return np.linalg.solve(e.L.swapaxes(1, 2), at[..., None])[..., 0], torques

    @cached_property
    def _heard(self) -> tuple[Array, Array, Array]:
        return self.gram.spectrum.heard(self.z[..., None])


@dataclass(frozen=True, eq=False)
class Reduced:
    """What is left for θ, a window each: J'CJ (W, P, P), J'Cr (W, P), r'Cr (W), degrees of freedom (W); log
    determinant of all; the temperature of the likelihood."""

    N: Array
    b: Array
    c: Array
    logdet: float
    freedom: Array
    temperature: float = 1.0

    def about(self, center: Array) -> Reduced:
        """The same for θ less ``center`` (P)."""
        N = self._times(center)
        return replace(self, b=self.b - N, c=self.c + (N - 2 * self.b) @ center)

    def _times(self, theta: Array) -> Array:
        """J'CJ θ (W, P), as one product: a window each would be many small ones."""
        return np.asarray((self.N.reshape(-1, len(theta)) @ theta).reshape(self.b.shape))

    def summed(self, kappa2: Array) -> Summed:
        """All windows together, at scales ``kappa2`` (W)."""
        weight = 1.0 / kappa2
        log = self.logdet + float(self.freedom @ np.log(kappa2))
        return Summed(np.tensordot(weight, self.N, 1), weight @ self.b, float(weight @ self.c), log)

    def chi2(self, theta: Array) -> Array:
        """What each window (W) leaves at θ, in units of noise, squared; no less than rounding leaves of its terms."""
        return left(self.N, self.b[..., None], self.c[:, None], theta[:, None])[:, 0]

    def scales(self, theta: Array) -> Array:
        """κ² of each window (W) at θ: 1, or a root of what it leaves where chance does not leave as much: with the
        whole of it a model would rather give windows up than explain them."""
        return self.scaled(self.chi2(theta))

    def scaled(self, left: Array) -> Array:
        """The same where each window leaves ``left`` (W)."""
        return scaled(left, self.freedom)

    def cost(self, theta: Array, prior: Array, kappa2: Array | None = None) -> float:
        """Minus twice the log posterior of θ under prior standard deviations ``prior`` (P), but for constants, with the
        windows at scales ``kappa2`` (W), else each at its own."""
        return self.costs(theta, prior, self.chi2(theta), kappa2)

    def costs(self, theta: Array, prior: Array, left: Array, kappa2: Array | None = None) -> float:
        """The same where each window leaves ``left`` (W)."""
        if kappa2 is None:
            kappa2 = self.scaled(left)
        likelihood = float((left / kappa2 + self.freedom * np.log(kappa2)).sum())
        return likelihood / self.temperature + float((theta**2 / prior**2).sum())


def left(N: Array, b: Array, c: Array, theta: Array) -> Array:
    """`Reduced.chi2` (W, B) of residuals with the same columns, b (W, P, B) and c (W, B), each at a θ of its own
    (P, B)."""
    told = np.einsum("wpb,pb->wb", b, theta)
    own = np.einsum("wpb,pb->wb", (N.reshape(-1, len(theta)) @ theta).reshape(b.shape), theta)
    rounded = ROUNDED * (np.abs(c) + 2 * np.abs(told) + np.abs(own))
    return np.asarray(np.maximum(c - 2 * told + own, rounded))


def scaled(left: Array, freedom: Array) -> Array:
    """κ² of windows that leave ``left`` of so many degrees of freedom."""
    chance = freedom * (1.0 + CHANCE * np.sqrt(2.0 / freedom))
    return np.asarray(np.maximum(left / chance, 1.0) ** ROOT)


@dataclass(frozen=True, eq=False)
class Summed:
    """The likelihood of θ with the windows at their scales: minus twice its logarithm is c − 2 b'θ + θ'N θ + log, N
    (P, P), b (P)."""

    N: Array
    b: Array
    c: float
    log: float
