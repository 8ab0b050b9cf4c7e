"""The largest torques and torsions that an arm's model is made for."""

from __future__ import annotations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.interface import ArmInterface


def compute_rated_torsion(arm: ArmInterface) -> Array:
    """Compute the torsion of each drive at the largest input that the model is made for.

    Args:
        arm: The arm, with its present parameters.

    Returns:
        (n), rad (m where prismatic), positive; 0 in a rigid drive.

    """
    return np.abs(arm.evaluate("torsion", joint_torque=compute_rated_torque(arm))["torsion"])


def compute_rated_torque(arm: ArmInterface) -> Array:
    """Compute the torque at each joint under the largest input that the model is made for.

    Args:
        arm: The arm, with its present parameters.

    Returns:
        (n), N m (N where prismatic), positive.

    """
    bound = np.array([slot["bound"] for slot in arm.manifest["input"][: arm.n]])
    ratio = np.array([arm.parameters[f"ratio_{j}"] for j in range(1, arm.n + 1)])
    return np.abs(bound * ratio * compute_torque_per_input(arm))


def compute_torque_per_input(arm: ArmInterface) -> Array:
    """List the torque at each motor for one unit of its input.

    Args:
        arm: The arm, with its present parameters.

    Returns:
        (n): the torque constant, N m/A, or 1 where the input is a torque.

    """
    names = [f"torque_constant_{j}" for j in range(1, arm.n + 1)]
    return np.array([arm.parameters[name] if name in arm.parameters.described else 1.0 for name in names])


def get_torque_constant(arm: ArmInterface, j: int) -> float:
    """Read the torque constant of a motor from the robot file.

    Args:
        arm: The arm; its present parameters do not count.
        j: The number of a joint whose input is a current.

    Returns:
        The torque constant, N m/A.

    """
    return arm.parameters.described[f"torque_constant_{j}"].nominal
