"""Motions of joints made of sines, and the torques that the links of a robot file need for them, written out.

Legend: T instants, J joints, one or two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

PERIOD = 1e-3  # s
_SINES = (0.12, 2.0)  # Hz, from slow sweeps over the range to quick reversals
_COUNT = 7
_REACH = 1.4  # rad either way, seldom passed
_START = 1.0  # s, from rest into the motion


@dataclass(frozen=True, eq=False)
class Travel:
    """``time`` (T,) s; ``position`` (T, J) rad, ``velocity`` rad/s and ``acceleration`` rad/s² of the reference."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


def travel(rng: np.random.Generator, speeds: Sequence[float], seconds: float) -> Travel:
    """Sines of about equal speed from rest at 0, which seldom pass ``speeds`` rad/s, by joint, and the reach; more
    ``seconds`` change nothing of what comes before."""
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    ramp = np.clip(time / _START, 0.0, 1.0)
    window = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    position = np.empty((len(time), len(speeds)))
    for j, speed in enumerate(speeds):
        frequencies = np.exp(rng.uniform(math.log(_SINES[0]), math.log(_SINES[1]), _COUNT))
        pulsation = 2.0 * math.pi * frequencies
        amplitudes = rng.uniform(0.5, 1.0, _COUNT) / pulsation
        phases = rng.uniform(0.0, 2.0 * math.pi, _COUNT)
        # crests of sines of no common period meet at some time: twice their root sum of squares is seldom passed
        fast = 2.0 * math.sqrt(float(np.sum((amplitudes * pulsation) ** 2)) / 2.0)
        far = 2.0 * math.sqrt(float(np.sum(amplitudes**2)) / 2.0)
        amplitudes *= min(speed / fast, _REACH / far)
        position[:, j] = window * (np.sin(np.outer(time, pulsation) + phases) @ amplitudes)
    velocity = np.asarray(np.gradient(position, PERIOD, axis=0))
    return Travel(time, position, velocity, np.asarray(np.gradient(velocity, PERIOD, axis=0)))


def link_torques(
    joints: Sequence[Mapping[str, float]],
    gravity: tuple[float, float],
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
) -> np.ndarray:
    """Torques (T, J), N m, at the joints that move links and rotors along ``q``, ``v`` and ``a`` (T, J), without
    friction."""
    gx, gy = gravity
    outer = joints[-1]
    own = outer["mass"] * outer["center_of_mass"]
    inertia = outer["inertia"] + own * outer["center_of_mass"]
    angle = q.sum(axis=1)
    hold = -own * (gy * np.cos(angle) - gx * np.sin(angle))
    rotors = np.array([joint["motor_inertia"] * joint["ratio"] ** 2 for joint in joints])
    if len(joints) == 1:
        return np.asarray((inertia + rotors) * a + hold[:, None])
    inner = joints[0]
    length = inner["length"]
    across, turning = own * length * np.cos(q[:, 1]), own * length * np.sin(q[:, 1])
    carried = inner["mass"] * inner["center_of_mass"] + outer["mass"] * length
    first = inner["inertia"] + inner["mass"] * inner["center_of_mass"] ** 2 + outer["mass"] * length**2
    coupled = inertia + across
    torques = rotors * a
    torques[:, 0] += (first + inertia + 2.0 * across) * a[:, 0] + coupled * a[:, 1] + hold
    torques[:, 0] -= turning * (2.0 * v[:, 0] + v[:, 1]) * v[:, 1]
    torques[:, 0] -= carried * (gy * np.cos(q[:, 0]) - gx * np.sin(q[:, 0]))
    torques[:, 1] += coupled * a[:, 0] + inertia * a[:, 1] + turning * v[:, 0] ** 2 + hold
    return np.asarray(torques)
