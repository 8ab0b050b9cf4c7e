"""A log replayed by MuJoCo, in the windows of our own replay and from the same states, or in closed loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.log.measured_log import Log
from hdagen.model_export.mujoco_machine import MujocoMachine
from hdagen.prediction.closed_loop_replay import JointController, JointLaw
from hdagen.prediction.driving_inputs import read_driving_inputs
from hdagen.prediction.window_replay import Replay


def replay_in_mujoco(
    machine: MujocoMachine, arm: Arm, log: Log, ours: Replay, laws: Sequence[JointLaw] | None = None
) -> Replay:
    """Replay a log in MuJoCo.

    Args:
        machine: The MuJoCo model.
        arm: Our model of the same robot, which names states and inputs.
        log: The log.
        ours: Our replay of it: MuJoCo takes its windows, and its states at their begins.
        laws: The control laws, one a joint, that close the loop; None: the logged commands drive it.

    Returns:
        Our replay with MuJoCo's columns in place of ours.

    Raises:
        PlantError: MuJoCo's state left all bounds.

    """
    inputs, _ = read_driving_inputs(arm, log, "command")
    first, n = inputs[0, : arm.n].copy(), arm.n
    controllers = None
    if laws is not None:
        controllers = [JointController(arm, log, j, law) for j, law in enumerate(laws, 1)]
    spans, starts = np.diff(log.time, append=log.time[-1]), set(ours.starts.tolist())
    pushes = inputs[:, n:] if inputs.shape[1] > n else np.zeros((len(log), 2))
    motor, joint, acted = np.empty((len(log), n)), np.empty((len(log), n)), np.empty((len(log), n))
    machine.mujoco.mj_resetData(machine.model, machine.data)
    machine.hold_inputs(first)
    acted[0] = first
    for row in range(len(log)):
        if row in starts:
            machine.place_joints(*_read_state(arm, ours.states[row]))
        motor[row], joint[row] = machine.read_positions()
        if not np.isfinite(joint[row]).all():
            raise PlantError(
                f"{machine.path.name}: MuJoCo's state left all bounds by {log.time[row]:.4g} s; shorten the model's "
                "timestep, or look at its gains."
            )
        if controllers is not None:
            for j, (one, law) in enumerate(zip(controllers, laws or (), strict=True)):
                angle = motor[row, j] if law.encoder == "motor" else joint[row, j]
                inputs[row, j] = one.compute_command(row, float(angle))
        if spans[row] > 0:
            machine.advance_row(inputs[row, :n], pushes[row], float(spans[row]))
            if row + 1 < len(log):
                acted[row + 1] = machine.read_inputs()
    return _replace_columns(ours, log, motor, joint, acted)


def _read_state(arm: Arm, x: Array) -> tuple[Array, Array, Array, Array]:
    """Angles and speeds of motors (over their ratios) and joints in a state of our model."""
    joints = range(1, arm.n + 1)
    joint = np.array([x[arm.index(f"joint_position_{j}")] for j in joints])
    speed = np.array([x[arm.index(f"joint_velocity_{j}")] for j in joints])
    motor, motor_speed = joint.copy(), speed.copy()
    for j in joints:
        if f"motor_position_{j}" in arm.state_names:
            ratio = arm.parameters[f"ratio_{j}"]
            motor[j - 1] = x[arm.index(f"motor_position_{j}")] / ratio
            motor_speed[j - 1] = x[arm.index(f"motor_velocity_{j}")] / ratio
    return motor, motor_speed, joint, speed


def _replace_columns(ours: Replay, log: Log, motor: Array, joint: Array, acted: Array) -> Replay:
    """``ours`` with the columns of another simulation, and their errors."""
    columns = dict(ours.columns)
    for j in range(1, motor.shape[1] + 1):
        columns[f"motor_position_{j}"], columns[f"joint_position_{j}"] = motor[:, j - 1], joint[:, j - 1]
        for name in (f"motor_current_{j}", f"motor_torque_{j}"):
            if name in columns and name not in ours.driving_channels:
                columns[name] = acted[:, j - 1]
    errors = {
        name: float(np.sqrt(np.mean((columns[name] - log[name]) ** 2))) for name in ours.errors if name in columns
    }
    noise = {name: value for name, value in ours.noise.items() if name in errors}
    relative = dict.fromkeys(errors, math.nan)
    return replace(ours, columns=columns, errors=errors, noise=noise, relative=relative, notes=())
