"""Motions of two-joint arms: references and pushes by row, made of sines, holds and a circle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

PERIOD = 1e-3  # s
_SWING_BAND = (0.12, 0.9)  # Hz, slow sines that cover range, speed and load
_MULTISINE_BAND = (1.0, 24.0)  # Hz, small sines that excite the transmission
_MOST_SPEED = 3.0  # rad/s at a joint: half of a CSG-17's largest speed
_HOLD_SECONDS = 0.6  # s
_RAMP_SECONDS = 0.3  # s, into and out of a hold


@dataclass(frozen=True, eq=False)
class Motion:
    """A reference with pushes: ``time`` (T,) s; ``position`` (T, 2) rad and ``velocity`` (T, 2) rad/s; ``force`` (T, 2)
    N on the tip in the base frame, which holds from row k to row k + 1."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    force: np.ndarray


def draw_rich_motion(seed: int, seconds: float = 10.0) -> Motion:
    """Draw slow swings over most of the range with reversals of many sizes, a multisine to 24 Hz, holds and pushes.

    Args:
        seed: seed of the random numbers.
        seconds: length of the motion, s.

    Returns:
        The motion, with a row every `PERIOD`.

    """
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    warped = _warp_with_holds(time, rng)
    position = np.column_stack([_draw_swings(warped, rng) for _ in range(2)])
    moving = np.gradient(warped, PERIOD)
    start = np.clip(time / _RAMP_SECONDS, 0.0, 1.0)
    window = (moving * start * start * (3.0 - 2.0 * start))[:, None]
    position = position + window * np.column_stack([_draw_multisine(time, rng) for _ in range(2)])
    position -= position[0]
    velocity = np.gradient(position, PERIOD, axis=0)
    fast = float(np.abs(velocity).max() / _MOST_SPEED)
    if fast > 1.0:
        position, velocity = position / fast, velocity / fast
    return Motion(time, position, velocity, _draw_pushes(time, rng))


def _warp_with_holds(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A warped time, s, that starts from rest, stands still twice, and runs as fast as the clock in between."""
    rate = np.clip(time / _RAMP_SECONDS, 0.0, 1.0)
    for share in (0.35, 0.75):
        start = time[-1] * (share + rng.uniform(-0.1, 0.1))
        away = np.maximum(start - time, time - start - _HOLD_SECONDS)
        rate = np.minimum(rate, np.clip(away / _RAMP_SECONDS, 0.0, 1.0))
    smooth = rate * rate * (3.0 - 2.0 * rate)
    return np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1]))]) * PERIOD


def _draw_swings(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    frequencies = np.exp(rng.uniform(math.log(_SWING_BAND[0]), math.log(_SWING_BAND[1]), 5))
    amplitudes = rng.uniform(0.5, 1.0, 5) * np.minimum(0.35, 0.16 / frequencies)
    return np.sin(2.0 * np.pi * np.outer(time, frequencies) + rng.uniform(0, 2 * np.pi, 5)) @ amplitudes


def _draw_multisine(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Sixteen lines of about equal acceleration, 25 rad/s² together."""
    frequencies = np.geomspace(*_MULTISINE_BAND, 16) * rng.uniform(0.95, 1.05, 16)
    amplitudes = 25.0 / 4.0 / (2.0 * np.pi * frequencies) ** 2 * rng.uniform(0.5, 1.0, 16)
    amplitudes = np.minimum(amplitudes, 0.02)
    return np.sin(2.0 * np.pi * np.outer(time, frequencies) + rng.uniform(0, 2 * np.pi, 16)) @ amplitudes


def _draw_pushes(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    force = np.zeros((time.size, 2))
    for axis, share in enumerate((0.25, 0.6)):
        start = time[-1] * (share + rng.uniform(-0.1, 0.1))
        force[(time >= start) & (time < start + 1.0), axis] = rng.uniform(5.0, 12.0) * rng.choice([-1.0, 1.0])
    return force


def draw_circle_motion(seed: int, lengths: tuple[float, float], seconds: float = 10.0) -> Motion:
    """Draw the paper's task: a circle of 5 cm radius, pushed in x from 3 s to 4 s and in y from 6 s to 7 s.

    Args:
        seed: seed of the random numbers: place and speed of the circle, sizes of the pushes.
        lengths: lengths of both links, m.
        seconds: length of the motion, s.

    Returns:
        The motion, with a row every `PERIOD`.

    """
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    l1, l2 = lengths
    bearing = rng.uniform(-0.8, 0.8)
    middle = 0.7 * (l1 + l2) * np.array([math.cos(bearing), math.sin(bearing)])
    turn, way = rng.uniform(2.5, 4.0), rng.choice([-1.0, 1.0])
    ramp = np.clip(time / 0.8, 0.0, 1.0)
    rate = ramp * ramp * (3.0 - 2.0 * ramp) * 2.0 * np.pi / turn
    angle = rng.uniform(0, 2 * np.pi) + way * np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * PERIOD
    tip = middle + 0.05 * np.column_stack([np.cos(angle), np.sin(angle)])
    position = _solve_joint_angles(tip, l1, l2)
    force = np.zeros((time.size, 2))
    size = rng.uniform(7.0, 12.0, 2) * rng.choice([-1.0, 1.0], 2)
    force[(time >= 3.0) & (time < 4.0), 0] = size[0]
    force[(time >= 6.0) & (time < 7.0), 1] = size[1]
    return Motion(time, position, np.gradient(position, PERIOD, axis=0), force)


def _solve_joint_angles(tip: np.ndarray, l1: float, l2: float) -> np.ndarray:
    """Joint angles (T, 2) with the elbow on one side, by the law of cosines."""
    x, y = tip.T
    q2 = np.arccos(np.clip((x * x + y * y - l1 * l1 - l2 * l2) / (2 * l1 * l2), -1.0, 1.0))
    q1 = np.arctan2(y, x) - np.arctan2(l2 * np.sin(q2), l1 + l2 * np.cos(q2))
    return np.column_stack([q1, q2])
