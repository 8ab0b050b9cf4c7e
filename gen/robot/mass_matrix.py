"""The mass matrix of the chain in numbers, and whether it is positive definite wherever the arm can be.

Legend: q joint positions; M mass matrix: the links, and the rotors N² J_m of rigid drives (a flexible drive's rotor is
a body of its own).
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from gen.robot.description import Joint
from gen.robot.link_geometry import list_link_geometry

MASS_GRID_POINTS = 4096  # of the grid at most
LEAST_EIGENVALUE = 1e-9  # eigenvalue of M scaled to a unit diagonal
LEAST_DIAGONAL = 1e-12  # kg m² or kg on the diagonal of M


def mass_matrix(joints: tuple[Joint, ...], q: np.ndarray) -> np.ndarray:
    """Compute the mass matrix by the Jacobians of the centres of mass.

    Args:
        joints: The joints, base first.
        q: Joint positions (points × n), rad or m.

    Returns:
        M at each row of ``q`` (points × n × n), kg m² or kg.

    """
    points, n = q.shape
    turned = np.broadcast_to(np.eye(3), (points, 3, 3))
    place = np.zeros((points, 3))
    axes, origins = np.zeros((points, n, 3)), np.zeros((points, n, 3))
    M = np.zeros((points, n, n))
    for j, (joint, link) in enumerate(zip(joints, list_link_geometry(joints), strict=True)):
        place = place + turned @ link.origin
        turned = turned @ link.rotation
        axes[:, j] = turned @ link.axis
        if joint.kind == "prismatic":
            place = place + q[:, j, None] * axes[:, j]
        else:
            turned = turned @ _turns_about(link.axis, q[:, j])
        origins[:, j] = place
        move, spin = np.zeros((points, n, 3)), np.zeros((points, n, 3))
        for k in range(j + 1):
            move[:, k] = axes[:, k]
            if joints[k].kind == "revolute":
                spin[:, k] = axes[:, k]
                move[:, k] = np.cross(axes[:, k], place + turned @ link.center_of_mass - origins[:, k])
        inertia = turned @ link.inertia @ turned.transpose(0, 2, 1)
        M += link.mass * move @ move.transpose(0, 2, 1) + spin @ inertia @ spin.transpose(0, 2, 1)
        if joint.drive.rigid:
            M[:, j, j] += joint.drive.ratio.nominal**2 * joint.drive.motor_inertia.nominal
    return M


def _turns_about(axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Rotations (points × 3 × 3) about a unit vector."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return c * np.eye(3) + s * cross + (1 - c) * np.outer(axis, axis)


def find_singular_pose(joints: tuple[Joint, ...]) -> tuple[tuple[float, ...], float] | None:
    """Find joint positions at which the mass matrix is not positive definite.

    The grid covers full turns of every revolute joint but the first, on which M does not depend, the straight and the
    folded arm included. It covers the stated range of every prismatic joint, or ±1 m where none is stated.

    Args:
        joints: The joints, base first.

    Returns:
        The positions (n), rad or m, and the smallest eigenvalue there, of M scaled to a unit diagonal; None where M is
        positive definite on the whole grid.

    """
    q = _pose_grid(joints)
    M = mass_matrix(joints, q)
    diagonal = np.einsum("pii->pi", M)
    scale = np.sqrt(np.where(diagonal > LEAST_DIAGONAL, diagonal, 1.0))
    smallest = np.linalg.eigvalsh(M / (scale[:, :, None] * scale[:, None, :]))[:, 0]
    worst = int(np.argmin(smallest))
    if smallest[worst] > LEAST_EIGENVALUE:
        return None
    return tuple(float(value) for value in q[worst]), float(smallest[worst])


def joint_mobility(joints: tuple[Joint, ...]) -> np.ndarray:
    """Compute how easily each joint is moved at most, over the grid of `find_singular_pose`.

    Args:
        joints: The joints, base first.

    Returns:
        The largest diagonal of M⁻¹ (n), 1/(kg m²) or 1/kg.

    """
    return np.asarray(np.diagonal(invert_mass_matrix(joints), axis1=1, axis2=2).max(0))


def invert_mass_matrix(joints: tuple[Joint, ...]) -> np.ndarray:
    """Compute the inverse of the mass matrix on the grid of `find_singular_pose`.

    Args:
        joints: The joints, base first.

    Returns:
        M⁻¹ (points × n × n), 1/(kg m²) or 1/kg.

    """
    return np.linalg.inv(mass_matrix(joints, _pose_grid(joints)))


def _pose_grid(joints: tuple[Joint, ...]) -> np.ndarray:
    """Joint positions (points × n); of many joints, of which a whole grid is too large, points at random."""
    count = 2 * max(2, int(MASS_GRID_POINTS ** (1 / max(len(joints) - 1, 1)) / 2))
    axes = [np.zeros(1)] + [_joint_grid(joint, count) for joint in joints[1:]]
    if math.prod(map(len, axes)) > 2 * MASS_GRID_POINTS:
        random = np.random.default_rng(0)
        return np.column_stack([random.choice(axis, MASS_GRID_POINTS) for axis in axes])
    return np.array(list(itertools.product(*axes)))


def _joint_grid(joint: Joint, count: int) -> np.ndarray:
    if joint.kind == "revolute":
        return np.arange(count) * (2 * np.pi / count)
    low, high = joint.limits.position or (-1.0, 1.0)
    return np.linspace(low, high, count - 1)
