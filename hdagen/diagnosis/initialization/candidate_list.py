"""The list of candidate effects of a model, with the priors and starting values that a log suggests."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from hdagen.arm.arm_parameters import Parameter
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet, Column
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.initialization.initial_guess import InitialGuess


def build_candidates(
    arm: Arm, suggested: InitialGuess, uncommanded: Collection[int] = (), *, with_numbers: bool = False
) -> CandidateSet:
    """List every effect of a model that a log can show, started from the log's initial guess. An effect between a
    command and the input that acts is left out at joints whose measured input drives the model.

    Args:
        arm: the compiled model.
        suggested: initial guess from the log.
        uncommanded: joints without a logged command.
        with_numbers: whether the robot file is doubted: its numbers may be wrong by any factor.

    Returns:
        All candidates with their columns.

    """
    described = arm.parameters.described
    place = {name: k for k, name in enumerate(described)}
    atoms: list[Candidate] = []
    columns: list[Column] = []
    numbers = arm.manifest["numbers"] if with_numbers else []
    for effect in (*arm.manifest["effects"], *numbers):
        for j in effect["joints"]:
            suffix = f"_{j}" if j else ""
            possible = (a + suffix for a in effect["amplitudes"])
            names = tuple(name for name in possible if name in described and described[name].typical)
            if not names or (effect["place"] == "input" and j in uncommanded):
                continue
            shapes = [s + suffix for s in effect["shapes"]]
            for number, chosen in enumerate(
                _combine_shape_starts([suggested.shapes.get(s, described[s].starts) for s in shapes])
            ):
                own = dict(zip(shapes, chosen, strict=True))
                is_number = effect in numbers  # even one of which the file states 0
                if with_numbers and not is_number:
                    is_number = all(_is_stated(described[name]) for name in names)
                atoms.append(Candidate(arm.effects[effect["name"]], j, names, own, not number, is_number))
                columns += [
                    _make_column(described[name], place[name], len(atoms) - 1, not number, suggested) for name in names
                ]
    owned = {c.parameter for c in columns}
    for name, q in described.items():
        if q.role == "base" and name not in owned and q.deviation > 0:
            columns.append(Column(name, place[name], q.nominal, q.deviation, 1.0, -1, True))
    return CandidateSet(tuple(atoms), tuple(columns))


def _is_stated(q: Parameter) -> bool:
    """Tell whether the robot file states a size, so that the true one may differ from it by a factor."""
    return q.stated != 0.0 and (q.role == "base" or q.nominal > q.low)


def _combine_shape_starts(starts: Sequence[Sequence[float]]) -> list[tuple[float, ...]]:
    """Combine the starting values of the shapes: first values together, then second ones, and so on."""
    found = []
    for k in range(max(map(len, starts), default=1)):
        found.append(tuple(s[k % len(s)] for s in starts))
    return found


def _make_column(q: Parameter, index: int, atom: int, first: bool, suggested: InitialGuess) -> Column:
    """Make the column of one amplitude."""
    assert q.typical
    name, base = q.name, q.role == "base"
    unit = suggested.units.get(name, q.typical)
    nominal = q.nominal
    if not base and q.low > 0:  # an effect that cannot be 0 is absent at its lower bound
        nominal = q.low
    everywhere = 1.0
    if q.everywhere is not None:
        everywhere = q.everywhere / q.typical
    spike, step, seen = CANDIDATES.silent_spike_width, CANDIDATES.column_step, 0.0
    if first:
        spike = math.hypot(q.deviation / unit, CANDIDATES.spike_scales[0] * everywhere)
        spike = max(spike, CANDIDATES.silent_spike_width)
    if not everywhere and q.stated:  # as small as a number moves in every hypothesis
        step = CANDIDATES.column_step * max(spike, CANDIDATES.column_step)
    if name in suggested.column_steps:
        step = suggested.column_steps[name] / unit
    if first and name in suggested.values:
        seen = (suggested.values[name] - nominal) / unit
    return Column(name, index, nominal, unit, spike, atom, base and first, step, seen, everywhere, nominal + q.offset)
