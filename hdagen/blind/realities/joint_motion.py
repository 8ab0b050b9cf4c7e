"""Motions of rigid joints made of sines, and the torques that move the links of a robot file along them.

Legend: T instants, J joints, one or two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

PERIOD = 1e-3  # s
_SINE_BAND = (0.12, 2.0)  # Hz, from slow sweeps over the range to quick reversals
_SINE_COUNT = 7  # number of sines
_USUAL_REACH = 1.4  # rad to either side, seldom passed
_START_SECONDS = 1.0  # s, from rest into the motion


@dataclass(frozen=True, eq=False)
class JointMotion:
    """A reference: ``time`` (T,) s; ``position`` (T, J) rad, ``velocity`` rad/s and ``acceleration`` rad/s²."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


def draw_joint_motion(rng: np.random.Generator, speeds: Sequence[float], seconds: float) -> JointMotion:
    """Draw sines of about equal speed that start from rest at 0; a longer motion begins with the shorter one.

    Args:
        rng: the random generator.
        speeds: speed of each joint that its motion seldom passes, rad/s.
        seconds: length of the motion, s.

    Returns:
        The reference of all joints, with a row every `PERIOD`.

    """
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    ramp = np.clip(time / _START_SECONDS, 0.0, 1.0)
    window = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    position = np.empty((len(time), len(speeds)))
    for j, speed in enumerate(speeds):
        frequencies = np.exp(rng.uniform(math.log(_SINE_BAND[0]), math.log(_SINE_BAND[1]), _SINE_COUNT))
        pulsation = 2.0 * math.pi * frequencies
        amplitudes = rng.uniform(0.5, 1.0, _SINE_COUNT) / pulsation
        phases = rng.uniform(0.0, 2.0 * math.pi, _SINE_COUNT)
        # sines without a common period seldom pass twice the root of their mean square
        fast = 2.0 * math.sqrt(float(np.sum((amplitudes * pulsation) ** 2)) / 2.0)
        far = 2.0 * math.sqrt(float(np.sum(amplitudes**2)) / 2.0)
        amplitudes *= min(speed / fast, _USUAL_REACH / far)
        position[:, j] = window * (np.sin(np.outer(time, pulsation) + phases) @ amplitudes)
    velocity = np.asarray(np.gradient(position, PERIOD, axis=0))
    return JointMotion(time, position, velocity, np.asarray(np.gradient(velocity, PERIOD, axis=0)))


def compute_link_torques(
    joints: Sequence[Mapping[str, float]],
    gravity: tuple[float, float],
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
) -> np.ndarray:
    """Compute the torques that move links and rotors along a motion, without friction.

    Args:
        joints: base parameters of one or two joints, SI.
        gravity: gravity along x and y, m/s².
        q: joint angles (T, J), rad.
        v: joint speeds (T, J), rad/s.
        a: joint accelerations (T, J), rad/s².

    Returns:
        Torques at the joints (T, J), N m.

    """
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
