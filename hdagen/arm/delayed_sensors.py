"""Readings of sensors along a whole path, with delayed encoders: a late reading shows where the joint was earlier.

At a single instant the model can only expand a late reading as a series in the delay, which fails for a joint that
rings fast. Along a path the earlier angles are known: between rows they are Hermite's cubic of angle and speed.

Legend: d age of a joint encoder's reading, s; q, q̇ joint angle and speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm

Rows = NDArray[np.intp]
NEIGHBOUR_STEP_FACTOR = 3.0  # usual steps between rows, from where rows are not neighbours


@dataclass(frozen=True, eq=False)
class SampledPath:
    """The instants of sampled paths.

    Attributes:
        time: (T), s.
        begins: First rows of paths that know nothing of the path before; None: one path.

    """

    time: Array
    path_starts: Rows | None = None

    @cached_property
    def path_numbers(self) -> NDArray[np.int32]:
        """The number of the path that each row is on, (T)."""
        begin = np.zeros(len(self.time), np.int32)
        if self.path_starts is not None:
            begin[self.path_starts] = 1
        return np.cumsum(begin, dtype=np.int32)

    @cached_property
    def longest_neighbour_step(self) -> float:
        """The time between rows above which they are not neighbours, s."""
        if len(self.time) < 2:
            return 0.0
        return NEIGHBOUR_STEP_FACTOR * float(np.median(np.diff(self.time)))


def read_sensors(arm: Arm, time: Array, x: Array, u: Array, begins: Rows | None = None) -> dict[str, Array]:
    """Evaluate `Arm.outputs` along paths, with joint_position as late as the parameters say.

    Args:
        arm: The arm.
        time: (T), s.
        x: (T, nx), the states.
        u: (T, nu), the inputs that act at each instant.
        begins: First rows of paths that know nothing of the path before; None: one path.

    Returns:
        Every output by name, (T, k).

    """
    if not _list_sensor_delays(arm).any():
        return arm.outputs(x, u)
    prompt = arm.p.copy()
    for k, q in enumerate(arm.parameters.described.values()):
        if q.is_reading_delay:
            prompt[k] = 0.0
    seen = arm.with_parameters(prompt).outputs(x, u)
    _delay_joint_positions(arm, SampledPath(time, begins), x, seen["joint_position"])
    return seen


def read_positions(arm: Arm, path: SampledPath, x: Array) -> dict[str, Array]:
    """Evaluate only the two positions that `read_sensors` gives.

    Args:
        arm: The arm.
        path: The instants of the states.
        x: (T, nx), the states.

    Returns:
        motor_position and joint_position, (T, n) each, rad (m where prismatic).

    """
    seen = {name: np.empty((len(x), arm.n)) for name in ("motor_position", "joint_position")}
    arm.module.map("positions", len(x), np.ascontiguousarray(x), arm.c, *seen.values())
    _delay_joint_positions(arm, path, x, seen["joint_position"])
    return seen


def _list_sensor_delays(arm: Arm) -> Array:
    """The delay of each joint's encoder (n), s."""
    ages = np.zeros(arm.n)
    for k, q in enumerate(arm.parameters.described.values()):
        if q.is_reading_delay:
            ages[q.joint - 1] += arm.p[k]
    return ages


def _delay_joint_positions(arm: Arm, path: SampledPath, x: Array, angle: Array) -> None:
    """Replace the angles (T, n) of the joints' encoders by the delayed ones, in place."""
    ages = _list_sensor_delays(arm)
    if ages.any():
        arm.module.late(np.ascontiguousarray(x), path.time, path.path_numbers, path.longest_neighbour_step, ages, angle)
