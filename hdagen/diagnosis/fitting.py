"""A hypothesis where it stands: Newton's steps in the linear model, which is made anew about each point.

Every hypothesis begins at the robot file's own numbers. From the best fit of another it would not find its own: what
the other bent base parameters by lies behind a curved valley.

Legend: θ parameters in usual sizes; s size of unexplained torque; κ scale of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.diagnosis.candidates import SLAB, Dictionary
from hdagen.diagnosis.design import KNOTS, Design, Point, chosen, design, renewed
from hdagen.diagnosis.evidence import Scored, freed, posteriors, score
from hdagen.plant import Array

CHORDS = 3
SHARES = (1.0, 0.5, 0.2, 0.05)
ENOUGH = 1.0  # of log evidence that a step must bring for another one with the same columns


@dataclass(frozen=True, eq=False)
class Fitted:
    """A hypothesis where it stands: its design, and its score there."""

    atoms: tuple[int, ...]
    design: Design
    score: Scored
    unexplained: Array  # torque that it leaves unexplained at each joint (n), rms, in its unit

    @property
    def names(self) -> tuple[str, ...]:
        """Its effects as name@joint, sorted; empty for none."""
        return tuple(sorted(self.design.words.atoms[k].name for k in self.atoms))

    @property
    def posterior(self) -> tuple[Array, Array]:
        """Mean and covariance of θ."""
        words = self.design.words
        return freed(self.score.at, words.spike, words.free(self.atoms))


def begun(at: Design, words: Dictionary, atoms: tuple[int, ...], near: float, start: Point | None = None) -> Fitted:
    """A hypothesis in the columns of ``at``, at its point with the shapes where its atoms have them; or at ``start``,
    with columns made anew there. ``near``: a size of unexplained torque to begin from."""
    own = chosen(at, words.focused(atoms))
    if start is not None:
        there = own.moved(start)
        return _scored(renewed(there, words.about(at.shooting.arm, atoms, start.p), start), atoms, near)
    names, p = list(at.shooting.arm.parameters.described), at.point.p.copy()
    for k in atoms:
        for name, value in words.atoms[k].shapes.items():
            p[names.index(name)] = value
    own.point = Point(p, at.point.begun)
    return _scored(own, atoms, near)


def advanced(fit: Fitted, words: Dictionary, every: bool = False) -> Fitted:
    """A hypothesis one step further, its columns made anew there: its own, or ``every`` one. As it was where no step
    helps."""
    there = descend(fit.design, fit.atoms, fit.score)
    own = words.about(there.shooting.arm, fit.atoms, there.point.p)
    made = design(there.shooting, own, there.point) if every else renewed(there, own, there.point)
    return _scored(made, fit.atoms, fit.score.at.s)


def _scored(at: Design, atoms: tuple[int, ...], near: float) -> Fitted:
    linear = at.linear()
    best = score(posteriors(linear, at.words.spike, near), at.words, [atoms])[0]
    mean, _ = freed(best.at, at.words.spike, at.words.free(atoms))
    return Fitted(atoms, at, best, _by_joint(at, linear.inner(best.at.s, mean)[1]))


def _by_joint(at: Design, torque: Array) -> Array:
    """Root mean square of torques (W, k) at each joint (n), at its motor and its link together."""
    arm = at.shooting.arm
    owners = np.repeat([*range(1, arm.n + 1), *arm.manifest["flexible"]], KNOTS)
    if not torque.shape[1]:
        return np.zeros(arm.n)
    return np.array([np.sqrt(np.mean(torque[:, owners == j] ** 2)) for j in range(1, arm.n + 1)])


def descend(at: Design, atoms: tuple[int, ...], lead: Scored) -> Design:
    """Newton's steps with the columns kept, towards the most probable point of a hypothesis."""
    words, s, kappa2 = at.words, lead.at.s, lead.at.kappa2
    prior = words.spike
    prior[words.free(atoms)] = SLAB
    linear = at.linear()
    reduced = linear.reduced(s)
    cost = reduced.cost(words.theta(at.point.p), kappa2, prior)
    factor = np.linalg.inv(reduced.N / kappa2 + np.diag(1.0 / prior**2)) / kappa2
    for _ in range(CHORDS):
        theta, old = factor @ reduced.b, words.theta(at.point.p)
        begun = linear.inner(s, theta)[0]
        for share in SHARES:
            point = placed(at, old + share * (theta - old), at.point.begun + share * begun)
            trial = at.moved(point)
            there = trial.linear()
            other = there.reduced(s)
            value = other.cost(words.theta(point.p), kappa2, prior)
            if value < cost:
                break
        else:
            break
        gain, at, linear, reduced, cost = cost - value, trial, there, other, value
        if gain < ENOUGH:
            break
    return at


def placed(at: Design, theta: Array, begun: Array) -> Point:
    """The point at θ within the bounds. What is not meant moves too: a twentieth of an effect is far above the noise,
    and its column tells it only roughly."""
    described = list(at.shooting.arm.parameters.described.values())
    p = at.point.p.copy()
    for value, c in zip(theta, at.words.columns, strict=True):
        q = described[c.index]
        p[c.index] = min(max(c.center + float(value) * c.unit, q.low), q.high)
    return Point(p, begun)


def rms(at: Design) -> Array:
    """Of each channel, in units of noise (M)."""
    return np.asarray(np.sqrt((at.residual**2).mean(0)).round(2))
