"""The linear model of all windows in closed form: initial states and torques eliminated, normal equations for θ.

    r_w = S_w δx_w + B_w d_w + J_w θ + e,     e ~ N(0, κ_w² I),  d_w ~ N(0, κ_w² s² I),  θ ~ N(0, diag v),  δx_w free

r: residual in units of noise; δx_w: change of a window's initial state; d_w: unexplained torques, in steps over the
window; θ: parameters in typical sizes; κ_w: noise scale of a window, at least 1. Unexplained effects come in bursts,
and one window that no parameter explains must not bend the result of all others. δx and d are eliminated window by
window, so every hypothesis, a width v for each parameter, costs one small factorization. Another residual costs a
product only, as the elimination depends on the columns alone.

Source: Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), 2.7 (explicit basis functions) and 5.4;
Lange, Little, Taylor, J. Am. Stat. Assoc. 84 (1989) 881 (scales by group, found by reweighting).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD

ROUNDING_FLOOR = 1e-12  # of terms that cancel: the rounding error of their sum


@dataclass(frozen=True, eq=False)
class ReducedProducts:
    """J'CJ of each window (W, P, P): ``whole`` (W, P, P) less ``taken``'``taken``, ``taken`` (W, k, P) is small.
    The difference itself would fill as much memory for each size of the torques as ``whole`` does."""

    whole: Array
    taken: Array

    @classmethod
    def from_whole(cls, whole: Array) -> ReducedProducts:
        """Return products (W, P, P) of which nothing is taken."""
        return cls(whole, np.empty((len(whole), 0, whole.shape[2])))

    @property
    def dense(self) -> Array:
        """The products (W, P, P) as one array."""
        if not self.taken.size:
            return self.whole
        return _subtract_squares(self.whole, self.taken)

    def multiply(self, theta: Array) -> Array:
        """Return J'CJ θ (W, P, B) by one large product instead of a small one for each window.

        Args:
            theta: θ (P, B).

        """
        windows, k, P = self.taken.shape
        found = (self.whole.reshape(-1, P) @ theta).reshape(windows, P, -1)
        if k:
            found -= self.taken.swapaxes(1, 2) @ (self.taken.reshape(-1, P) @ theta).reshape(windows, k, -1)
        return np.asarray(found)

    def sum_windows(self, weight: Array) -> Array:
        """Return the weighted sum over all windows (P, P).

        Args:
            weight: of each window (W).

        """
        rows = (self.taken * np.sqrt(weight)[:, None, None]).reshape(-1, self.taken.shape[2])
        return np.asarray(np.tensordot(weight, self.whole, 1) - rows.T @ rows)


@dataclass(frozen=True, eq=False)
class EliminatedStates:
    """Initial states eliminated, and torques rotated into eigenvectors window by window, so that any size s of theirs
    costs a product.

    ``L``: factor of S'S (W, m, m); ``first`` = L⁻¹ S'[B | J] (W, m, k + P); ``turn`` (W, k, k) and ``power`` (W, k):
    eigenvectors and eigenvalues of B'B; ``told`` = Q'B'J (W, k, P); ``N`` = J'J (W, P, P); all of these without the
    part that initial states explain.
    """

    L: Array
    whitened: Array
    eigenvectors: Array
    eigenvalues: Array
    cross: Array
    N: Array

    @classmethod
    def from_products(cls, products: Array, m: int, k: int) -> EliminatedStates:
        """Eliminate the initial states from the cross products (W, C, C) of [S | B | J], S having m columns and B
        having k."""
        A = products[:, :m, :m].copy()
        A[:, range(m), range(m)] += LIKELIHOOD.state_ridge * (A[:, range(m), range(m)] + 1.0)
        L = np.asarray(np.linalg.cholesky(A), float)
        first = np.linalg.solve(L, products[:, :m, m:])
        left = products[:, m : m + k, m:] - first[..., :k].swapaxes(1, 2) @ first
        power, turn = (np.asarray(part, float) for part in np.linalg.eigh(left[..., :k]))
        N = _subtract_squares(products[:, m + k :, m + k :], first[..., k:])
        return cls(L, first, turn, np.maximum(power, 0.0), turn.swapaxes(1, 2) @ left[..., k:], N)

    def torque_variances(self, s: float) -> Array:
        """Return the posterior variances (W, k) of the rotated torques of prior standard deviation ``s``."""
        return np.asarray(s**2 / (1.0 + s**2 * self.eigenvalues))

    def log_determinant(self, s: float) -> float:
        """Return the log determinant of the eliminated unknowns. An initial state gains by chance as much as it costs,
        so models with any number of them can be compared.

        Args:
            s: prior standard deviation of the torques.

        """
        return float(np.log1p(s**2 * self.eigenvalues).sum()) + self.L.shape[1] * len(self.L)

    def project(self, z: Array) -> tuple[Array, Array, Array]:
        """Project residuals onto initial states (W, m, B), then rotated torques (W, k, B), then parameters (W, P, B).

        Args:
            z: products of the columns with the residuals (W, C, B).

        """
        m, k = self.L.shape[1], self.eigenvectors.shape[1]
        first = np.asarray(np.linalg.solve(self.L, z[:, :m]), float)
        left = z[:, m:] - self.whitened.swapaxes(1, 2) @ first
        return first, self.eigenvectors.swapaxes(1, 2) @ left[:, :k], left[:, k:]

    def eliminate_torques(self, heard: tuple[Array, Array, Array], r2: Array, s: float) -> tuple[Array, Array]:
        """Eliminate the torques from projected residuals, too.

        Args:
            heard: their projections.
            r2: squares of the residuals (W, B).
            s: prior standard deviation of the torques.

        Returns:
            J'Cr (W, P, B) and r'Cr (W, B).

        """
        first, turned, own = heard
        weighted = turned * self.torque_variances(s)[..., None]
        return own - self.cross.swapaxes(1, 2) @ weighted, r2 - (first**2).sum(1) - (turned * weighted).sum(1)

    def reduced_products(self, s: float) -> ReducedProducts:
        """Return J'CJ with the torques eliminated, too.

        Args:
            s: prior standard deviation of the torques.

        """
        if s == 0.0:
            return ReducedProducts.from_whole(self.N)
        return ReducedProducts(self.N, self.cross * np.sqrt(self.torque_variances(s))[..., None])


def _subtract_squares(products: Array, of: Array) -> Array:
    """Return ``products`` (W, C, C) less ``of``'``of`` of each window (W, r, C)."""
    squares = np.matmul(of.swapaxes(1, 2), of)
    return np.asarray(np.subtract(products, squares, out=squares))


