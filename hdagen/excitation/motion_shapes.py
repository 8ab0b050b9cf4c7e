"""Shapes of motions that excite an arm: multisines, reversals, ramps and holds.

Legend: T rows, n joints; a shape is a motion about the middle posture in [−1, 1], at rest at both ends.
Sources: Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85 (phases of a multisine); Swevers et al., IEEE Trans. Robot.
Autom. 13 (1997) 730 (periodic excitation of robots).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.reference_motion import compute_smooth_step


@dataclass(frozen=True, eq=False)
class MotionShape:
    """A motion of the joints in words, and its shape (T, n)."""

    name: str
    shape: Array


def list_motions(arm: Arm, joint: int, duration: float, period: float) -> list[MotionShape]:
    """List the motions that are tried.

    Args:
        arm: The arm.
        joint: Number of the joint whose effect is asked for, from 1; 0: the whole arm.
        duration: Length of a motion, s.
        period: Time from row to row, s.

    Returns:
        The motions.

    """
    count = round(duration / period)
    t: Array = np.arange(count, dtype=float) * period
    ends = compute_smooth_step(np.minimum(t, t[-1] - t) / min(0.5, duration / 8))[0][:, None]
    alone = np.array([float(joint in (0, j)) for j in range(1, arm.n + 1)])
    gentle = np.where(alone > 0, 1.0, 0.3)  # the other joints change inertia and load meanwhile
    found = [
        MotionShape(f"multisine to {band:g} Hz", ends * _draw_multisine(t, arm.n, duration / 2, 0.5 * band / 8, band))
        for band in (1.5, 6.0, 25.0)
        if band < 0.1 / period
    ]
    slow = _stack_joints(lambda j: _draw_ramps(t, (1, -1, 0.5, -0.5, 0.25, -0.25, 0.1, -0.1), j), arm.n)
    fine = _stack_joints(lambda j: _draw_ramps(t, (0.1, -0.1, 0.06, -0.06, 0.03, -0.03, 0.015, -0.015), j), arm.n)
    speeds = _stack_joints(lambda j: _draw_speed_ramps(t, j), arm.n)
    holds = _stack_joints(lambda j: _draw_holds(t, j), arm.n)
    fast = _draw_multisine(t, arm.n, duration / 2, 1.0, min(25.0, 0.1 / period))
    third = (3 * t / duration).astype(int)[:, None]
    parts = compute_smooth_step(np.minimum(3 * t / duration % 1, 1 - 3 * t / duration % 1) / 0.1)[0][:, None]
    turns = _stack_joints(lambda j: _draw_ramps(3 * t % duration, (1, -1, 0.3, -0.3), j), arm.n)
    rests = _stack_joints(lambda j: _draw_holds(3 * t % duration, j), arm.n)
    found += [
        MotionShape("slow reversals of falling amplitude", ends * slow * gentle),
        MotionShape("fine reversals", ends * fine * gentle),
        MotionShape("ramps of rising speed", ends * speeds * gentle),
        MotionShape("holds at nine poses", ends * holds),
        MotionShape("slow reversals with a fast multisine", ends * (0.9 * slow * gentle + 0.02 * fast)),
        MotionShape(
            "multisine, reversals, holds", parts * np.where(third == 0, 0.1 * fast, np.where(third == 1, turns, rests))
        ),
    ]
    if joint and arm.n > 1:
        found.append(MotionShape("slow reversals, the other joints at rest", ends * slow * alone))
    return found


def _stack_joints(shape: Callable[[int], Array], n: int) -> Array:
    return np.stack([shape(j) for j in range(n)], 1)


def _draw_multisine(t: Array, n: int, base: float, low: float, high: float) -> Array:
    """Each joint its own harmonics of 1/base Hz from ``low`` to ``high``, none above the speed of the first."""
    harmonics = np.unique(np.round(np.geomspace(max(low * base, 1), high * base, 12 * n)).astype(int))
    shapes = []
    for j in range(n):
        own = harmonics
        if len(harmonics) >= n:
            own = harmonics[j::n]
        size = 1.0 / own
        phase = -np.pi * np.arange(len(own)) * (np.arange(len(own)) + 1 + j) / len(own)
        wave = np.sin(2 * np.pi * np.outer(t, own) / base + phase) @ size
        shapes.append(wave / np.abs(wave).max())
    return np.stack(shapes, 1)


def _draw_ramps(t: Array, turns: Sequence[float], j: int) -> Array:
    """Ramps from turning point to turning point at one speed, corners rounded; joint after joint the other way."""
    corners = np.array([0.0, *turns, 0.0]) * (-1) ** j
    when = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)))])
    return _round_corners(np.interp(t, when / when[-1] * t.max(), corners))


def _draw_speed_ramps(t: Array, j: int) -> Array:
    """To and fro, each time faster: the speeds of the ramps as 1 : 2 : 4 : 8 : 16."""
    durations = np.repeat([1.0, 0.5, 0.25, 0.125, 0.0625], 2)
    corners = np.array([-1.0, 1.0] * 5 + [-1.0]) * (-1) ** j
    lead = 0.1
    when = np.concatenate(
        [[0.0], lead + np.concatenate([[0.0], np.cumsum(durations)]), [lead + durations.sum() + lead]]
    )
    return _round_corners(np.interp(t, when / when[-1] * t[-1], np.concatenate([[0.0], corners, [0.0]])))


def _draw_holds(t: Array, j: int) -> Array:
    """Nine poses, each held for two thirds of its time."""
    poses = np.array([0.0, 0.5, 1.0, 0.3, -0.4, -1.0, -0.6, 0.1, 0.7, 0.0])
    if j % 2:
        poses = np.array([0.0, -0.8, 0.2, 0.9, -0.3, 0.6, 1.0, -0.5, -1.0, 0.0])
    place = np.clip(t / t.max() * 9, 0, 9 - 1e-9)
    k = place.astype(int)
    return poses[k] + (poses[k + 1] - poses[k]) * compute_smooth_step(3 * (place - k))[0]


def _round_corners(wave: Array) -> Array:
    """Corners rounded over a hundredth of the whole, without a jump in acceleration."""
    width = max(3, len(wave) // 100)
    kernel = np.hanning(width + 2)[1:-1]
    padded = np.pad(wave, (width, width), mode="edge")
    return np.convolve(padded, kernel / kernel.sum(), mode="same")[width:-width]
