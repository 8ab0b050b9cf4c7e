"""A reference motion of every joint about the middle of its range, for arms of any number of joints."""

from __future__ import annotations

import numpy as np

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.reference_motion import MOST_REFERENCE_ROWS, Reference, compute_smooth_step

LARGEST_SWING = {"revolute": 0.5, "prismatic": 0.1}  # rad or m
SHARE_OF_RANGE = 0.2
SHARE_OF_SPEED = 0.4
MIDDLE_WITHOUT_RANGE = 0.4  # rad or m
RISE = 1.0  # s from rest to the whole swing


def swing_joints(arm: Arm, turn: float, seconds: float, period: float = 1e-3) -> Reference:
    """Make a motion in which every joint swings, each at its own frequency, from rest without a jump in acceleration.

    Args:
        arm: The arm, whose limits of position and speed the swings keep.
        turn: The time of one swing of the first joint, s; the others are up to twice as fast.
        seconds: The length of the motion, s.
        period: The time between ticks, s.

    Returns:
        The motion of the joints.

    Raises:
        PlantError: A number is not positive and finite, or the motion has no row or far too many.

    """
    sizes = {"turn": turn, "seconds": seconds, "period": period}
    if wrong := [f"{name} {value}" for name, value in sizes.items() if not 0 < value < np.inf]:
        raise PlantError(f"a swing needs positive, finite numbers; found {', '.join(wrong)}.")
    if not 0.5 < seconds / period <= MOST_REFERENCE_ROWS:
        raise PlantError(f"{seconds} s in periods of {period} s make no motion of 1 to {MOST_REFERENCE_ROWS:g} rows.")
    t = np.arange(round(seconds / period)) * period
    share, slope, bend = compute_smooth_step(t / RISE)
    slope, bend = slope / RISE, bend / RISE**2
    rows = []
    for j, joint in enumerate(arm.robot["joints"]):
        w = 2 * np.pi / turn * (1 + j / max(arm.n - 1, 1))
        low, high = joint["limits"]["position"] or (None, None)
        middle, size = MIDDLE_WITHOUT_RANGE, LARGEST_SWING[joint["kind"]]
        if low is not None:
            middle, size = (low + high) / 2, min(size, SHARE_OF_RANGE * (high - low))
        if joint["limits"]["speed"]:
            size = min(size, SHARE_OF_SPEED * joint["limits"]["speed"] / w)
        s, c = np.sin(w * t), np.cos(w * t)
        rows.append((
            middle + size * share * s,
            size * (slope * s + share * w * c),
            size * (bend * s + 2 * slope * w * c - share * w * w * s),
        ))  # fmt: skip
    position, velocity, acceleration = (np.column_stack(part) for part in zip(*rows, strict=True))
    return Reference("joint", period, position, velocity, acceleration)
