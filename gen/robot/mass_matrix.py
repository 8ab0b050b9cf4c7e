"""The mass matrix of the planar chain in numbers, and whether it is positive definite wherever the arm can be.

Legend: q joint positions; e(α) unit vector of a link at the angle α against the base; M mass matrix: the links,
and the rotors N² J_m of rigid drives (a flexible drive's rotor is a body of its own).
"""

from __future__ import annotations

import itertools

import numpy as np

from gen.robot.description import Joint

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
    turns = np.array([joint.kind == "revolute" for joint in joints], dtype=float)
    alpha = np.cumsum(q * turns, axis=1)
    e = np.stack([np.cos(alpha), np.sin(alpha)], axis=-1)
    origins = np.zeros((points, n, 2))
    tip = np.zeros((points, 2))
    M = np.zeros((points, n, n))
    for j, joint in enumerate(joints):
        origins[:, j] = tip
        if not turns[j]:
            origins[:, j] = tip + q[:, j, None] * e[:, j]
        center = origins[:, j] + joint.center_of_mass.nominal * e[:, j]
        columns = np.zeros((points, n, 2))
        for k in range(j + 1):
            lever = center - origins[:, k]
            columns[:, k] = e[:, k]
            if turns[k]:
                columns[:, k] = np.stack([-lever[:, 1], lever[:, 0]], axis=-1)
        spin = turns * (np.arange(n) <= j)
        M += joint.mass.nominal * columns @ columns.transpose(0, 2, 1) + joint.inertia.nominal * np.outer(spin, spin)
        if joint.drive.rigid:
            M[:, j, j] += joint.drive.ratio.nominal**2 * joint.drive.motor_inertia.nominal
        tip = origins[:, j] + joint.length.nominal * e[:, j]
    return M


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
    return np.asarray(np.diagonal(np.linalg.inv(mass_matrix(joints, _pose_grid(joints))), axis1=1, axis2=2).max(0))


def _pose_grid(joints: tuple[Joint, ...]) -> np.ndarray:
    """Joint positions (points × n)."""
    count = 2 * max(2, int(MASS_GRID_POINTS ** (1 / max(len(joints) - 1, 1)) / 2))
    axes = [np.zeros(1)] + [_joint_grid(joint, count) for joint in joints[1:]]
    return np.array(list(itertools.product(*axes)))


def _joint_grid(joint: Joint, count: int) -> np.ndarray:
    if joint.kind == "revolute":
        return np.arange(count) * (2 * np.pi / count)
    low, high = joint.limits.position or (-1.0, 1.0)
    return np.linspace(low, high, count - 1)
