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
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet
from hdagen.diagnosis.inference.gauss_newton import compute_prior_widths, place_candidate, place_sizes
from hdagen.diagnosis.inference.marginal_likelihood import ScoredHypothesis
from hdagen.diagnosis.inference.sensitivities import OperatingPoint, Sensitivities, select_columns, weigh_residual
from hdagen.diagnosis.initialization.initial_guess import split_input_effects
from hdagen.diagnosis.initialization.initialization_settings import INITIALIZATION
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.support.parallel import map_in_threads


@dataclass(frozen=True, eq=False)
class Start:
    """Where the fit of a candidate starts, and the log evidence that it gains there."""

    point: OperatingPoint
    gain: float


def scan_sizes(
    at: Sensitivities, words: CandidateSet, lead: ScoredHypothesis | None = None, far: Mapping[int, Array] | None = None
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
    columns = words.always_fitted
    sizes: tuple[float, ...] = SEARCH.scanned_torques
    if lead:
        columns, led, sizes = words.columns_for(lead.effects), lead.effects, (lead.posterior.s,)
    base, tried = select_columns(at, columns), []
    for k, atom in enumerate(words.members):
        if atom.name in base.candidates.active:
            continue
        points = [*_displace_candidate(at, words, k, atom), *_share_with_leader(at, words, led, k)]
        if far and k in far:
            points.append(place_sizes(at, words, (k,), far[k]))
        tried += [(k, point) for point in points]
    predictions = at.shooting.predict_near(at.point.rollout, [point.rollout for _, point in tried])

    def evidences(of: Sequence[tuple[tuple[int, ...], OperatingPoint]], left: Array) -> Array:
        """Log evidence of candidates at points with their residuals (B, R, M), at the best size of unexplained
        torque."""
        bundle = base.batch_residuals([point for _, point in of], left)
        spikes = np.stack([compute_prior_widths(base, free(atoms), point) for atoms, point in of])
        return np.max([bundle.log_evidences(s, spikes) for s in sizes], axis=0)

    def free(atoms: tuple[int, ...]) -> NDArray[np.intp]:
        amplitudes = {name for k in atoms for name in words.members[k].amplitudes}
        return np.array(
            [i for i, c in enumerate(base.candidates.columns) if c.parameter in amplitudes and c.candidate >= 0], int
        )

    def judged(some: slice) -> list[float]:
        left = np.stack([weigh_residual(at.shooting, read) for read in predictions[some]])
        of = [((*led, k) if lead else (), point) for k, point in tried[some]]
        return [float(value) - none for value in evidences(of, left)]

    (none,) = map(float, evidences([(led, base.point)], base.residual[None]))
    parts = [slice(first, first + SEARCH.scan_batch_size) for first in range(0, len(tried), SEARCH.scan_batch_size)]
    gains = [gain for part in map_in_threads(judged, parts) for gain in part]
    found: dict[int, Start] = {}
    for (k, point), gain in zip(tried, gains, strict=True):
        if k not in found or gain > found[k].gain:
            found[k] = Start(point, gain)
    return found


def _displace_candidate(at: Sensitivities, words: CandidateSet, k: int, atom: Candidate) -> list[OperatingPoint]:
    """List points with the candidate at its initial guess, and at each size within its bounds, one amplitude at a
    time."""
    columns = [c for c in words.columns if c.candidate == k]
    described = list(at.shooting.arm.parameters.described.values())
    found = []
    if np.linalg.norm([c.initial_guess for c in columns]) >= INITIALIZATION.least_scanned_guess:
        beside = [c for c in words.columns if c.initial_guess and words.members[c.candidate].joint == atom.joint]
        others = {c.index: c.initial_value for c in beside if words.members[c.candidate].name not in words.active}
        found.append(
            place_candidate(at, atom, others | {c.index: c.center + c.initial_guess * c.unit for c in columns})
        )
    by_name = at.shooting.arm.parameters.described
    if len(columns) > 1 and any(by_name[name].is_motor_order for name in atom.shapes):
        return found  # a sine and a cosine are as good as linear
    for c in columns:
        for size in dict.fromkeys((*SEARCH.scanned_sizes, c.step)):
            value = c.center + size * c.unit
            if described[c.index].low <= value <= described[c.index].high:
                found.append(place_candidate(at, atom, {c.index: value}))
    return found


def _share_with_leader(at: Sensitivities, words: CandidateSet, lead: tuple[int, ...], k: int) -> list[OperatingPoint]:
    """List points that share an input effect of the leader with the candidate, as the measured input shows both. The
    slope of a delay of whole rows says nothing."""
    shooting, atom, found = at.shooting, words.members[k], []
    names = list(shooting.arm.parameters.described)
    for i in lead:
        other, shown = words.members[i], shooting.arm.input_names[atom.joint - 1] in shooting.record.names
        if shown and {atom.place, other.place} == {"input"} and atom.joint == other.joint:
            there, beside = other.amplitudes[0], atom.amplitudes[0]
            values = split_input_effects(shooting.arm, shooting.record, at.point.p, there, beside, atom.joint)
            found.append(place_candidate(at, atom, dict(zip(map(names.index, (there, beside)), values, strict=True))))
    return found
