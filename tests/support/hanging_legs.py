"""Two rigid joints of ratio 1 that hang: their model, and logs of machines that differ from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from compiled import Compiled

from hdagen.arm.compiled_arm import Arm
from hdagen.log.column_map import name_command_channel
from hdagen.log.measured_log import Log

JOINT = """[[joint]]
length = 0.2
mass = 0.5
center_of_mass = 0.1
inertia = 0.004
[joint.drive]
rigid = true
ratio = 1
motor_inertia = 0.01
viscous_friction = {viscous}
coulomb_friction = {coulomb}
friction_smoothing = 0.05
[joint.sensor]
joint_encoder_noise = 1e-5
"""
EFFECTS = ("current_saturation", "voltage_sag", "quadratic_friction", "load_dependent_friction", "torque_constant")


def build_legs(
    build: Callable[..., Compiled], viscous: float = 0.0, coulomb: float = 0.0, tolerance: float = 0.0
) -> Arm:
    """Two rigid joints of ratio 1 that hang."""
    joint = JOINT.format(viscous=viscous, coulomb=coulomb)
    head = 'name = "leg"\ngravity = [9.81, 0]'
    if tolerance:
        head += f"\ntolerance = {tolerance}"
    return Arm(build(f"{head}\n{joint}{joint}", effects=EFFECTS).folder)


def drive_legs(arm: Arm, truth: Mapping[str, float], seconds: float = 6.0, gain: float = 40.0) -> Log:
    """The log of a machine with ``truth`` that follows sums of sines."""
    machine, p, names = arm, arm.p.copy(), list(arm.parameters.described)
    for name, value in truth.items():
        p[names.index(name)] = value
    machine = arm.with_parameters(p)
    rng, h = np.random.default_rng(3), 2e-3
    time = h * np.arange(round(seconds / h))
    waves = np.stack([np.sin(2 * np.pi * np.outer(time, (0.4, 1.1)) + rng.uniform(0, 6, 2)).sum(1) for _ in "12"], 1)
    wanted = 0.5 * np.clip(time, 0, 1)[:, None] * waves
    speed = np.gradient(wanted, h, axis=0)
    at = [arm.index(f"joint_{what}_{j}") for what in ("position", "velocity") for j in (1, 2)]
    x, u, rows = arm.rest([0.0, 0.0]), np.zeros(arm.nu), []
    for k in range(len(time)):
        q, v = x[at[:2]] + 1e-5 * rng.standard_normal(2), x[at[2:]]
        u[:2] = gain * (wanted[k] - q) + 0.03 * gain * (speed[k] - v)
        rows.append([*q, *u[:2]])
        x = machine.rollout(x, u[None], h, exact=True)[-1]
    names = ["joint_position_1", "joint_position_2", *(name_command_channel(f"motor_torque_{j}") for j in (1, 2))]
    return Log(time, dict(zip(names, np.ascontiguousarray(np.array(rows).T), strict=True)), 2, "leg")
