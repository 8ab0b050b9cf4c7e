"""The response of a pushed tip: settling time, overshoot and largest displacement, of the arm and of the ideal mass,
damper and spring."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.simulation.simulator import Push

SETTLED_BAND = 0.1  # share of the largest displacement within which the tip is settled
SETTLING_WINDOW = 2.0  # s after the push in which the tip has to settle
RESPONSE_MEASURES = ("settling", "overshoot", "largest")
LOST_DISTANCE = 0.5  # m: farther off, the arm is no longer under control


def measure_responses(moved: Array, pushes: Sequence[Push], period: float) -> Array:
    """Measure the responses to pushes.

    Args:
        moved: displacements of the tip from its path (T, W, 2), m, of W runs.
        pushes: the pushes, one along each axis.
        period: time between rows, s.

    Returns:
        `RESPONSE_MEASURES` along each push (W, axes, 3): the settling time after it, s (NaN where the tip does not
        settle within WINDOW); the swing past the path as a share of the largest displacement; the largest displacement,
        m. NaN where the arm was lost.

    """
    found = []
    for push in pushes:
        axis = int(np.argmax(np.abs(push.force)))
        begin, end = round(push.start / period), round(push.end / period)
        along = moved[begin : end + round(SETTLING_WINDOW / period), :, axis] * np.sign(push.force[axis])
        lost = ~(np.abs(along).max(axis=0) < LOST_DISTANCE)
        during, after = along[: end - begin + round(0.2 / period)], along[end - begin :]
        largest = np.where(lost, np.nan, during.max(axis=0))
        outside = np.abs(after) > SETTLED_BAND * largest
        last = len(after) - np.argmax(outside[::-1], axis=0)
        settling = np.where(outside.any(axis=0), last * period, 0.0)
        settling = np.where(lost | outside[-1], np.nan, settling)
        overshoot = np.where(lost, np.nan, np.maximum(-after.min(axis=0), 0.0) / largest)
        found.append(np.stack([settling, overshoot, largest], axis=-1))
    return np.stack(found, axis=1)


def simulate_ideal(sets: Array, pushes: Sequence[Push], seconds: float, period: float) -> Array:
    """Simulate M ẍ + B ẋ + K x = F, exact from row to row with the force held.

    Args:
        sets: M, kg, B, N s/m, and K, N/m, of W runs (W, 3).
        pushes: the pushes, which make F.
        seconds: length of the run, s.
        period: time between rows, s.

    Returns:
        Displacement x (T, W, 2), m.

    """
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
    """Compute B / (2 √(K M)).

    Args:
        mass: M, kg.
        damping: B, N s/m, of the same shape.
        stiffness: K, N/m, of the same shape.

    Returns:
        Damping ratio, of the same shape.

    """
    return damping / (2 * np.sqrt(stiffness * mass))
