"""The search: hypotheses are compared in the linear model; those that lead are fitted where they stand.

Legend: θ parameters in usual sizes; s size of unexplained torque; κ scale of the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.diagnosis.candidates import SLAB, Dictionary
from hdagen.diagnosis.design import Design, Point, design, renewed
from hdagen.diagnosis.evidence import Scored, freed, posteriors, score
from hdagen.diagnosis.linear import Linear
from hdagen.diagnosis.shooting import Shooting
from hdagen.plant import Array

CHORDS = 3
SHARES = (1.0, 0.5, 0.2)
ROUNDS = 3
KEEP = 5
MARGIN = 15.0  # of log evidence below the leader's, in the linear model, from where an effect is not fitted


def first_states(linear: Linear, s: float, theta: Array) -> Array:
    """Change of the first states (W, m) that goes with θ, unexplained torque of size s allowed."""
    m, k = linear.m, linear.k
    inner = np.arange(m + (k if s > 0 else 0))
    scale = np.concatenate([np.ones(m), np.full(len(inner) - m, s)])
    A = linear.products[:, inner[:, None], inner] * scale[:, None] * scale
    d = range(m, len(inner))
    A[:, d, d] += 1.0
    outer = np.arange(m + k, linear.products.shape[1] - 1)
    rhs = linear.products[:, inner, -1] - linear.products[:, inner[:, None], outer] @ theta
    return np.asarray(np.linalg.solve(A, (rhs * scale)[..., None])[:, :m, 0])


def placed(at: Design, theta: Array, begun: Array, atoms: tuple[int, ...]) -> Point:
    """The point at θ within the bounds: base parameters and what is free; the others stay where they are."""
    described = list(at.shooting.arm.parameters.described.values())
    p = at.point.p.copy()
    for value, c in zip(theta, at.words.columns, strict=True):
        if c.base or c.atom in atoms:
            q = described[c.index]
            p[c.index] = min(max(c.center + float(value) * c.unit, q.low), q.high)
    return Point(p, begun)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A hypothesis where it stands: its design, and its score there."""

    atoms: tuple[int, ...]
    design: Design
    score: Scored

    @property
    def posterior(self) -> tuple[Array, Array]:
        """Mean and covariance of θ."""
        words = self.design.words
        return freed(self.score.at, words.spike, words.free(self.atoms))


def descend(at: Design, atoms: tuple[int, ...], lead: Scored) -> Design:
    """Newton's steps with the columns kept, towards the most probable point of a hypothesis."""
    words, s, kappa2 = at.words, lead.at.s, lead.at.kappa2
    prior = words.spike
    prior[words.free(atoms)] = SLAB
    linear = at.linear()
    reduced = linear.reduced(np.full(linear.k, s))
    cost = reduced.cost(words.theta(at.point.p), kappa2, prior)
    factor = np.linalg.inv(reduced.N / kappa2 + np.diag(1.0 / prior**2)) / kappa2
    for _ in range(CHORDS):
        theta, old = factor @ reduced.b, words.theta(at.point.p)
        begun = first_states(linear, s, theta)
        for share in SHARES:
            point = placed(at, old + share * (theta - old), at.point.begun + share * begun, atoms)
            trial = at.moved(point)
            there = trial.linear()
            other = there.reduced(np.full(linear.k, s))
            value = other.cost(words.theta(point.p), kappa2, prior)
            if value < cost:
                break
        else:
            break
        gain, at, linear, reduced, cost = cost - value, trial, there, other, value
        if gain < 1.0:
            break
    return at


def rms(at: Design) -> Array:
    """Of each channel, in units of noise (M)."""
    return np.asarray(np.sqrt((at.residual**2).mean(0)).round(2))


def fit(start: Design, words: Dictionary, atoms: tuple[int, ...], rounds: int) -> Fitted:
    """A hypothesis fitted from a design: its own columns made anew where it stands, round after round."""
    arm = start.shooting.arm
    names = list(arm.parameters.described)
    p = start.point.p.copy()
    for k in atoms:
        for name, value in words.atoms[k].shapes.items():
            p[names.index(name)] = value
    at, point = start, Point(p, start.point.begun)
    best: Fitted | None = None
    for r in range(rounds):
        own = words.focused(arm, atoms, point.p)
        at = renewed(at if r else start, own, point, base=r > 0)
        now = scored(at, atoms)
        if best is None or now.score.evidence > best.score.evidence:
            best = now
        if r == rounds - 1:
            break
        before, at = at, descend(at, atoms, now.score)
        if at is before:
            break
        point = at.point
    assert best is not None
    return best


def scored(at: Design, atoms: tuple[int, ...]) -> Fitted:
    """A hypothesis at the point of its design."""
    found = posteriors(at.linear(), at.words.spike)
    return Fitted(atoms, at, score(found, at.words, [atoms])[0])


def screen(at: Design, hypotheses: Sequence[tuple[int, ...]]) -> list[Scored]:
    """All hypotheses in one linear model."""
    return score(posteriors(at.linear(), at.words.spike), at.words, hypotheses)


@dataclass(frozen=True, eq=False)
class Search:
    """``fitted``: none and the leading effects where they stand, the most probable first; ``screened``: every effect in
    the linear model about the robot file's own structure."""

    words: Dictionary
    fitted: tuple[Fitted, ...]
    screened: tuple[Scored, ...]


def search(shooting: Shooting, words: Dictionary, say: Callable[[str], None]) -> Search:
    """None first, then every effect in one linear model, then those that lead, each where it stands."""
    record = shooting.record
    point = Point(shooting.arm.p.copy(), record.begun[:, : shooting.m].copy())
    for round_ in range(2):
        say(f"base parameters, round {round_ + 1} of 2")
        at = design(shooting, words.base, point)
        point = descend(at, (), scored(at, ()).score).point
    say(f"screening {len(words.atoms)} candidates")
    at = design(shooting, words, point)
    screened = screen(at, [(), *((k,) for k in range(len(words.atoms)))])
    leaders = shortlist(words, screened)
    fits = []
    for number, s in enumerate(leaders, 1):
        what = words.atoms[s.atoms[0]].name if s.atoms else "none"
        say(f"fitting {what}, {number} of {len(leaders)}")
        fits.append(fit(at, words, s.atoms, ROUNDS))
    return Search(words, tuple(sorted(fits, key=lambda f: -f.score.evidence)), tuple(screened))


def shortlist(words: Dictionary, screened: list[Scored]) -> list[Scored]:
    """None, and the best atom of each of the leading effects."""
    found: dict[tuple[str, ...], Scored] = {}
    for s in screened:
        found.setdefault(tuple(words.atoms[k].name for k in s.atoms), s)
    best = screened[0].evidence
    near = [s for s in found.values() if s.atoms and s.evidence > best - max(MARGIN, MARGIN * screened[0].at.s * 100)]
    return [s for s in found.values() if not s.atoms] + near[:KEEP]
