"""The decision: probabilities of the hypotheses, what counts as present, and what no effect explains.

Log evidence is divided by TEMPERATURE before it becomes a probability: residuals of a real machine are not independent.
The temperature is not calibrated yet, and diagnosis.json says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.diagnosis.candidates import PRESENT
from hdagen.diagnosis.search import Fitted, Search
from hdagen.plant import Array

TEMPERATURE = 3.0
NONE = 0.5  # prior probability of no effect
UNKNOWN = 1.0  # size of unexplained torque, in its unit (2 % of the usual motor torque), from where a gap is left
SURE = 0.1  # probability of what else it may be, above which a verdict is not sure


@dataclass(frozen=True, eq=False)
class Decision:
    """``names`` of the hypotheses ("" is none) with ``probability``; ``verdict`` as diagnosis.json has it; ``best`` the
    fit that the verdict stands on; ``present``: whether the size of each hypothesis counts."""

    names: tuple[str, ...]
    probability: Array
    verdict: tuple[str, ...]
    best: Fitted
    fits: tuple[Fitted | None, ...]

    @property
    def sure(self) -> bool:
        """Whether nothing else holds more than a tenth of the probability."""
        return float(np.sort(self.probability)[:-1].sum()) <= SURE and not any("unknown" in v for v in self.verdict)


def size(fit: Fitted) -> float:
    """Of the effect that is free, in usual sizes; 0 for none."""
    free = fit.design.words.free(fit.atoms)
    return float(np.abs(fit.posterior[0][free]).max()) if len(free) else 0.0


def decide(search: Search) -> Decision:
    """Probabilities over none and every effect on every joint, and the verdict."""
    words = search.words
    own: dict[str, tuple[float, Fitted | None]] = {}
    for fit in search.fitted:
        name = words.atoms[fit.atoms[0]].name if fit.atoms else ""
        own[name] = fit.score.evidence, fit
    nothing = own[""][0]
    linear = next(s.evidence for s in search.screened if not s.atoms)
    for s in search.screened:
        name = words.atoms[s.atoms[0]].name if s.atoms else ""
        own.setdefault(name, (nothing + s.evidence - linear, None))
    names = tuple(own)
    evidence = np.array([own[name][0] for name in names]) / TEMPERATURE
    prior = np.array([NONE if not name else (1 - NONE) / (len(names) - 1) for name in names])
    weight = prior * np.exp(evidence - evidence.max())
    none = names.index("")
    for k, name in enumerate(names):
        fit_ = own[name][1]
        if name and fit_ is not None and size(fit_) < PRESENT:  # too small to count: the same as none
            weight[none] += weight[k]
            weight[k] = 0.0
    probability = weight / weight.sum()
    order = np.argsort(-probability, kind="stable")
    best = next(own[names[k]][1] for k in order if own[names[k]][1] is not None)
    assert best is not None
    lead = words.atoms[best.atoms[0]].name if best.atoms else ""
    verdict = (lead,) if lead else ()
    if best.score.at.s >= UNKNOWN:
        verdict = (f"unknown@{worst_joint(best)}",)
    sort = [int(k) for k in order]
    return Decision(
        tuple(names[k] for k in sort), probability[sort], verdict, best, tuple(own[names[k]][1] for k in sort)
    )


def worst_joint(fit: Fitted) -> int:
    """The joint whose unexplained torque is largest."""
    linear, s = fit.design.linear(), fit.score.at.s
    m, k, n = linear.m, linear.k, fit.design.shooting.arm.n
    inner = np.arange(m + k)
    scale = np.concatenate([np.ones(m), np.full(k, s)])
    A = linear.products[:, inner[:, None], inner] * scale[:, None] * scale
    A[:, range(m, m + k), range(m, m + k)] += 1.0
    theta = fit.posterior[0]
    rhs = (
        linear.products[:, inner, -1] - linear.products[:, inner[:, None], np.arange(m + k, m + k + len(theta))] @ theta
    )
    torque = np.linalg.solve(A, (rhs * scale)[..., None])[:, m:, 0]
    flexible = fit.design.shooting.arm.manifest["flexible"]
    owners = np.repeat([*range(1, n + 1), *flexible], k // (n + len(flexible)))
    return int(max(range(1, n + 1), key=lambda j: float((torque[:, owners == j] ** 2).sum())))
