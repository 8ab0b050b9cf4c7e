"""The evidence for every hypothesis from one linear model: some effects are free, all others have a narrow prior
(spike).

The posterior of θ under spikes alone, N(μ, Σ), gives every hypothesis in closed form: freeing the columns A changes
their prior precision by D, and the evidence by

    |I + Σ_A D|^(−1/2) · (|V_spike| / |V_slab|)^(1/2) · exp(−½ μ_A' D (I + Σ_A D)⁻¹ μ_A).

Each hypothesis chooses its own size s of unexplained torque and noise scale κ of each window.

Source: Dickey, Ann. Math. Stat. 42 (1971) 204 (the ratio of nested evidences); George, McCulloch, J. Am. Stat. Assoc.
88 (1993) 881 (spike and slab); Miller, Dunson, J. Am. Stat. Assoc. 114 (2019) 1113 (a tempered likelihood, as no model
is true).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import eigh
from scipy.linalg.lapack import dpotrf, dpotrs
from scipy.special import ndtr

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.bounded_least_squares import Bounds, solve_box_qp
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.inference.linear_gaussian import ROUNDING_FLOOR, NormalEquations, TotalNormalEquations
from hdagen.diagnosis.inference.linear_model import LinearModel
from hdagen.support.parallel import map_in_threads

TORQUE_GRID = np.concatenate([[0.0], np.geomspace(*LIKELIHOOD.torque_grid_ends, LIKELIHOOD.torque_grid_size)])


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior of θ at one s and κ² (W): the mean, or the mode within bounds (P); minus twice the log posterior there,
    but for the constant of its prior; the log evidence. ``factor`` (P, P, lower) is the Cholesky factor of the inverse
    covariance in units of the prior's standard deviations ``spike`` (P)."""

    s: float
    kappa2: Array
    mean: Array
    factor: Array
    prior_widths: Array
    cost: float
    evidence: float

    @cached_property
    def covariance(self) -> Array:
        """Covariance of θ (P, P), computed on demand."""
        inverse = dpotrs(self.factor, np.eye(len(self.prior_widths)), lower=1)[0]
        return np.asarray(inverse * (self.prior_widths[:, None] * self.prior_widths))

    def evidence_paid_by(self, prior: Array, own: Array) -> float:
        """Return the log evidence in which only some columns pay Occam's factor. One fit determines the columns that
        all hypotheses share a little better than another one does, and all of these differences together would exceed
        the difference between hypotheses.

        Args:
            prior: prior standard deviations of θ (P).
            own: places of the columns that pay.

        """
        width = prior[own]
        return -0.5 * (
            self.cost - float(np.linalg.slogdet(self.covariance[np.ix_(own, own)] / width / width[:, None])[1])
        )

    @property
    def noise_level(self) -> float:
        """Squared noise scale over all windows (geometric mean)."""
        return float(np.exp(np.log(self.kappa2).mean()))


@dataclass(frozen=True, eq=False)
class ScoredHypothesis:
    """A hypothesis: its candidates, its log evidence, the posterior in which it is best, and ``large``, the probability
    that its effect is as large as counts as present."""

    effects: tuple[int, ...]
    evidence: float
    posterior: Posterior
    presence_probability: float = 1.0


def compute_posteriors(
    linear: LinearModel,
    spike: Array,
    near: float | None = None,
    bounds: Bounds | None = None,
) -> list[Posterior]:
    """Compute the posterior at several sizes of unexplained torque.

    Args:
        linear: the linear model.
        spike: prior standard deviations of θ (P).
        near: a size from which to climb to the best one, as the evidence may change between coarse sizes by as much as
            separates hypotheses; without it, a coarse grid of sizes is taken.
        bounds: lowest and highest θ (P each).

    Returns:
        The posteriors in the order of their sizes; from ``near`` the best of them lies between the grid's points.

    """
    sizes = TORQUE_GRID[min(int(np.searchsorted(TORQUE_GRID, linear.least_torque)), len(TORQUE_GRID) - 1) :]
    if near is None:
        return map_in_threads(
            lambda s: solve_with_scales(linear, spike, s, bounds), sizes[:: LIKELIHOOD.coarse_stride].tolist()
        )
    here = int(np.argmin(np.abs(sizes - near)))
    posteriors = {here: solve_with_scales(linear, spike, sizes[here], bounds)}
    for step in (sign * stride for stride in LIKELIHOOD.refining_strides for sign in (-1, 1)):
        while 0 <= here + step < len(sizes):
            if here + step not in posteriors:
                posteriors[here + step] = solve_with_scales(linear, spike, sizes[here + step], bounds)
            if posteriors[here + step].evidence <= posteriors[here].evidence:
                break
            here += step
    between = _interpolate_peak(sizes, posteriors, here)
    refined = [] if between is None else [solve_with_scales(linear, spike, between, bounds)]
    return sorted([*posteriors.values(), *refined], key=lambda one: one.s)


