"""The mass matrix of the planar chain in numbers, and whether it is positive definite wherever the arm can be.

Legend: q joint positions; e(α) unit vector of a link at the angle α against the base; M mass matrix: the links,
and the rotors N² J_m of rigid drives (a flexible drive's rotor is a body of its own).
"""

from __future__ import annotations

import itertools

import numpy as np

from gen.description import Joint

POINTS = 4096  # of the grid at most
SMALLEST = 1e-9  # eigenvalue of M scaled to a unit diagonal
LEAST = 1e-12  # kg m² or kg on the diagonal of M


def mass_matrix(joints: tuple[Joint, ...], q: np.ndarray) -> np.ndarray:
    """M at each row of ``q`` (points × n; rad, m): points × n × n, by the Jacobians of the centres of mass."""
    points, n = q.shape
    turns = np.array([joint.kind == "revolute" for joint in joints], dtype=float)
    alpha = np.cumsum(q * turns, axis=1)
    e = np.stack([np.cos(alpha), np.sin(alpha)], axis=-1)
    origins = np.zeros((points, n, 2))
    tip = np.zeros((points, 2))
    M = np.zeros((points, n, n))
    for j, joint in enumerate(joints):
        origins[:, j] = tip if turns[j] else tip + q[:, j, None] * e[:, j]
        center = origins[:, j] + joint.center_of_mass.nominal * e[:, j]
        columns = np.zeros((points, n, 2))
        for k in range(j + 1):
            lever = center - origins[:, k]
            columns[:, k] = np.stack([-lever[:, 1], lever[:, 0]], axis=-1) if turns[k] else e[:, k]
        spin = turns * (np.arange(n) <= j)
        M += joint.mass.nominal * columns @ columns.transpose(0, 2, 1) + joint.inertia.nominal * np.outer(spin, spin)
        if joint.drive.rigid:
            M[:, j, j] += joint.drive.ratio.nominal**2 * joint.drive.motor_inertia.nominal
        tip = origins[:, j] + joint.length.nominal * e[:, j]
    return M


def singular(joints: tuple[Joint, ...]) -> tuple[tuple[float, ...], float] | None:
    """Joint positions at which M is not positive definite, and its smallest eigenvalue there; None if there are none.

    The eigenvalue is that of M scaled to a unit diagonal. Looked for on a grid over full turns of every revolute
    joint but the first, on which M does not depend, the straight and the folded arm included, and over the stated
    range of every prismatic joint (±1 m where none is stated).
    """
    q = _grid(joints)
    M = mass_matrix(joints, q)
    diagonal = np.einsum("pii->pi", M)
    scale = np.sqrt(np.where(diagonal > LEAST, diagonal, 1.0))
    smallest = np.linalg.eigvalsh(M / (scale[:, :, None] * scale[:, None, :]))[:, 0]
    worst = int(np.argmin(smallest))
    if smallest[worst] > SMALLEST:
        return None
    return tuple(float(value) for value in q[worst]), float(smallest[worst])


def mobility(joints: tuple[Joint, ...]) -> np.ndarray:
    """How easily each joint is moved at most (n), 1/(kg m²) or 1/kg: the diagonal of M⁻¹ over the same grid."""
    return np.asarray(np.diagonal(np.linalg.inv(mass_matrix(joints, _grid(joints))), axis1=1, axis2=2).max(0))


def _grid(joints: tuple[Joint, ...]) -> np.ndarray:
    """Joint positions (points × n)."""
    count = 2 * max(2, int(POINTS ** (1 / max(len(joints) - 1, 1)) / 2))
    axes = [np.zeros(1)] + [_axis(joint, count) for joint in joints[1:]]
    return np.array(list(itertools.product(*axes)))


def _axis(joint: Joint, count: int) -> np.ndarray:
    if joint.kind == "revolute":
        return np.arange(count) * (2 * np.pi / count)
    low, high = joint.limits.position or (-1.0, 1.0)
    return np.linspace(low, high, count - 1)
