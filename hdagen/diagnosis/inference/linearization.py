"""The linearization of a record about a point: one lane for each initial state, step of torque, and parameter.

Nuisance effects are most of the parameters, and their columns change little from one step of a fit to the next. So a
step keeps them, and only where a decision rests on a fit are they computed anew.

Legend: W windows, m positions and velocities of the state.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.rollout import Rollout
from hdagen.diagnosis.inference.sensitivities import (
    OperatingPoint,
    Sensitivities,
    compute_finite_differences,
    count_torque_steps,
    measure_torque_units,
    step_parameter,
    weigh_residual,
)


def compute_sensitivities(
    shooting: MultipleShooting, words: CandidateSet, point: OperatingPoint, near: Sensitivities | None = None
) -> Sensitivities:
    """Linearize a record about a point by one lane for each initial state, step of torque, and parameter.

    Args:
        shooting: the record and its model.
        words: the parameters.
        point: where to linearize.
        near: sensitivities about a point near by, whose columns of nuisance effects are kept; None: every column is
            computed.

    Returns:
        Sensitivities and residual at the point.

    """
    read, memory = shooting.predict_with_memory(Rollout(point.p, point.initial_states))
    point = replace(point, memory=memory)
    torques = [(lane, 1.0) for lane in _step_torques(shooting, point)]
    heads = _step_initial_states(shooting, point) + torques
    left = weigh_residual(shooting, read)  # limited to the channels' ranges: a diverging simulation has no useful slope
    head = compute_finite_differences(shooting, point, left, heads)
    kept: dict[int, Array] = {}
    earlier = None
    if near is not None:
        kept, earlier = _keep_nuisance_columns(words, near, head[shooting.m :])
    new = [k for k in range(len(words.columns)) if k not in kept]
    lanes = [step_parameter(shooting, words, point, words.columns[k]) for k in new]
    columns = np.empty((len(heads) + len(words.columns), left.size))
    columns[: len(heads)] = head
    columns[[len(heads) + k for k in new]] = compute_finite_differences(shooting, point, left, lanes)
    for k, column in kept.items():
        columns[len(heads) + k] = column
    return Sensitivities(shooting, words, point, columns, left, len(torques), earlier)


def _keep_nuisance_columns(
    words: CandidateSet, near: Sensitivities, torques: Array
) -> tuple[dict[int, Array], Array | None]:
    """Find the columns of effects that are nuisance effects near by, too, by their places among the parameters of
    ``words``, and the torques' columns at the point that they come from. A nuisance effect acts as a torque does, so
    none are kept where the columns of torques have changed much since then."""
    earlier = near.torques_of_nuisance
    if earlier is None:
        earlier = near.torque_columns
    if np.linalg.norm(torques - earlier) > LIKELIHOOD.largest_column_change * np.linalg.norm(earlier):
        return {}, None
    own = near.columns[near.shooting.m + near.k :]
    there = {
        (c.parameter, c.candidate): k for k, c in enumerate(near.candidates.columns) if near.candidates.is_nuisance(c)
    }
    kept = {
        k: own[there[c.parameter, c.candidate]]
        for k, c in enumerate(words.columns)
        if words.is_nuisance(c) and (c.parameter, c.candidate) in there
    }
    return kept, earlier


def _step_initial_states(shooting: MultipleShooting, point: OperatingPoint) -> list[tuple[Rollout, float]]:
    """Make a lane for each initial position and velocity."""
    lanes = []
    for i, size in enumerate(_initial_state_steps(shooting)):
        moved = point.initial_states.copy()
        moved[:, i] += size
        lanes.append((Rollout(point.p, moved), size))
    return lanes


def _initial_state_steps(shooting: MultipleShooting) -> list[float]:
    """Choose the step of each initial position and velocity (m)."""
    arm, record = shooting.arm, shooting.record
    noise = {(q, j): s for (q, j), s in zip(record.outputs, record.noise, strict=True)}
    found = []
    for name in arm.state_names[: shooting.m]:
        side, quantity, j = name.split("_")
        ratio = arm.parameters[f"ratio_{j}"]
        own = noise.get((f"{side}_position", int(j)))
        if not own and side == "motor":
            own = noise.get(("joint_position", int(j)), 0.0) * ratio
        elif not own:
            own = noise.get(("motor_position", int(j)), 0.0) / ratio
        size = LIKELIHOOD.initial_state_step * own
        if quantity != "position":
            size = size / LIKELIHOOD.reaction_time
        found.append(size)
    return found


def _step_torques(shooting: MultipleShooting, point: OperatingPoint) -> list[Rollout]:
    """Make a lane for each step of torque in the windows, at each motor and at each link of a flexible joint."""
    arm, record = shooting.arm, shooting.record
    units, lanes, steps = measure_torque_units(shooting), [], count_torque_steps(shooting)
    edges = np.linspace(record.starts, record.ends, steps + 1, axis=1).round().astype(int)
    part = np.full(len(record.time), -1)  # the step that each row lies in
    part[record.rows] = np.repeat(np.tile(np.arange(steps), len(edges)), np.diff(edges).reshape(-1))
    for j in range(1, arm.n + 1):
        for k in range(steps):
            torque = np.zeros((len(record.time), arm.n))
            torque[part == k, j - 1] = units[j - 1]
            lanes.append(Rollout(point.p, point.initial_states, torque=torque))
    elapsed = np.append(0.0, np.cumsum(record.time_steps))
    for j in arm.manifest["flexible"]:
        unit = units[j - 1] * abs(arm.parameters[f"ratio_{j}"])
        for first, end in zip(edges[:, :-1].T, edges[:, 1:].T, strict=True):
            impulse = np.zeros((len(record.time), arm.n))
            rows = np.linspace(first, end, LIKELIHOOD.impulses_of_step, endpoint=False, axis=1).astype(int)
            kicks = 1 + np.count_nonzero(np.diff(rows), axis=1)
            impulse[rows, j - 1] = (unit * (elapsed[end] - elapsed[first]) / kicks)[:, None]
            lanes.append(Rollout(point.p, point.initial_states, impulse=impulse))
    return lanes
