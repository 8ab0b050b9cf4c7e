"""Torques and torsions that an arm is meant for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from hdagen.plant import Arm, Array


def full_torsion(arm: Arm) -> Array:
    """Torsion (n) at the largest input that the model is meant for, rad (or m); 0 in a rigid drive."""
    return np.abs(arm.evaluate("torsion", joint_torque=full_torque(arm))["torsion"])


def full_torque(arm: Arm) -> Array:
    """Torque at the joint (n) of the largest input that the model is meant for, N m (or N), positive."""
    bound = np.array([slot["bound"] for slot in arm.manifest["input"][: arm.n]])
    ratio = np.array([arm.parameters[f"ratio_{j}"] for j in range(1, arm.n + 1)])
    return np.abs(bound * ratio * torque_per_input(arm))


def torque_per_input(arm: Arm) -> Array:
    """Torque at the motor (n), N m, of a unit of its input: the torque constant, or 1 where the input is torque."""
    names = [f"torque_constant_{j}" for j in range(1, arm.n + 1)]
    return np.array([arm.parameters[name] if name in arm.parameters.described else 1.0 for name in names])
