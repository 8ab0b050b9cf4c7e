"""A wrist of one rigid joint under gravity: its robot file, and logs of machines whose numbers differ from it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hdagen.arm.compiled_arm import load
from hdagen.log.measured_log import Log

RESOLUTION = 1e-5  # rad
ROBOT = f"""name = "wrist"
gravity = [0.0, -9.81]
step = 1e-3
[[joint]]
length = 0.3
mass = 2.0
center_of_mass = 0.15
inertia = 0.03
[joint.drive]
rigid = true
ratio = 1.0
motor_inertia = 0.0  # no rotor, and so no spring to look for
viscous_friction = 0.1
coulomb_friction = 0.2
friction_smoothing = 0.05
[joint.limits]
torque = 12.0
[joint.sensor]
joint_encoder_resolution = {RESOLUTION}
"""


def move_wrist(robot: Path, factors: Mapping[str, float], seconds: float, rotor: float = 0.0) -> Log:
    """A log of the machine whose numbers are the file's times ``factors``, with a rotor, kg m², that the file lacks."""
    arm = load(robot)
    arm.parameters["motor_inertia_1"] = rotor
    arm.parameters.update({name: factor * arm.parameters[name] for name, factor in factors.items()})
    time = np.arange(0.0, seconds, 2e-3)
    waves = np.sin(2 * np.pi * np.outer(time, [0.37, 0.9, 2.1]) + [0.0, 1.0, 2.0])
    u = np.zeros((len(time), arm.nu))
    u[:, 0] = np.minimum(2.0 * time, 1.0) * (waves @ [2.0, 1.5, 1.5])
    x = arm.rollout(arm.rest([-np.pi / 2]), u[:-1], np.diff(time), exact=True)
    angle = arm.outputs(x, u)["joint_position"][:, 0]
    columns = {
        "motor_torque_command_1": u[:, 0].copy(),
        "joint_position_1": np.round(angle / RESOLUTION) * RESOLUTION,
    }
    return Log(time, columns, 1, "made")
