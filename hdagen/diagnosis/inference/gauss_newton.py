"""Gauss-Newton steps of a hypothesis with its sensitivities kept.

Source: Marquardt, J. Soc. Indust. Appl. Math. 11 (1963) 431 (steps limited to where the linear model holds).
Legend: θ parameters in typical sizes (P); s size of unexplained torque; W windows, m positions and velocities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.candidate_priors import SLAB, Atom, Dictionary, is_broad
from hdagen.diagnosis.inference.linear_gaussian import Linear
from hdagen.diagnosis.inference.marginal_likelihood import Scored, settled
from hdagen.diagnosis.inference.sensitivities import Design, Point

CHORDS = 3  # steps with one set of sensitivities
REACHES = (np.inf, 0.3, 0.1, 0.03)  # trust radii of a step, in prior standard deviations
KEPT = 0.25  # of the promised improvement, with which a step is accepted without a smaller radius
WORSE = 4.0  # by which chi² of a window may grow before its initial state is restored
FAR = 2.0  # times the chi² expected of noise, from which a window begins anew at the measured state
ENOUGH = 0.1  # log evidence that a step must bring, or promise, for another one


def descend(at: Design, atoms: tuple[int, ...], lead: Scored, share: float) -> Design:
    """Take Gauss-Newton steps towards the mode of a hypothesis, with the columns kept. A direction that the columns
    hardly determine is a valley along which a full step would go much too far, so the trust radius limits each step.

    Args:
        at: design with the hypothesis' columns.
        atoms: places of its candidates.
        lead: its score, with the size of unexplained torque.
        share: of that torque, that the steps allow.

    Returns:
        The design at the last point; ``at`` itself where no step helped.

    """
    words, s, prior = at.words, share * lead.at.s, prior_widths(at, atoms)
    at = _freed(at, s)
    bounds, linear = words.bounds(at.shooting.arm), at.linear()
    cost = linear.cost(s, prior)
    for _ in range(CHORDS):
        best = cost, at, linear
        for reach in REACHES:
            theta = settled(linear, prior, s, bounds, reach).mean
            promised = cost - linear.reduced(s).cost(theta, prior)
            trial, there = try_point(at, linear, s, move_to(at, linear, s, theta))
            value = there.cost(s, prior)
            worse = best[0] <= value
            if not worse:
                best = value, trial, there
            if cost - value >= KEPT * promised or (worse and best[1] is not at):
                break
        gain, (cost, at, linear) = cost - best[0], best
        if gain < ENOUGH:
            break
    return at


def _freed(at: Design, s: float) -> Design:
    """Restart badly predicted windows from the measured states, where that is better. Small steps cannot move an
    initial state to the other side of a reversal or of backlash."""
    linear = at.linear()
    kept, left = at.shooting.record.kept, linear.chi2(s)
    far = left > FAR * linear.reduced(s).freedom
    if not far.any():
        return at
    begun = at.point.begun.copy()
    begun[kept[far]] = at.shooting.begun(at.point.p)[kept[far]]
    again = at.moved(at.point.with_begun(begun)).linear()
    stays = again.chi2(s) > left - WORSE
    begun[kept[stays]] = at.point.begun[kept[stays]]
    return at.moved(at.point.with_begun(begun)) if (far & ~stays).any() else at


def move_to(at: Design, linear: Linear, s: float, theta: Array) -> Point:
    """Return the point at θ, with each window's initial state at its optimum for that θ.

    Args:
        at: design with its point.
        linear: its linear model.
        s: size of unexplained torque.
        theta: θ (P).

    """
    begun = at.point.begun.copy()
    begun[at.shooting.record.kept] += linear.inner(s, theta)[0]
    return placed(at, theta, begun)


def try_point(at: Design, linear: Linear, s: float, point: Point) -> tuple[Design, Linear]:
    """Simulate a point. A window that its new initial state makes worse keeps the old one: where a joint sticks, or the
    simulation diverges, the columns say little.

    Args:
        at: design about the old point.
        linear: its linear model.
        s: size of unexplained torque.
        point: the new point.

    Returns:
        The design at the new point, and its linear model.

    """
    trial = at.moved(point)
    there = trial.linear()
    left = [one.chi2(s) for one in (linear, there)]
    worse = at.shooting.record.kept[left[1] > left[0] + WORSE]
    if not len(worse):
        return trial, there
    begun = point.begun.copy()
    begun[worse] = at.point.begun[worse]
    trial = at.moved(trial.point.with_begun(begun))
    return trial, trial.linear()


def placed(at: Design, theta: Array, begun: Array) -> Point:
    """Return the point at θ, within the parameters' bounds. Nuisance effects move, too: they may be far above the
    noise, where their columns are only approximate.

    Args:
        at: design with its point.
        theta: θ (P).
        begun: initial states (W, m).

    """
    p = at.point.p.copy()
    for value, c in zip(theta, at.words.columns, strict=True):
        p[c.index] = c.center + float(value) * c.unit
    return Point(at.shooting.arm.parameters.within(p), begun)


def prior_widths(at: Design, atoms: tuple[int, ...]) -> Array:
    """Return the prior standard deviations of θ (P) with the effects of a hypothesis free.

    Args:
        at: design with its point.
        atoms: places of the hypothesis' candidates.

    """
    return widths(at, at.words.free(atoms), at.point)


def widths(at: Design, free: NDArray[np.intp], point: Point) -> Array:
    """Return the prior standard deviations of θ (P) with some columns free. A parameter whose size spans orders of
    magnitude has a prior as wide as its present size, if that is more than typical.

    Args:
        at: design with the columns.
        free: places of the free columns.
        point: where the present sizes are taken.

    """
    prior = at.words.spike
    described = list(at.shooting.arm.parameters.described.values())
    broad = np.array([is_broad(described[at.words.columns[k].index]) for k in free], bool)
    prior[free] = np.where(broad, np.maximum(np.abs(at.words.theta(point.p)[free]), SLAB), SLAB)
    return prior


def put_sizes(at: Design, words: Dictionary, atoms: tuple[int, ...], theta: Array) -> Point:
    """Return the point of ``at`` with some candidates in their shapes and at given sizes, within their bounds.

    Args:
        at: design with its point.
        words: all candidates.
        atoms: places of the candidates.
        theta: θ (P).

    """
    for k in atoms:
        values = {c.index: c.center + float(theta[i]) * c.unit for i, c in enumerate(words.columns) if c.atom == k}
        at = replace(at, point=put(at, words.atoms[k], values))
    return at.point


def put(at: Design, atom: Atom, values: Mapping[int, float]) -> Point:
    """Return the point of ``at`` with a candidate's shapes and given parameters, within their bounds.

    Args:
        at: design with its point.
        atom: the candidate.
        values: parameters by their place in p.

    """
    p, begun = at.point.p.copy(), at.point.begun
    atom.shape(at.shooting.arm, p)
    for index, value in values.items():
        p[index] = value
    p = at.shooting.arm.parameters.within(p)
    if atom.place == "sensor":  # the windows begin where the encoders say
        begun = begun + at.shooting.begun(p) - at.shooting.begun(at.point.p)
    return Point(p, begun)
