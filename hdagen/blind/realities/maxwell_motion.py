"""Motions of the family "maxwell": moves from point to point with least jerk, pauses, a chirp, and pushes.

Source: Flash, Hogan, J. Neurosci. 5 (1985) 1688, equation 1 (the polynomial of least jerk).
"""

from __future__ import annotations

import math

import numpy as np

from hdagen.blind.realities.two_joint_motion import PERIOD, Motion

_MOVE_SECONDS = (0.25, 1.1)  # s, of a move: quick ones reverse hard, slow ones creep
_PAUSE_SHARE = 0.25  # share of moves after which a joint stands
_PAUSE_SECONDS = (0.1, 0.5)  # s
_REACH = 0.7  # rad to either side
_MOST_SPEED = 3.0  # rad/s at a joint, half of a CSG-17's largest speed
_CHIRP_BAND = (0.8, 22.0)  # Hz
_CHIRP_ACCELERATION = 12.0  # rad/s², largest of the chirp
_LARGEST_CHIRP = 0.04  # rad
_CHIRP_RAMP_SECONDS = 0.4  # s, into the chirp


def draw_point_moves(seed: int, seconds: float) -> Motion:
    """Draw moves of both joints from point to point, with a chirp on top and two pushes at the tip.

    Args:
        seed: seed of the random numbers.
        seconds: length of the motion, s.

    Returns:
        The motion, with a row every `PERIOD`.

    """
    rng = np.random.default_rng([seed, 17])
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    position = np.column_stack([_draw_moves(time, rng) + _draw_chirp(time, rng) for _ in range(2)])
    velocity = np.gradient(position, PERIOD, axis=0)
    fast = max(float(np.abs(velocity).max()) / _MOST_SPEED, 1.0)
    return Motion(time, position / fast, velocity / fast, _draw_pushes(time, rng))


def _draw_moves(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Angles (T,), rad, that begin at 0."""
    angle, at, start = np.zeros(time.size), 0.0, 0.15
    while start < time[-1]:
        lasts = float(rng.uniform(*_MOVE_SECONDS))
        # as far as a move of this length goes without passing the largest speed, 15/8 of its mean
        far = 0.8 * _MOST_SPEED * lasts * 8.0 / 15.0
        goal = float(np.clip(at + rng.uniform(-far, far), -_REACH, _REACH))
        share = np.clip((time - start) / lasts, 0.0, 1.0)
        angle += (goal - at) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        at, start = goal, start + lasts
        if rng.random() < _PAUSE_SHARE:
            start += float(rng.uniform(*_PAUSE_SECONDS))
    return angle


def _draw_chirp(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Sweeps up and down again, with an amplitude that falls with the frequency."""
    low, high = _CHIRP_BAND
    sweep = 0.5 * (1.0 - np.cos(2.0 * np.pi * time / rng.uniform(3.0, 4.5)))
    frequency = low * (high / low) ** sweep
    phase = 2.0 * np.pi * np.cumsum(frequency) * PERIOD + rng.uniform(0.0, 2.0 * np.pi)
    amplitude = np.minimum(_CHIRP_ACCELERATION / (2.0 * np.pi * frequency) ** 2, _LARGEST_CHIRP)
    ramp = np.clip(time / _CHIRP_RAMP_SECONDS, 0.0, 1.0)
    return np.asarray(amplitude * ramp**2 * (3.0 - 2.0 * ramp) * np.sin(phase))


def _draw_pushes(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Two pushes (T, 2), N, each a second long, from any side."""
    force = np.zeros((time.size, 2))
    for share in (0.3, 0.7):
        start, bearing = time[-1] * (share + rng.uniform(-0.1, 0.1)), rng.uniform(-math.pi, math.pi)
        inside = (time >= start) & (time < start + 1.0)
        force[inside] = rng.uniform(5.0, 12.0) * np.array([math.cos(bearing), math.sin(bearing)])
    return force
