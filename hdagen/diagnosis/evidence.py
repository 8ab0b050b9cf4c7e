"""The evidence for every hypothesis from one linear model: which effects are free, all others within a small tolerance.

The posterior of θ under spikes alone, N(μ, Σ), gives every hypothesis in closed form: freeing the columns A changes
their prior precision by D, and the evidence by

    |I + Σ_A D|^(−1/2) · (|V_spike| / |V_slab|)^(1/2) · exp(−½ μ_A' D (I + Σ_A D)⁻¹ μ_A).

Each hypothesis chooses its own size s of unexplained torque and scale κ of the noise.
Source: Dickey, Ann. Math. Stat. 42 (1971) 204 (the ratio of nested evidences); George, McCulloch, J. Am. Stat. Assoc.
88 (1993) 881 (spike and slab).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from hdagen.diagnosis.candidates import SLAB, Dictionary
from hdagen.diagnosis.linear import Linear, Reduced
from hdagen.plant import Array

TORQUES = np.concatenate([[0.0], np.geomspace(1e-3, 1e2, 11)])  # s, in units of unexplained torque
MOST_CHANGES = 20  # of what is held at its bounds
SCALES = 3  # of the noise that are tried at each s


@dataclass(frozen=True, eq=False)
class Posterior:
    """θ at one (s, κ): mean, or most probable within bounds (P), covariance (P, P), log evidence."""

    s: float
    kappa2: float
    mean: Array
    covariance: Array
    evidence: float
    left: float  # chi² per degree of freedom


@dataclass(frozen=True, eq=False)
class Scored:
    """A hypothesis: its atoms, log evidence, and the posterior in which it is best."""

    atoms: tuple[int, ...]
    evidence: float
    at: Posterior


Bounds = tuple[Array, Array]  # lowest and highest θ (P)


def posteriors(
    linear: Linear,
    spike: Array,
    near: float | None = None,
    bounds: Bounds | None = None,
) -> list[Posterior]:
    """The posterior at every size s of unexplained torque, each with the noise as stated and as large as it looks; with
    ``near`` at the sizes about that one, as far as they get better."""
    if near is None:
        return [one for s in TORQUES for one in _at(linear, spike, s, bounds)]
    here = int(np.argmin(np.abs(TORQUES - near)))
    made = {k: _at(linear, spike, TORQUES[k], bounds) for k in range(max(here - 1, 0), min(here + 2, len(TORQUES)))}
    best = {k: max(one.evidence for one in found) for k, found in made.items()}
    for step in (-1, 1):
        k = here + step
        while k in best and best[k] == max(best.values()) and 0 <= k + step < len(TORQUES):
            k += step
            made[k] = _at(linear, spike, TORQUES[k], bounds)
            best[k] = max(one.evidence for one in made[k])
    return [one for k in sorted(made) for one in made[k]]


def _at(linear: Linear, spike: Array, s: float, bounds: Bounds | None) -> list[Posterior]:
    """The posterior at one size of unexplained torque, with the noise as stated and as large as it looks."""
    reduced, found = linear.reduced(float(s)), []
    kappa2 = 1.0
    for _ in range(SCALES):
        found.append(posterior(reduced, spike, float(s), kappa2, bounds))
        left = found[-1].left
        if left < 1.05 * kappa2:
            break
        kappa2 = left
    return found


def posterior(reduced: Reduced, spike: Array, s: float, kappa2: float, bounds: Bounds | None = None) -> Posterior:
    """θ under prior standard deviations ``spike`` (P). With ``bounds`` the most probable θ lies within them, and the
    evidence is that of Laplace's approximation there; without, it is exact."""
    V = spike[:, None] * spike
    factor = scipy.linalg.cho_factor(reduced.N * V / kappa2 + np.eye(len(spike)), lower=True)
    covariance = scipy.linalg.cho_solve(factor, np.eye(len(spike))) * V
    mean = covariance @ reduced.b / kappa2
    log = -0.5 * (
        (reduced.c - float(reduced.b @ mean)) / kappa2
        + 2.0 * float(np.log(np.diagonal(factor[0])).sum())
        + reduced.logdet
        + reduced.freedom * np.log(kappa2)
    )
    if bounds is not None:
        within = bounded(reduced, kappa2, spike, mean, bounds)
        log -= 0.5 * (reduced.cost(within, kappa2, spike) - reduced.cost(mean, kappa2, spike))
        mean = within
    chi2 = reduced.c - 2 * float(reduced.b @ mean) + float(mean @ reduced.N @ mean)
    return Posterior(s, kappa2, mean, covariance, log, chi2 / reduced.freedom)


def bounded(reduced: Reduced, kappa2: float, prior: Array, free: Array, bounds: Bounds) -> Array:
    """The most probable θ within ``bounds``, ``free`` being that without them.

    What leaves its bounds is held there, and let go again where its slope points inwards; the rest is solved anew.
    """
    low, high = bounds
    H, g = reduced.N / kappa2 + np.diag(1.0 / prior**2), reduced.b / kappa2
    theta, held = free.copy(), np.zeros(len(free), bool)
    for _ in range(MOST_CHANGES):
        outside = ~held & ((theta < low) | (theta > high))
        slope = H @ theta - g
        back = held & np.where(theta <= low, slope < 0, slope > 0) & (low < high)
        if not outside.any() and not back.any():
            break
        held = (held & ~back) | outside
        theta = np.clip(theta, low, high)
        left = ~held
        theta[left] = np.linalg.solve(H[np.ix_(left, left)], g[left] - H[np.ix_(left, held)] @ theta[held])
    return np.clip(theta, low, high)


def gain(at: Posterior, spike: Array, free: Array, slab: float = SLAB) -> float:
    """How much log evidence freeing the columns ``free`` adds."""
    D = 1.0 / slab**2 - 1.0 / spike[free] ** 2
    S, mu = at.covariance[np.ix_(free, free)], at.mean[free]
    K = np.eye(len(free)) + S * D
    sign, logdet = np.linalg.slogdet(K)
    if sign <= 0:
        return -np.inf
    return float(-0.5 * logdet + np.log(spike[free] / slab).sum() - 0.5 * (mu * D) @ np.linalg.solve(K, mu))


def freed(at: Posterior, spike: Array, free: Array, slab: float = SLAB) -> tuple[Array, Array]:
    """Mean (P) and covariance (P, P) of θ with the columns ``free`` free."""
    if not len(free):
        return at.mean, at.covariance
    D = 1.0 / slab**2 - 1.0 / spike[free] ** 2
    S = at.covariance[:, free]
    K = np.eye(len(free)) + at.covariance[np.ix_(free, free)] * D
    change = S @ (D[:, None] * np.linalg.inv(K))
    return at.mean - change @ at.mean[free], at.covariance - change @ S.T


def score(found: Sequence[Posterior], words: Dictionary, hypotheses: Sequence[tuple[int, ...]]) -> list[Scored]:
    """Every hypothesis (a tuple of atoms) at its best (s, κ), the best first."""
    scored, spike = [], words.spike
    for atoms in hypotheses:
        free = words.free(atoms)
        values = [at.evidence + (gain(at, spike, free) if len(free) else 0.0) for at in found]
        best = int(np.argmax(values))
        scored.append(Scored(atoms, values[best], found[best]))
    return sorted(scored, key=lambda s: -s.evidence)
