"""The linearization of a record about a point: one lane for each initial state, step of torque, and parameter.

Legend: W windows, m positions and velocities of the state.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.rollout import Rollout
from hdagen.diagnosis.inference.sensitivities import (
    IMPULSES_OF_STEP,
    INITIAL_STATE_STEP,
    REACTION_TIME,
    OperatingPoint,
    Sensitivities,
    compute_finite_differences,
    count_torque_steps,
    measure_torque_units,
    step_parameter,
    weigh_residual,
)


def compute_sensitivities(shooting: MultipleShooting, words: CandidateSet, point: OperatingPoint) -> Sensitivities:
    """Linearize a record about a point by one lane for each initial state, step of torque, and parameter.

    Args:
        shooting: the record and its model.
        words: the parameters.
        point: where to linearize.

    Returns:
        Sensitivities and residual at the point.

    """
    read, memory = shooting.predict_with_memory(Rollout(point.p, point.initial_states))
    point = replace(point, memory=memory)
    torques = [(lane, 1.0) for lane in _step_torques(shooting, point)]
    lanes = (
        _step_initial_states(shooting, point)
        + torques
        + [step_parameter(shooting, words, point, c) for c in words.columns]
    )
    left = weigh_residual(shooting, read)  # limited to the channels' ranges: a diverging simulation has no useful slope
    return Sensitivities(
        shooting, words, point, compute_finite_differences(shooting, point, left, lanes), left, len(torques)
    )


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
        size = INITIAL_STATE_STEP * own
        if quantity != "position":
            size = size / REACTION_TIME
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
            rows = np.linspace(first, end, IMPULSES_OF_STEP, endpoint=False, axis=1).astype(int)
            kicks = 1 + np.count_nonzero(np.diff(rows), axis=1)
            impulse[rows, j - 1] = (unit * (elapsed[end] - elapsed[first]) / kicks)[:, None]
            lanes.append(Rollout(point.p, point.initial_states, impulse=impulse))
    return lanes
