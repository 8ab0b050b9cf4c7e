"""Each effect at several sizes, tried where they lie: the start of its fit, and whether it is worth one.

A slope at size 0 says little of an effect that answers with a corner or moves a resonance by more than its width. So
every effect is put into the model at a few sizes of either sign, with the base parameters refitted in the linear model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdagen.diagnosis.candidates import ORDER, Atom, Dictionary
from hdagen.diagnosis.design import Design, Point, chosen, residual
from hdagen.diagnosis.evidence import Scored
from hdagen.diagnosis.fitting import widths
from hdagen.diagnosis.starts import shared
from hdagen.plant import Array
from hdagen.together import together

SIZES = (-2.0, -0.7, 0.7, 2.0)  # usual sizes
SEEN = 0.1  # usual sizes of what was read off, from which it is tried
TORQUES = (0.03, 1.0)  # sizes of unexplained torque
AT_ONCE = 32  # points that are judged together


@dataclass(frozen=True, eq=False)
class Start:
    """Where an atom's fit begins, and by how much the log evidence there is above that of none."""

    point: Point
    gain: float


def scan(
    at: Design, words: Dictionary, lead: Scored | None = None, far: Mapping[int, Array] | None = None
) -> dict[int, Start]:
    """The best start of each atom that is no sum of a sine and a cosine, about the point of ``at``, with the base
    parameters refitted; about a ``lead`` that stands where it was fitted with everything that it has moved too, as that
    may stand where it does in place of the atom. ``far``: θ (P) at which some atoms are tried, too."""
    base = chosen(at, words.focused(lead.atoms) if lead else words.base)
    sizes = (lead.at.s,) if lead else TORQUES
    meant = base.words.meant
    tried = [
        (k, point)
        for k, atom in enumerate(words.atoms)
        if atom.name not in meant
        for point in [
            *_displaced(at, words, k, atom),
            *(_parted(at, words, lead.atoms, k) if lead else []),
            *([put_sizes(at, words, (k,), far[k])] if far and k in far else []),
        ]
    ]
    seen = at.shooting.near(at.point.lane, [point.lane for _, point in tried])

    def evidences(of: Sequence[tuple[tuple[int, ...], Point]], left: Array) -> Array:
        """Log evidence where atoms stand at points with what that leaves, (B, R, M), in their best size of torque."""
        bundle = base.bundle([point for _, point in of], left)
        spikes = np.stack([widths(base, free(atoms), point) for atoms, point in of])
        return np.max([bundle.evidences(s, spikes) for s in sizes], axis=0)

    def free(atoms: tuple[int, ...]) -> NDArray[np.intp]:
        amplitudes = {name for k in atoms for name in words.atoms[k].amplitudes}
        return np.array([i for i, c in enumerate(base.words.columns) if c.parameter in amplitudes and c.atom >= 0], int)

    def judged(some: slice) -> list[float]:
        left = np.stack([residual(at.shooting, read) for read in seen[some]])
        of = [((*lead.atoms, k) if lead else (), point) for k, point in tried[some]]
        return [float(value) - none for value in evidences(of, left)]

    (none,) = map(float, evidences([(lead.atoms if lead else (), base.point)], base.residual[None]))
    parts = [slice(first, first + AT_ONCE) for first in range(0, len(tried), AT_ONCE)]
    gains = [gain for part in together(judged, parts) for gain in part]
    found: dict[int, Start] = {}
    for (k, point), gain in zip(tried, gains, strict=True):
        if k not in found or gain > found[k].gain:
            found[k] = Start(point, gain)
    return found


def _displaced(at: Design, words: Dictionary, k: int, atom: Atom) -> list[Point]:
    """Points with the atom as it was read off, and at each of its sizes that its bounds allow, one of its amplitudes at
    a time."""
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
    """Points with the atom beside each effect of the lead that works on the same commands, both as what is measured of
    them shows: of a delay the slope of whole rows says nothing."""
    shooting, atom, found = at.shooting, words.atoms[k], []
    names = list(shooting.arm.parameters.described)
    for i in lead:
        other, shown = words.atoms[i], shooting.arm.input_names[atom.joint - 1] in shooting.record.names
        if shown and {atom.place, other.place} == {"input"} and atom.joint == other.joint:
            there, beside = other.amplitudes[0], atom.amplitudes[0]
            values = shared(shooting.arm, shooting.record, at.point.p, there, beside, atom.joint)
            found.append(put(at, atom, dict(zip(map(names.index, (there, beside)), values, strict=True))))
    return found


def put_sizes(at: Design, words: Dictionary, atoms: tuple[int, ...], theta: Array) -> Point:
    """The point of ``at`` with atoms in their shapes and at sizes θ (P), as far as their bounds allow."""
    for k in atoms:
        values = {c.index: c.center + float(theta[i]) * c.unit for i, c in enumerate(words.columns) if c.atom == k}
        at = replace(at, point=put(at, words.atoms[k], values))
    return at.point


def put(at: Design, atom: Atom, values: Mapping[int, float]) -> Point:
    """The point of ``at`` with the atom's shapes and parameters at ``values``, as far as their bounds allow."""
    p, begun = at.point.p.copy(), at.point.begun
    atom.shape(at.shooting.arm, p)
    for index, value in values.items():
        p[index] = value
    p = at.shooting.arm.parameters.within(p)
    if atom.place == "sensor":  # the windows begin where the encoders say
        begun = begun + at.shooting.begun(p) - at.shooting.begun(at.point.p)
    return Point(p, begun)
