"""What sensors read along a whole path: an encoder that is read late shows where the joint was then.

At one instant the model knows a late reading only as a series, which a joint that rings fast does not follow. Along a
path the past is there: between rows it is Hermite's cubic of angle and speed.

Legend: d age of a joint encoder's reading, s; q, q̇ joint angle and speed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hdagen.plant import Arm, Array

Rows = NDArray[np.intp]
AGES = 8  # whose weights are kept
APART = 3.0  # times the usual time between rows, from where rows are not neighbours


@dataclass(frozen=True, eq=False)
class Path:
    """Rows at ``time`` (T), s; ``begins``: rows at which a path begins that knows nothing of the one before."""

    time: Array
    begins: Rows | None = None
    kept: dict[float, tuple[Rows, Array, Rows]] = field(default_factory=dict)

    @cached_property
    def step(self) -> Array:
        """Time from each row to the next (T − 1), s."""
        return np.diff(self.time)

    @cached_property
    def number(self) -> NDArray[np.intp]:
        """Which path each row is on (T)."""
        begin = np.zeros(len(self.time), int)
        if self.begins is not None:
            begin[self.begins] = 1
        return np.cumsum(begin)

    @cached_property
    def joined(self) -> NDArray[np.bool_]:
        """Whether each row and the next are neighbours on one path (T − 1)."""
        return (self.step < APART * np.median(self.step)) & (self.number[1:] == self.number[:-1])

    def before(self, q: Array, rate: Array, d: float) -> Array:
        """q (T) as it was ``d`` seconds before each row; by its series where no two rows of its path enclose that."""
        k, of, row = self._weights(d)
        q, rate = np.ascontiguousarray(q), np.ascontiguousarray(rate)  # read four times
        cubic = of[0] * q.take(k) + of[1] * rate.take(k) + of[2] * q.take(k + 1) + of[3] * rate.take(k + 1)
        k = np.minimum(row, len(self.time) - 2)
        slope = np.where(self.number[k + 1] == self.number[k], (rate[k + 1] - rate[k]) / self.step[k], 0.0)
        cubic[row] = q[row] - d * rate[row] + 0.5 * d**2 * slope
        return np.asarray(cubic)

    def _weights(self, d: float) -> tuple[Rows, Array, Rows]:
        """Row (T) after which ``d`` seconds before each row lies, the cubic's weights (4, T) of angle and speed in it
        and in the next, and rows that no two of their path enclose; those of the last few ages are kept."""
        known = self.kept.get(d)  # threads share a path
        if known is not None:
            return known
        then = self.time - d
        k = np.clip(np.searchsorted(self.time, then, side="right") - 1, 0, len(self.time) - 2)
        h = self.step[k]
        s = (then - self.time[k]) / h
        left, square = (1 - s) ** 2, s**2
        of = np.stack([(1 + 2 * s) * left, s * left * h, square * (3 - 2 * s), square * (s - 1) * h])
        enclosed = (s >= 0) & (s <= 1) & self.joined[k] & (self.number[k] == self.number)
        if len(self.kept) >= AGES:
            self.kept.clear()
        self.kept[d] = found = k, of, np.flatnonzero(~enclosed)
        return found


def read(arm: Arm, time: Array, x: Array, u: Array, begins: Rows | None = None) -> dict[str, Array]:
    """`Arm.outputs` for the states x (T, nx) at ``time`` (T) with what acts there, u (T, nu); joint_position is read as
    late as ``sensor_delay`` says. ``begins``: rows at which a path begins that knows nothing of the one before."""
    if not _delays(arm):
        return arm.outputs(x, u)
    kept, prompt = arm.p.copy(), arm.p.copy()
    for k, name in enumerate(arm.parameters.described):
        if name.startswith("sensor_delay_"):
            prompt[k] = 0.0
    arm._prepare(prompt)
    seen = arm.outputs(x, u)
    arm._prepare(kept)
    _delayed(arm, Path(time, begins), x, seen["joint_position"])
    return seen


def positions(arm: Arm, path: Path, x: Array) -> dict[str, Array]:
    """motor_position and joint_position (T, n) as `read` gives them, for the states x (T, nx) along ``path``."""
    seen = {name: np.empty((len(x), arm.n)) for name in ("motor_position", "joint_position")}
    arm.module.map("positions", len(x), np.ascontiguousarray(x), arm.c, *seen.values())
    _delayed(arm, path, x, seen["joint_position"])
    return seen


def _delays(arm: Arm) -> dict[int, float]:
    """Age of the reading of each joint's encoder, s, where it has one."""
    aged = [j for j in range(1, arm.n + 1) if f"sensor_delay_{j}" in arm.parameters]
    return {j: d for j in aged if (d := arm.parameters[f"sensor_delay_{j}"])}


def _delayed(arm: Arm, path: Path, x: Array, angle: Array) -> None:
    """Make readings ``angle`` (T, n) of the joints' encoders as old as they are, in place."""
    for j, d in _delays(arm).items():
        q, rate = (x[:, arm.index(f"joint_{what}_{j}")] for what in ("position", "velocity"))
        angle[:, j - 1] += path.before(q, rate, d) - q
