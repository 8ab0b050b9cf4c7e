"""Paths of the tip in the plane or in space: circle, line and Lissajous figure, from rest to full speed and smooth.

A path begins at the tip's pose and keeps its orientation. Legend: φ phase, which grows by 2π a turn at full speed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.control.reference_motion import Reference, advance_phase, check_sizes

Offsets = tuple[Array, Array, Array]  # from the begin of a path, and its derivatives by φ, (T, k) each


def _circle_offsets(phase: Array, axes: Array) -> Offsets:
    s, c = np.sin(phase)[:, None], np.cos(phase)[:, None]
    return (c - 1) * axes[0] + s * axes[1], c * axes[1] - s * axes[0], -c * axes[0] - s * axes[1]


def _line_offsets(phase: Array, axes: Array) -> Offsets:
    s, c = np.sin(phase)[:, None], np.cos(phase)[:, None]
    return s * axes[0], c * axes[0], -s * axes[0]


def _lissajous_offsets(phase: Array, axes: Array) -> Offsets:
    """Along axis k a sine of k times the frequency and the k-th part of the size, so that all are equally fast."""
    k = np.arange(1, len(axes) + 1)
    s, c = np.sin(phase[:, None] * k), np.cos(phase[:, None] * k)
    return (s / k) @ axes, c @ axes, -(s * k) @ axes


TIP_PATHS: dict[str, Callable[[Array, Array], Offsets]] = {
    "circle": _circle_offsets,
    "line": _line_offsets,
    "lissajous": _lissajous_offsets,
}


def make_tip_path(
    shape: str,
    pose: ArrayLike,
    size: float,
    turn: float,
    seconds: float,
    direction: ArrayLike | None = None,
    period: float = 1e-3,
) -> Reference:
    """Make a motion of the tip along a path that begins at a pose.

    Args:
        shape: "circle", "line" (to and fro) or "lissajous".
        pose: (2) in the plane, or (6) in space: the tip where the path begins, m and in space its rotation vector, rad.
        size: Radius of the circle, and the largest distance from the begin along a line or an axis, m.
        turn: The time of one turn at full speed, s.
        seconds: The length of the motion, s.
        direction: (2) or (3), along the line, at right angles to a circle in space, and the last axis of a Lissajous
            figure in space; None: along the last axis of the base frame.
        period: The time between ticks, s.

    Returns:
        The motion of the tip.

    Raises:
        PlantError: An argument is not possible.

    """
    check_sizes({"size": size, "turn": turn, "seconds": seconds, "period": period}, "a path of the tip")
    begin = np.asarray(pose, float)
    many = {2: 2, 6: 3}.get(begin.size, 0)
    if shape not in TIP_PATHS or not many or not np.isfinite(begin).all():
        raise PlantError(
            f"a path is one of {', '.join(TIP_PATHS)} from 2 or 6 finite numbers, not {shape} from {begin}."
        )
    angle, rate, change = advance_phase(turn, seconds, period)
    at, slope, bend = TIP_PATHS[shape](angle, size * _find_axes(shape, direction, many))
    position, velocity, acceleration = np.tile(begin, (len(angle), 1)), *np.zeros((2, len(angle), begin.size))
    position[:, :many] += at
    velocity[:, :many] = slope * rate[:, None]
    acceleration[:, :many] = bend * rate[:, None] ** 2 + slope * change[:, None]
    return Reference("tip", period, position, velocity, acceleration)


def _find_axes(shape: str, direction: ArrayLike | None, many: int) -> Array:
    """Unit vectors of a path, rows at right angles: of a line the first one is the direction, else the last one."""
    along = np.eye(many)[-1]
    if direction is not None:
        along = np.asarray(direction, float)
    length = np.linalg.norm(along)
    if along.shape != (many,) or not 0 < length < np.inf:
        raise PlantError(f"a direction of this arm's tip is {many} finite numbers, not all 0, not {along}.")
    if many == 2:
        along = along / length
        return np.array([along, [-along[1], along[0]]])
    start = np.eye(3)[np.argmin(np.abs(along))]
    first = np.cross(np.cross(along, start), along)
    axes = np.array([first, np.cross(along, first), along])
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    if shape == "line":
        return np.roll(axes, 1, axis=0)
    return axes
