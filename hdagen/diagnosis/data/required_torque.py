"""The torque that the measured motion requires: inverse dynamics of motion smoothed without lag.

Legend: K instants of an even grid, n joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.log.channel_statistics import UniformGrid, make_uniform_grid
from hdagen.prediction.measurement_model import read_joint_angles


@dataclass(frozen=True, eq=False)
class RequiredTorque:
    """Angles, speeds, and torques at the joints (K, n) at the instants of ``grid``."""

    grid: UniformGrid
    angle: Array
    speed: Array
    torque: Array


def compute_required_torque(arm: Arm, record: WindowedRecord) -> RequiredTorque:
    """Compute the torque that a recorded motion requires at the joints. The motor's angle stands in for a missing joint
    encoder.

    Args:
        arm: the compiled model.
        record: the log in windows.

    Returns:
        Smoothed motion and torque on an even grid.

    """
    log, n = record.log, arm.n
    grid = make_uniform_grid(log.time)
    q = np.stack([grid.smooth(column) for column in read_joint_angles(arm, log).T], 1)
    v = np.stack([grid.differentiate(column) for column in q.T], 1)
    a = np.stack([grid.differentiate(column) for column in v.T], 1)
    held = record.command[np.clip(np.searchsorted(log.time, grid.time, side="right") - 1, 0, None)]
    torque = arm.evaluate("inverse_dynamics", q=q, v=v, a=a, tip_force=held[:, n:])["joint_torque"]
    return RequiredTorque(grid, q, v, torque)
