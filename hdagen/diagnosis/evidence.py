"""The evidence for every hypothesis from one linear model: which effects are free, all others within a small tolerance.

The posterior of θ under spikes alone, N(μ, Σ), gives every hypothesis in closed form: freeing the columns A changes
their prior precision by D, and the evidence by

    |I + Σ_A D|^(−1/2) · (|V_spike| / |V_slab|)^(1/2) · exp(−½ μ_A' D (I + Σ_A D)⁻¹ μ_A).

Each hypothesis chooses its own size s of unexplained torque and scale κ of what each window leaves.
Source: Dickey, Ann. Math. Stat. 42 (1971) 204 (the ratio of nested evidences); George, McCulloch, J. Am. Stat. Assoc.
88 (1993) 881 (spike and slab); Miller, Dunson, J. Am. Stat. Assoc. 114 (2019) 1113 (a likelihood that counts less, as
no model is true).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import eigh
from scipy.linalg.lapack import dpotrf, dpotrs
from scipy.special import ndtr

from hdagen.diagnosis.bounds import Bounds, bounded
from hdagen.diagnosis.candidates import SLAB, Dictionary
from hdagen.diagnosis.linear import ROUNDED, Linear, Reduced, Summed
from hdagen.plant import Array
from hdagen.together import together

TORQUES = np.concatenate([[0.0], np.geomspace(1e-3, 1e2, 41)])  # s, in units of unexplained torque
ROUGHLY = 8  # every which of them a first look takes
STRIDES = 2, 1  # in which a closer look goes
SCALES = 12  # at most, times that the windows are weighed anew
STILL = 0.05  # change of log κ² below which they are not


@dataclass(frozen=True, eq=False)
class Posterior:
    """θ at one s and κ² (W): mean, or most probable within bounds (P), minus twice the log posterior there but for the
    constant of its prior, log evidence. The factor (P, P, lower) is that of the inverse covariance in units of the
    prior's standard deviations ``spike`` (P)."""

    s: float
    kappa2: Array
    mean: Array
    factor: Array
    spike: Array
    cost: float
    evidence: float

    @cached_property
    def covariance(self) -> Array:
        """Of θ (P, P): few ask for it."""
        inverse = dpotrs(self.factor, np.eye(len(self.spike)), lower=1)[0]
        return np.asarray(inverse * (self.spike[:, None] * self.spike))

    def worth(self, prior: Array, own: Array) -> float:
        """Log evidence in which only the columns ``own`` pay Occam's factor: what all hypotheses have alike, a column
        tells here a little better and there a little worse, and together that is more than what parts them."""
        width = prior[own]
        return -0.5 * (
            self.cost - float(np.linalg.slogdet(self.covariance[np.ix_(own, own)] / width / width[:, None])[1])
        )

    @property
    def level(self) -> float:
        """Scale of the noise, squared, joined over the windows (geometric mean)."""
        return float(np.exp(np.log(self.kappa2).mean()))


@dataclass(frozen=True, eq=False)
class Scored:
    """A hypothesis: its atoms, log evidence, and the posterior in which it is best; ``large``: the probability that
    what it means is as large as counts as present."""

    atoms: tuple[int, ...]
    evidence: float
    at: Posterior
    large: float = 1.0


def posteriors(
    linear: Linear,
    spike: Array,
    near: float | None = None,
    bounds: Bounds | None = None,
) -> list[Posterior]:
    """The posterior at sizes s of unexplained torque a decade apart, each window at the scale of what it leaves; with
    ``near`` from that one on to where it is best: evidence answers to a third of s with as much as parts hypotheses."""
    sizes = TORQUES[min(int(np.searchsorted(TORQUES, linear.least)), len(TORQUES) - 1) :]
    if near is None:
        return together(lambda s: settled(linear, spike, s, bounds), sizes[::ROUGHLY].tolist())
    here = int(np.argmin(np.abs(sizes - near)))
    made = {here: settled(linear, spike, sizes[here], bounds)}
    for step in (sign * stride for stride in STRIDES for sign in (-1, 1)):
        while 0 <= here + step < len(sizes):
            if here + step not in made:
                made[here + step] = settled(linear, spike, sizes[here + step], bounds)
            if made[here + step].evidence <= made[here].evidence:
                break
            here += step
    return [made[k] for k in sorted(made)]


def settled(linear: Linear, spike: Array, s: float, bounds: Bounds | None = None, reach: float = np.inf) -> Posterior:
    """The posterior at one size of unexplained torque, the windows weighed anew until their scales stand. ``reach``:
    prior standard deviations, within which it stays near the point where the model was measured; the evidence is then
    none of the whole."""
    reduced, nearer = linear.reduced(float(s)), 1.0 / (1.0 + reach**2)
    kappa2, center = reduced.scaled(linear.chi2(float(s))), nearer * linear.theta
    about, width = reduced.about(center) if nearer else reduced, np.sqrt(1.0 - nearer) * spike
    within = None if bounds is None else (bounds[0] - center, bounds[1] - center)
    for _ in range(SCALES):
        found = posterior(about, width, float(s), kappa2, within)
        old, kappa2 = kappa2, reduced.scales(found.mean + center)
        if np.abs(np.log(kappa2 / old)).max() < STILL:
            break
    return replace(found, mean=found.mean + center)


