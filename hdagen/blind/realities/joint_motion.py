"""Motions of rigid joints made of sines, and the torques that move the links of a robot file along them.

Legend: T instants, J joints.
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
    """Compute the torques that move links and rotors along a motion, without friction, from link to link.

    Args:
        joints: base parameters of the joints of a chain in the plane, from its base, SI.
        gravity: gravity along x and y, m/s².
        q: joint angles (T, J), rad.
        v: joint speeds (T, J), rad/s.
        a: joint accelerations (T, J), rad/s².

    Returns:
        Torques at the joints (T, J), N m.

    Source: Luh, Walker, Paul, J. Dyn. Sys. Meas. Control 102 (1980) 69 (Newton and Euler's equations, recursively).

    """
    angle, turning, growing = (np.cumsum(x, axis=1) for x in (q, v, a))
    cosine, sine = np.cos(angle), np.sin(angle)
    # acceleration along x and y of a point at unit distance on each link, seen from the link's own joint
    away = np.stack([-(turning**2) * cosine - growing * sine, -(turning**2) * sine + growing * cosine])
    at = np.zeros((2, len(q)))  # acceleration of the link's joint, m/s², with gravity taken off
    at[0], at[1] = -gravity[0], -gravity[1]
    forces = []
    for j, joint in enumerate(joints):
        forces.append(joint["mass"] * (at + joint["center_of_mass"] * away[:, :, j]))
        at = at + joint["length"] * away[:, :, j]
    torques = np.empty(q.shape)
    carried, moment = np.zeros((2, len(q))), np.zeros(len(q))  # of all links further out, at the end of this one
    for j in reversed(range(len(joints))):
        joint = joints[j]
        arm = joint["center_of_mass"] * forces[j] + joint["length"] * carried
        moment = moment + joint["inertia"] * growing[:, j] + cosine[:, j] * arm[1] - sine[:, j] * arm[0]
        carried = carried + forces[j]
        torques[:, j] = moment + joint["motor_inertia"] * joint["ratio"] ** 2 * a[:, j]
    return torques