@dataclass(frozen=True, eq=False)
class CrossProducts:
    """Cross products of [S | B | J] of each window (W, C, C), with ``m`` and ``k`` columns of S and B."""

    products: Array
    m: int
    k: int
    dense_cache: dict[float, ReducedProducts] = field(default_factory=dict)

    def take_columns(self, columns: Sequence[int]) -> Array:
        """Return the products of some columns (W, c, c). They are copied in the order of memory: an index of lists
        would transpose them.

        Args:
            columns: places of the columns.

        """
        found = np.empty((len(self.products), len(columns), len(columns)))
        for one, of in zip(found, self.products, strict=True):
            np.take(of[columns], columns, 1, out=one, mode="clip")
        return found

    @cached_property
    def eliminated_states(self) -> EliminatedStates:
        """Initial states eliminated, torques rotated."""
        return EliminatedStates.from_products(self.products, self.m, self.k)

    def degrees_of_freedom(self, rows: Array) -> Array:
        """Return the degrees of freedom of each window (W).

        Args:
            rows: rows of data (W).

        """
        return np.maximum(rows - self.m, 1)

    def drop_caches(self) -> None:
        """Drop all that can be computed again from the products: it is several times as large."""
        self.dense_cache.clear()
        self.__dict__.pop("eliminated_states", None)

    def dense_products(self, s: float) -> ReducedProducts:
        """Return J'CJ as one array, for many residuals; the last two results are kept.

        Args:
            s: prior standard deviation of the torques.

        """
        found = self.dense_cache.get(s)
        if found is None:
            for old in list(self.dense_cache)[:-1]:
                self.dense_cache.pop(old, None)
            found = ReducedProducts.from_whole(self.eliminated_states.reduced_products(s).dense)
            self.dense_cache[s] = found
        return found


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of each window for θ: J'CJ, J'Cr (W, P), r'Cr (W), degrees of freedom (W); the log determinant
    of all; the temperature of the likelihood."""

    products: ReducedProducts
    b: Array
    c: Array
    log_determinant: float
    degrees_of_freedom: Array
    temperature: float = 1.0

    def centered_at(self, center: Array) -> NormalEquations:
        """Return the equations for θ less a center.

        Args:
            center: the center (P).

        """
        moved = self.products.multiply(center[:, None])[..., 0]
        return replace(self, b=self.b - moved, c=self.c + (moved - 2 * self.b) @ center)

    def sum_windows(self, kappa2: Array) -> TotalNormalEquations:
        """Return the sum over all windows.

        Args:
            kappa2: squared noise scales (W).

        """
        weight = 1.0 / kappa2
        log = self.log_determinant + float(self.degrees_of_freedom @ np.log(kappa2))
        return TotalNormalEquations(self.products.sum_windows(weight), weight @ self.b, float(weight @ self.c), log)

    def chi2(self, theta: Array) -> Array:
        """Return the misfit of each window (W), in units of noise, squared; at least the rounding error of its terms.

        Args:
            theta: θ (P).

        """
        return compute_misfit(self.products, self.b[..., None], self.c[:, None], theta[:, None])[:, 0]

    def window_scales(self, theta: Array) -> Array:
        """Return κ² of each window (W): 1, or a power of its misfit beyond chance. With a higher power a model would
        rather give up windows than explain them.

        Args:
            theta: θ (P).

        """
        return self.scales_from_misfit(self.chi2(theta))

    def scales_from_misfit(self, left: Array) -> Array:
        """Return the same from the misfit.

        Args:
            left: misfit of each window (W).

        """
        return compute_window_scales(left, self.degrees_of_freedom)

    def cost(self, theta: Array, prior: Array, kappa2: Array | None = None) -> float:
        """Return minus twice the log posterior of θ, but for constants.

        Args:
            theta: θ (P).
            prior: prior standard deviations of θ (P).
            kappa2: squared noise scales (W); without them each window takes its own.

        """
        return self.cost_from_misfit(theta, prior, self.chi2(theta), kappa2)

    def cost_from_misfit(self, theta: Array, prior: Array, left: Array, kappa2: Array | None = None) -> float:
        """Return the same from the misfit.

        Args:
            theta: θ (P).
            prior: prior standard deviations of θ (P).
            left: misfit of each window (W).
            kappa2: squared noise scales (W); without them each window takes its own.

        """
        if kappa2 is None:
            kappa2 = self.scales_from_misfit(left)
        likelihood = float((left / kappa2 + self.degrees_of_freedom * np.log(kappa2)).sum())
        return likelihood / self.temperature + float((theta**2 / prior**2).sum())


def compute_misfit(products: ReducedProducts, b: Array, c: Array, theta: Array) -> Array:
    """Return the misfit (W, B) of residuals with the same columns, each at its own θ, as `NormalEquations.chi2` does
    for one.

    Args:
        products: J'CJ.
        b: J'Cr (W, P, B).
        c: r'Cr (W, B).
        theta: θ (P, B).

    """
    projection = np.einsum("wpb,pb->wb", b, theta)
    own = np.einsum("wpb,pb->wb", products.multiply(theta), theta)
    rounded = ROUNDING_FLOOR * (np.abs(c) + 2 * np.abs(projection) + np.abs(own))
    return np.asarray(np.maximum(c - 2 * projection + own, rounded))


def compute_window_scales(left: Array, freedom: Array) -> Array:
    """Return the squared noise scales κ² of windows.

    Args:
        left: their misfit.
        freedom: their degrees of freedom.

    """
    chance = freedom * (1.0 + LIKELIHOOD.chi2_allowance * np.sqrt(2.0 / freedom))
    return np.asarray(np.maximum(left / chance, 1.0) ** LIKELIHOOD.scale_exponent)


@dataclass(frozen=True, eq=False)
class TotalNormalEquations:
    """The likelihood of θ with fixed noise scales: minus twice its logarithm is c − 2 b'θ + θ'N θ + log, with N (P, P),
    b (P)."""

    N: Array
    b: Array
    c: float
    log_normalizer: float
