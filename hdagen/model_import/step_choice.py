"""A step and widths of smooth friction that carry an imported chain.

Legend: M mass matrix with the rotors; D viscous friction; q joint positions.
"""

from __future__ import annotations

import math

import numpy as np

from hdagen.model_import.chain_reduction import Chain
from hdagen.model_import.compiled_tree import Array

LONGEST_STEP = 0.0005  # s, the robot file's own default
POSES = 64
LARGEST_MODE = 1.0  # of the fastest decay, a step: RK4 is stable to 2.78
LARGEST_SMOOTH_FRICTION = 0.5  # the same of smooth friction, half of what a build carries
LEAST_SMOOTHING = 0.01  # rad/s or m/s


def choose_step(chain: Chain) -> tuple[float, list[float]]:
    """Choose the step and the widths of smooth friction.

    Args:
        chain: The chain.

    Returns:
        The step, s, and for each joint the width, rad/s or m/s.

    """
    rotors = np.diag([link.joint.armature for link in chain.links])
    damping = np.array([link.joint.damping for link in chain.links])
    level = np.array([link.joint.friction for link in chain.links])
    inverses = np.array([np.linalg.inv(mass_matrix(chain, q) + rotors) for q in _draw_poses(chain)])
    fastest = float(np.abs(inverses * damping).sum(axis=2).max())
    step = LONGEST_STEP
    if fastest * step > LARGEST_MODE:
        step = _round_down(LARGEST_MODE / fastest)
    ease = np.abs(inverses).sum(axis=1).max(axis=0)  # of each joint's friction, on all joints together
    widths = [
        _round_up(max(LEAST_SMOOTHING, step * e * f / LARGEST_SMOOTH_FRICTION))
        for e, f in zip(ease, level, strict=True)
    ]
    return step, widths


def _draw_poses(chain: Chain) -> Array:
    """Positions (POSES × n) within the ranges; full turns, or ±1 m, where there is none."""
    random = np.random.default_rng(0)
    rows = []
    for link in chain.links:
        low, high = link.joint.range or ((-math.pi, math.pi) if link.joint.kind == "revolute" else (-1.0, 1.0))
        rows.append(random.uniform(max(low, -math.pi), max(min(high, math.pi), max(low, -math.pi) + 1e-9), POSES))
    return np.array(rows).T


def mass_matrix(chain: Chain, q: Array) -> Array:
    """Compute the mass matrix of the links by the Jacobians of their centres of mass.

    Args:
        chain: The chain.
        q: (n), joint positions.

    Returns:
        (n × n), kg m² or kg.

    """
    n = len(chain.links)
    M, axes, origins = np.zeros((n, n)), np.zeros((n, 3)), np.zeros((n, 3))
    R, o = np.eye(3), np.zeros(3)
    turns = np.array([link.joint.kind == "revolute" for link in chain.links])
    for j, link in enumerate(chain.links):
        o, R = o + R @ link.origin, R @ link.rotation
        axes[j] = R @ link.joint.axis
        if turns[j]:
            x, y, z = link.joint.axis
            K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            R = R @ (np.eye(3) + np.sin(q[j]) * K + (1 - np.cos(q[j])) * K @ K)
        else:
            o = o + q[j] * axes[j]
        origins[j] = o
        move, spin = np.zeros((n, 3)), np.zeros((n, 3))
        spin[: j + 1] = axes[: j + 1] * turns[: j + 1, None]
        arm = o + R @ link.center - origins[: j + 1]
        move[: j + 1] = np.where(turns[: j + 1, None], np.cross(axes[: j + 1], arm), axes[: j + 1])
        M += link.mass * move @ move.T + spin @ (R @ link.inertia @ R.T) @ spin.T
    return M


def _round_up(value: float) -> float:
    """Two digits, upward."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit - 1e-9) * unit:.2g}")


def _round_down(value: float) -> float:
    """Two digits, downward."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit + 1e-9) * unit:.2g}")
