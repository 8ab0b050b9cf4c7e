"""How a pushed tip answers: settling time, overshoot and largest displacement, from the arm and from the ideal mass,
damper and spring."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdagen.plant import Array
from hdagen.simulation import Push

BAND = 0.1  # of the largest displacement: within it the tip is settled
WINDOW = 2.0  # s after the push in which it is looked at
MEASURES = ("settling", "overshoot", "largest")
LOST = 0.5  # m: farther off, the arm is no longer under control


def answers(moved: Array, pushes: Sequence[Push], period: float) -> Array:
    """(W, axes, 3) from displacements ``moved`` (T, W, 2, m): along each push the settling time after it, s (NaN where
    it does not settle within WINDOW), how far the tip swings past its path as a share of the largest displacement, and
    that, m. NaN where the arm was lost."""
    found = []
    for push in pushes:
        axis = int(np.argmax(np.abs(push.force)))
        begin, end = round(push.start / period), round(push.end / period)
        along = moved[begin : end + round(WINDOW / period), :, axis] * np.sign(push.force[axis])
        lost = ~(np.abs(along).max(axis=0) < LOST)
        during, after = along[: end - begin + round(0.2 / period)], along[end - begin :]
        largest = np.where(lost, np.nan, during.max(axis=0))
        outside = np.abs(after) > BAND * largest
        last = len(after) - np.argmax(outside[::-1], axis=0)
        settling = np.where(outside.any(axis=0), last * period, 0.0)
        settling = np.where(lost | outside[-1], np.nan, settling)
        overshoot = np.where(lost, np.nan, np.maximum(-after.min(axis=0), 0.0) / largest)
        found.append(np.stack([settling, overshoot, largest], axis=-1))
    return np.stack(found, axis=1)


def ideally(sets: Array, pushes: Sequence[Push], seconds: float, period: float) -> Array:
    """Displacement (T, W, 2, m) of M ẍ + B ẋ + K x = F for ``sets`` (W, 3) of M, B, K, exact from row to row with the
    force held."""
    mass, damping, stiffness = sets.T
    count, T = len(sets), round(seconds / period)
    force = np.zeros((T, 2))
    time = np.arange(T) * period
    for push in pushes:
        force[(time >= push.start) & (time < push.end)] += push.force
    A = np.zeros((count, 3, 3))
    A[:, 0, 1] = 1.0
    A[:, 1] = np.stack([-stiffness / mass, -damping / mass, 1 / mass], axis=1)
    E = np.eye(3) + np.zeros((count, 3, 3))
    scaled = A * period / 1024
    term = E.copy()
    for k in range(1, 6):
        term = term @ scaled / k
        E = E + term
    for _ in range(10):
        E = E @ E
    out, z = np.empty((T, count, 2)), np.zeros((count, 2, 2))
    for k in range(T):
        out[k] = z[:, 0]
        z = E[:, :2, :2] @ z + E[:, :2, 2:] * force[k]
    return out


def damping_ratio(mass: Array, damping: Array, stiffness: Array) -> Array:
    """B / (2 √(K M))."""
    return damping / (2 * np.sqrt(stiffness * mass))
