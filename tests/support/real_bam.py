"""BAM's friction models of a servo with a pendulum in closed loop, after their formulas alone: the measure to reach.

Source: Duclusaud, Passault, Padois, Ly, Extended friction models for the physics simulation of servo actuators (ICRA
2025), II and III: M1 Coulomb-viscous, M2 with Stribeck's peak, M6 with friction that grows with the torques on both
sides of the gear, more at rest, and quadratically. A dry friction that can stop the servo within a step does. Shares
nothing with the project.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

GRAVITY = 9.80665
SUPPLY = 7.4  # V
COUNTS = 4096 / (2 * math.pi)  # of the encoder a rad
STEP = 1e-3  # s


def friction(p: dict[str, float], motor: float, load: float, speed: float) -> float:
    """The level of dry friction, N m, under the motor's torque and the pendulum's (signed alike)."""
    level = p["friction_base"]
    if "friction_stribeck" not in p:
        return level
    near = math.exp(-(abs(speed / p["dtheta_stribeck"]) ** p["alpha"]))
    level += near * p["friction_stribeck"]
    if "load_friction_motor" not in p:
        return level
    level += abs(p["load_friction_external"] * load - p["load_friction_motor"] * motor)
    level += near * abs(p["load_friction_external_stribeck"] * load - p["load_friction_motor_stribeck"] * motor)
    if load * motor <= 0:  # the load pulls against the motor
        drives = abs(motor) > abs(load)
        level += near * (
            p["load_friction_external_quad"] * load**2 if drives else p["load_friction_motor_quad"] * motor**2
        )
    return level


def closed_loop(recording: Path, p: dict[str, float]) -> float:
    """Mean absolute error of the position over the rows of a raw log, rad."""
    log = json.loads(recording.read_text(encoding="utf-8"))
    rows = log["entries"]
    inertia = log["mass"] * log["length"] ** 2 + p["armature"]
    weight = log["mass"] * log["length"] * GRAVITY
    gain = log["kp"] * COUNTS / (256 * 885)
    q, v, errors = rows[0]["position"], rows[0]["speed"], []
    for row, after in zip(rows, [*rows[1:], rows[-1]], strict=True):
        errors.append(abs(q - row["position"]))
        held = after["timestamp"] - row["timestamp"]
        parts = math.ceil(held / STEP)
        for _ in range(parts):
            h = held / parts
            duty = min(max(gain * (row["goal_position"] - q), -1.0), 1.0)
            motor = p["kt"] / p["R"] * (duty * SUPPLY - p["kt"] * v) if row["torque_enable"] else 0.0
            load = -weight * math.sin(q + p["q_offset"])
            most = friction(p, motor, load, v) + p["friction_viscous"] * abs(v)
            stops = inertia / h * v + motor + load
            v += h * (motor + load - math.copysign(min(abs(stops), most), stops)) / inertia
            q += h * v
    return float(np.mean(errors))