def _interpolate_peak(sizes: Array, posteriors: Mapping[int, Posterior], here: int) -> float | None:
    """Interpolate the size of unexplained torque of most evidence, by a parabola in its logarithm through the best size
    and its neighbours; None at an end of the sizes. On the grid alone two nearly equal fits may take neighbouring
    sizes, between which the evidence that they are compared by changes by some six nats."""
    if not (0 < here < len(sizes) - 1 and sizes[here - 1] > 0.0):
        return None
    below, peak, above = (posteriors[k].evidence for k in (here - 1, here, here + 1))
    bend = below - 2.0 * peak + above
    if bend >= 0.0:
        return None
    return float(sizes[here] * (sizes[here + 1] / sizes[here]) ** (0.5 * (below - above) / bend))


def solve_with_scales(
    linear: LinearModel, spike: Array, s: float, bounds: Bounds | None = None, reach: float = np.inf
) -> Posterior:
    """Compute the posterior at one size of unexplained torque, with the windows reweighted until their noise scales
    converge.

    Args:
        linear: the linear model.
        spike: prior standard deviations of θ (P).
        s: size of unexplained torque.
        bounds: lowest and highest θ (P each).
        reach: trust radius about the point of measurement, in prior standard deviations; the evidence then is not that
            of the whole prior.

    Returns:
        The posterior.

    """
    reduced, nearer = linear.normal_equations(float(s)), 1.0 / (1.0 + reach**2)
    kappa2, center = reduced.scales_from_misfit(linear.chi2(float(s))), nearer * linear.theta
    about, within, width = reduced, None, np.sqrt(1.0 - nearer) * spike
    if nearer:
        about = reduced.centered_at(center)
    if bounds is not None:
        within = bounds[0] - center, bounds[1] - center
    for _ in range(LIKELIHOOD.most_reweightings):
        found = solve_at_scales(about, width, float(s), kappa2, within)
        old, kappa2 = kappa2, reduced.window_scales(found.mean + center)
        if np.abs(np.log(kappa2 / old)).max() < LIKELIHOOD.scale_tolerance:
            break
    return replace(found, mean=found.mean + center)


def solve_at_scales(
    reduced: NormalEquations,
    spike: Array,
    s: float,
    kappa2: Array,
    bounds: Bounds | None = None,
    temperature: float | None = None,
) -> Posterior:
    """Compute the posterior of θ with fixed noise scales. Within bounds it is Laplace's approximation at the mode;
    without bounds it is exact.

    Args:
        reduced: normal equations.
        spike: prior standard deviations of θ (P).
        s: size of unexplained torque.
        kappa2: squared noise scales (W).
        bounds: lowest and highest θ (P each).
        temperature: the likelihood counts as its root of this order, the prior in full; default: that of ``reduced``.

    Returns:
        The posterior.

    """
    if temperature is None:
        temperature = reduced.temperature
    return apply_laplace(reduced.sum_windows(kappa2), spike, s, kappa2, bounds, temperature)


def apply_laplace(
    summed: TotalNormalEquations, spike: Array, s: float, kappa2: Array, bounds: Bounds | None, temperature: float
) -> Posterior:
    """Compute a `solve_at_scales` from all windows together.

    Args:
        summed: normal equations of all windows.
        spike: prior standard deviations of θ (P).
        s: size of unexplained torque.
        kappa2: squared noise scales (W).
        bounds: lowest and highest θ (P each).
        temperature: the likelihood counts as its root of this order.

    Returns:
        The posterior.

    """
    N, b = summed.N / temperature, summed.b / temperature
    factor = _factorize_with_identity(N * (spike[:, None] * spike))
    mean = spike * dpotrs(factor, spike * b, lower=1)[0]
    cost = (
        summed.log_normalizer + max(summed.c - temperature * float(b @ mean), ROUNDING_FLOOR * abs(summed.c))
    ) / temperature
    if bounds is not None:
        H = N + np.diag(1.0 / spike**2)
        within = solve_box_qp(H, b, mean, bounds)
        off = within - mean
        cost += max(float(off @ H @ off), ROUNDING_FLOOR * float(np.abs(off) @ np.abs(H) @ np.abs(off)))
        mean = within
    widths = 2.0 * float(np.log(np.diagonal(factor)).sum())
    return Posterior(s, kappa2, mean, factor, spike, cost, -0.5 * (cost + widths))


