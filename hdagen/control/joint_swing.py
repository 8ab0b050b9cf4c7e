"""Reference motions of every joint about the middle of its range, for arms of any number of joints."""

from __future__ import annotations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.reference_motion import Reference, check_sizes, compute_smooth_step

LARGEST_SWING = {"revolute": 0.5, "prismatic": 0.1}  # rad or m
SHARE_OF_RANGE = 0.2
SHARE_OF_SPEED = 0.4
MIDDLE_WITHOUT_RANGE = 0.4  # rad or m
RISE = 1.0  # s from rest to the whole swing
SINES = 5  # of a multisine


def swing_joints(arm: Arm, turn: float, seconds: float, period: float = 1e-3, sines: int = 1) -> Reference:
    """Make a motion in which every joint swings, each at its own frequency, from rest without a jump in acceleration.

    With several ``sines`` each joint moves by a multisine: whole multiples of a frequency with Schroeder's phases,
    together no larger and no faster than the one sine.

    Args:
        arm: The arm, whose limits of position and speed the swings keep.
        turn: The time of one swing of the first joint, s; the others are up to twice as fast.
        seconds: The length of the motion, s.
        period: The time between ticks, s.
        sines: The number of sines of each joint, from 1.

    Returns:
        The motion of the joints.

    Source:
        Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85, for the phases.

    Raises:
        PlantError: A number is not positive and finite, or the motion has no row or far too many.

    """
    check_sizes({"turn": turn, "seconds": seconds, "period": period, "sines": sines}, "a swing")
    t = np.arange(round(seconds / period), dtype=float) * period
    share, slope, bend = compute_smooth_step(t / RISE)
    slope, bend = slope / RISE, bend / RISE**2
    rows = []
    for j, joint in enumerate(arm.robot["joints"]):
        w = 2 * np.pi / turn * (1 + j / max(arm.n - 1, 1)) * 2 / (sines + 1)
        low, high = joint["limits"]["position"] or (None, None)
        middle, size = MIDDLE_WITHOUT_RANGE, LARGEST_SWING[joint["kind"]]
        if low is not None:
            middle, size = (low + high) / 2, min(size, SHARE_OF_RANGE * (high - low))
        if joint["limits"]["speed"]:
            size = min(size, SHARE_OF_SPEED * joint["limits"]["speed"] / w)
        s, s_rate, s_bend = _sum_sines(w, t, sines)
        rows.append((
            middle + size * share * s,
            size * (slope * s + share * s_rate),
            size * (bend * s + 2 * slope * s_rate + share * s_bend),
        ))  # fmt: skip
    position, velocity, acceleration = (np.column_stack(part) for part in zip(*rows, strict=True))
    return Reference("joint", period, position, velocity, acceleration)


def _sum_sines(w: float, t: Array, sines: int) -> tuple[Array, Array, Array]:
    """The mean of sines of w, 2 w, … with Schroeder's phases, and its two derivatives."""
    k = np.arange(1, sines + 1)
    angle = w * k * t[:, None] - np.pi * k * (k - 1) / sines
    s, c = np.sin(angle), np.cos(angle)
    return s.mean(axis=1), (w * k * c).mean(axis=1), -((w * k) ** 2 * s).mean(axis=1)
