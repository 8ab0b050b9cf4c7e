"""Each effect simulated at several sizes: the start of its fit, and whether the fit is worthwhile.

A slope at size 0 says little of an effect that has a corner, or that moves a resonance by more than its width. So every
effect is simulated at a few sizes of either sign, with the base parameters fitted in the linear model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.candidate_priors import ORDER, Atom, Dictionary
from hdagen.diagnosis.inference.gauss_newton import put, put_sizes, widths
from hdagen.diagnosis.inference.marginal_likelihood import Scored
from hdagen.diagnosis.inference.sensitivities import Design, Point, chosen, residual
from hdagen.diagnosis.initialization.initial_guess import shared
from hdagen.support.parallel import together

SIZES = (-2.0, -0.7, 0.7, 2.0)  # typical sizes
SEEN = 0.1  # typical sizes, from which an initial guess is tried
TORQUES = (0.03, 1.0)  # sizes of unexplained torque
AT_ONCE = 32  # points that are scored together


@dataclass(frozen=True, eq=False)
class Start:
    """Where the fit of a candidate starts, and the log evidence that it gains there."""

    point: Point
    gain: float


def scan(
    at: Design, words: Dictionary, lead: Scored | None = None, far: Mapping[int, Array] | None = None
) -> dict[int, Start]:
    """Find the best start of each candidate that is not a sum of a sine and a cosine. The base parameters are fitted
    with it in the linear model; beside a leader, everything that the leader has moved, too, as that may stand in for
    the candidate.

    Args:
        at: sensitivities at the point to start from.
        words: all candidates.
        lead: score of the leading hypothesis, if there is one.
        far: θ (P) at which some candidates are tried, too.

    Returns:
        The starts by candidate.

    """
    led: tuple[int, ...] = ()
    columns = words.base
    sizes: tuple[float, ...] = TORQUES
    if lead:
        columns, led, sizes = words.focused(lead.atoms), lead.atoms, (lead.at.s,)
    base, tried = chosen(at, columns), []
    for k, atom in enumerate(words.atoms):
        if atom.name in base.words.meant:
            continue
        points = [*_displaced(at, words, k, atom), *_parted(at, words, led, k)]
        if far and k in far:
            points.append(put_sizes(at, words, (k,), far[k]))
        tried += [(k, point) for point in points]
    seen = at.shooting.near(at.point.lane, [point.lane for _, point in tried])

    def evidences(of: Sequence[tuple[tuple[int, ...], Point]], left: Array) -> Array:
        """Log evidence of candidates at points with their residuals (B, R, M), at the best size of unexplained
        torque."""
        bundle = base.bundle([point for _, point in of], left)
        spikes = np.stack([widths(base, free(atoms), point) for atoms, point in of])
        return np.max([bundle.evidences(s, spikes) for s in sizes], axis=0)

    def free(atoms: tuple[int, ...]) -> NDArray[np.intp]:
        amplitudes = {name for k in atoms for name in words.atoms[k].amplitudes}
        return np.array([i for i, c in enumerate(base.words.columns) if c.parameter in amplitudes and c.atom >= 0], int)

    def judged(some: slice) -> list[float]:
        left = np.stack([residual(at.shooting, read) for read in seen[some]])
        of = [((*led, k) if lead else (), point) for k, point in tried[some]]
        return [float(value) - none for value in evidences(of, left)]

    (none,) = map(float, evidences([(led, base.point)], base.residual[None]))
    parts = [slice(first, first + AT_ONCE) for first in range(0, len(tried), AT_ONCE)]
    gains = [gain for part in together(judged, parts) for gain in part]
    found: dict[int, Start] = {}
    for (k, point), gain in zip(tried, gains, strict=True):
        if k not in found or gain > found[k].gain:
            found[k] = Start(point, gain)
    return found


def _displaced(at: Design, words: Dictionary, k: int, atom: Atom) -> list[Point]:
    """List points with the candidate at its initial guess, and at each size within its bounds, one amplitude at a
    time."""
    columns = [c for c in words.columns if c.atom == k]
    described = list(at.shooting.arm.parameters.described.values())
    found = []
    if np.linalg.norm([c.seen for c in columns]) >= SEEN:
        beside = [c for c in words.columns if c.seen and words.atoms[c.atom].joint == atom.joint]
        others = {c.index: c.tolerated for c in beside if words.atoms[c.atom].name not in words.meant}
        found.append(put(at, atom, others | {c.index: c.center + c.seen * c.unit for c in columns}))
    if len(columns) > 1 and ORDER in "".join(atom.shapes):
        return found  # a sine and a cosine are as good as linear
    for c in columns:
        for size in dict.fromkeys((*SIZES, c.step)):
            value = c.center + size * c.unit
            if described[c.index].low <= value <= described[c.index].high:
                found.append(put(at, atom, {c.index: value}))
    return found


def _parted(at: Design, words: Dictionary, lead: tuple[int, ...], k: int) -> list[Point]:
    """List points that share an input effect of the leader with the candidate, as the measured input shows both. The
    slope of a delay of whole rows says nothing."""
    shooting, atom, found = at.shooting, words.atoms[k], []
    names = list(shooting.arm.parameters.described)
    for i in lead:
        other, shown = words.atoms[i], shooting.arm.input_names[atom.joint - 1] in shooting.record.names
        if shown and {atom.place, other.place} == {"input"} and atom.joint == other.joint:
            there, beside = other.amplitudes[0], atom.amplitudes[0]
            values = shared(shooting.arm, shooting.record, at.point.p, there, beside, atom.joint)
            found.append(put(at, atom, dict(zip(map(names.index, (there, beside)), values, strict=True))))
    return found