def posterior(
    reduced: Reduced,
    spike: Array,
    s: float,
    kappa2: Array,
    bounds: Bounds | None = None,
    temperature: float | None = None,
) -> Posterior:
    """θ under prior standard deviations ``spike`` (P), the windows at scales ``kappa2`` (W). With ``bounds`` the most
    probable θ lies within them, and the evidence is that of Laplace's approximation there; without, it is exact. The
    likelihood counts as its root of order ``temperature`` (default: that of ``reduced``), the prior as it is."""
    temperature = reduced.temperature if temperature is None else temperature
    return laplace(reduced.summed(kappa2), spike, s, kappa2, bounds, temperature)


def laplace(
    summed: Summed, spike: Array, s: float, kappa2: Array, bounds: Bounds | None, temperature: float
) -> Posterior:
    """A `posterior` from all windows together."""
    N, b = summed.N / temperature, summed.b / temperature
    factor = _factor(N * (spike[:, None] * spike))
    mean = spike * dpotrs(factor, spike * b, lower=1)[0]
    cost = (summed.log + max(summed.c - temperature * float(b @ mean), ROUNDED * abs(summed.c))) / temperature
    if bounds is not None:
        H = N + np.diag(1.0 / spike**2)
        within = bounded(H, b, mean, bounds)
        off = within - mean
        cost += max(float(off @ H @ off), ROUNDED * float(np.abs(off) @ np.abs(H) @ np.abs(off)))
        mean = within
    widths = 2.0 * float(np.log(np.diagonal(factor)).sum())
    return Posterior(s, kappa2, mean, factor, spike, cost, -0.5 * (cost + widths))


def _factor(M: Array) -> Array:
    """Cholesky factor (lower) of M + 1. M is a product of columns with themselves: where one is so large, as a
    simulation flies apart, that rounding makes it negative somewhere, it is 0 there. LAPACK as it is: what checks and
    wraps it takes several times as long for matrices of this size, thousands of times."""
    one = np.eye(len(M))
    factor, failed = dpotrf(M + one, lower=1)
    if failed:
        values, vectors = eigh(M)
        factor, failed = dpotrf((vectors * np.maximum(values, 0.0)) @ vectors.T + one, lower=1)
    return np.asarray(factor)


def gain(at: Posterior, spike: Array, free: Array, slab: float = SLAB) -> float:
    """How much log evidence freeing the columns ``free`` adds."""
    D = 1.0 / slab**2 - 1.0 / spike[free] ** 2
    S, mu = at.covariance[np.ix_(free, free)], at.mean[free]
    K = np.eye(len(free)) + S * D
    sign, logdet = np.linalg.slogdet(K)
    if sign <= 0:
        return -np.inf
    return float(-0.5 * logdet + np.log(spike[free] / slab).sum() - 0.5 * (mu * D) @ np.linalg.solve(K, mu))


def large(at: Posterior, spike: Array, free: Array, least: float, bounds: Bounds, slab: float = SLAB) -> float:
    """The probability that one of the columns ``free``, freed and within ``bounds``, is ``least`` or larger, each by
    itself. A column of which the log tells nothing is as likely so as its prior says."""
    D = 1.0 / slab**2 - 1.0 / spike[free] ** 2
    S, mu = at.covariance[np.ix_(free, free)], at.mean[free]
    K = np.eye(len(free)) + S * D
    mean, width = np.linalg.solve(K, mu), np.sqrt(np.maximum(np.diag(np.linalg.solve(K, S)), ROUNDED * slab**2))

    def below(size: Array | float) -> Array:
        return np.asarray(ndtr((np.clip(size, bounds[0][free], bounds[1][free]) - mean) / width))

    whole = below(np.inf) - below(-np.inf)
    small = np.where(whole > 0.0, (below(least) - below(-least)) / np.where(whole > 0.0, whole, 1.0), 1.0)
    return 1.0 - float(np.prod(small))


def score(found: Sequence[Posterior], words: Dictionary, hypotheses: Sequence[tuple[int, ...]]) -> list[Scored]:
    """Every hypothesis (a tuple of atoms) at its best (s, κ), the best first."""
    scored, spike = [], words.spike
    for atoms in hypotheses:
        free = words.free(atoms)
        values = [at.evidence + (gain(at, spike, free) if len(free) else 0.0) for at in found]
        best = int(np.argmax(values))
        scored.append(Scored(atoms, values[best], found[best]))
    return sorted(scored, key=lambda s: -s.evidence)
