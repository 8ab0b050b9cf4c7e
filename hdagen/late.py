"""What sensors read along a whole path: an encoder that is read late shows where the joint was then.

At one instant the model knows a late reading only as a series, which a joint that rings fast does not follow. Along a
path the past is there: between rows it is Hermite's cubic of angle and speed.

Legend: d age of a joint encoder's reading, s; q, q̇ joint angle and speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hdagen.plant import Arm, Array

Rows = NDArray[np.intp]
APART = 3.0  # times the usual time between rows, from where rows are not neighbours


@dataclass(frozen=True, eq=False)
class Path:
    """Rows at ``time`` (T), s; ``begins``: rows at which a path begins that knows nothing of the one before."""

    time: Array
    begins: Rows | None = None

    @cached_property
    def number(self) -> NDArray[np.int32]:
        """Which path each row is on (T)."""
        begin = np.zeros(len(self.time), np.int32)
        if self.begins is not None:
            begin[self.begins] = 1
        return np.cumsum(begin, dtype=np.int32)

    @cached_property
    def far(self) -> float:
        """Time between rows from which they are no neighbours, s."""
        return APART * float(np.median(np.diff(self.time))) if len(self.time) > 1 else 0.0


def read(arm: Arm, time: Array, x: Array, u: Array, begins: Rows | None = None) -> dict[str, Array]:
    """`Arm.outputs` for the states x (T, nx) at ``time`` (T) with what acts there, u (T, nu); joint_position is read as
    late as ``sensor_delay`` says. ``begins``: rows at which a path begins that knows nothing of the one before."""
    if not _ages(arm).any():
        return arm.outputs(x, u)
    prompt = arm.p.copy()
    for k, name in enumerate(arm.parameters.described):
        if name.startswith("sensor_delay_"):
            prompt[k] = 0.0
    seen = arm.at(prompt).outputs(x, u)
    _delayed(arm, Path(time, begins), x, seen["joint_position"])
    return seen


def positions(arm: Arm, path: Path, x: Array) -> dict[str, Array]:
    """motor_position and joint_position (T, n) as `read` gives them, for the states x (T, nx) along ``path``."""
    seen = {name: np.empty((len(x), arm.n)) for name in ("motor_position", "joint_position")}
    arm.module.map("positions", len(x), np.ascontiguousarray(x), arm.c, *seen.values())
    _delayed(arm, path, x, seen["joint_position"])
    return seen


def _ages(arm: Arm) -> Array:
    """Age of the reading of each joint's encoder (n), s."""
    names = (f"sensor_delay_{j}" for j in range(1, arm.n + 1))
    return np.array([arm.parameters.get(name, 0.0) for name in names])


def _delayed(arm: Arm, path: Path, x: Array, angle: Array) -> None:
    """Make readings ``angle`` (T, n) of the joints' encoders as old as they are, in place."""
    ages = _ages(arm)
    if ages.any():
        arm.module.late(np.ascontiguousarray(x), path.time, path.number, path.far, ages, angle)