def _factorize_with_identity(M: Array) -> Array:
    """Factorize M + 1 by Cholesky (lower). M is a product of columns with themselves. A diverging simulation makes a
    column so large that rounding makes M negative somewhere; there it counts as 0. LAPACK is called directly: numpy's
    checks take several times as long for matrices of this size."""
    one = np.eye(len(M))
    factor, failed = dpotrf(M + one, lower=1)
    if failed:
        values, vectors = eigh(M)
        factor, failed = dpotrf((vectors * np.maximum(values, 0.0)) @ vectors.T + one, lower=1)
    return np.asarray(factor)


def compute_evidence_gain(at: Posterior, spike: Array, free: Array, slab: float = CANDIDATES.slab_width) -> float:
    """Compute the log evidence that freeing some columns adds.

    Source: Dickey, Ann. Math. Stat. 42 (1971) 204.

    Args:
        at: posterior under spikes alone.
        spike: its prior standard deviations (P).
        free: places of the columns.
        slab: prior standard deviation of a free column.

    Returns:
        The gain; minus infinity where rounding makes it undefined.

    """
    if not len(free):
        return 0.0
    D = 1.0 / slab**2 - 1.0 / spike[free] ** 2
    S, mu = at.covariance[np.ix_(free, free)], at.mean[free]
    K = np.eye(len(free)) + S * D
    sign, logdet = np.linalg.slogdet(K)
    if sign <= 0:
        return -np.inf
    return float(-0.5 * logdet + np.log(spike[free] / slab).sum() - 0.5 * (mu * D) @ np.linalg.solve(K, mu))


def compute_presence_probability(
    at: Posterior, spike: Array, free: Array, least: float, bounds: Bounds, slab: float = CANDIDATES.slab_width
) -> float:
    """Compute the probability that at least one freed column is large, each column by itself. A column that the log
    does not determine keeps its prior probability.

    Args:
        at: posterior under spikes alone.
        spike: its prior standard deviations (P).
        free: places of the columns.
        least: size that counts as large.
        bounds: lowest and highest θ (P each).
        slab: prior standard deviation of a free column.

    Returns:
        The probability.

    """
    D = 1.0 / slab**2 - 1.0 / spike[free] ** 2
    S, mu = at.covariance[np.ix_(free, free)], at.mean[free]
    K = np.eye(len(free)) + S * D
    mean, width = np.linalg.solve(K, mu), np.sqrt(np.maximum(np.diag(np.linalg.solve(K, S)), ROUNDING_FLOOR * slab**2))

    def below(size: Array | float) -> Array:
        return np.asarray(ndtr((np.clip(size, bounds[0][free], bounds[1][free]) - mean) / width))

    whole = below(np.inf) - below(-np.inf)
    small = np.where(whole > 0.0, (below(least) - below(-least)) / np.where(whole > 0.0, whole, 1.0), 1.0)
    return 1.0 - float(np.prod(small))


def score_candidate_sets(
    found: Sequence[Posterior], words: CandidateSet, hypotheses: Sequence[tuple[int, ...]]
) -> list[ScoredHypothesis]:
    """Compute each hypothesis' evidence at its best (s, κ).

    Args:
        found: posteriors under spikes alone, at several sizes s.
        words: the candidates.
        hypotheses: each a tuple of places of candidates.

    Returns:
        The hypotheses, the most probable first.

    """
    scored, spike = [], words.spike_widths
    for atoms in hypotheses:
        free = words.amplitude_columns(atoms)
        values = [at.evidence + compute_evidence_gain(at, spike, free) for at in found]
        best = int(np.argmax(values))
        scored.append(ScoredHypothesis(atoms, values[best], found[best]))
    return sorted(scored, key=lambda s: -s.evidence)
