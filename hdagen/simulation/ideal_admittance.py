"""The motion M ẍ + B ẋ + K x = F that a law of the tip promises, simulated exactly for forces that hold over a period.

In space the rotation vector e of the tip's orientation from the wanted one moves by M ë + B ė + K e = D(e)ᵀ m, with m
the moment on the tip and D the left Jacobian, Ė = [D ė]× E of E = exp [e]×.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.control.guarded_controller import Controller

PLANE_DIRECTIONS = ("x", "y")
SPACE_DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")


def simulate_ideal_admittance(
    controller: Controller, push: Array, period: float, gains: Mapping[str, float] | None = None
) -> Array:
    """Simulate the admittance that a law of the tip is to show.

    Args:
        controller: The controller, with the gains M, B and K.
        push: (T, 2), the force F, N; in space (T, 6), after it its moment, N m.
        period: The time between rows, s.
        gains: The gains of another admittance; None: the controller's.

    Returns:
        (T, 2), the tip's displacement x, m; in space (T, 6), after it the rotation vector e, rad.

    Raises:
        PlantError: The law has no Cartesian mass, damping and stiffness.

    """
    from scipy.linalg import expm

    names: Mapping[str, float] = controller.gains
    if gains is not None:
        names = gains
    if "mass_x" not in names:
        raise PlantError(f"{controller.law} has no Cartesian mass, damping and stiffness.")
    steps = []
    for axis in PLANE_DIRECTIONS if push.shape[1] == 2 else SPACE_DIRECTIONS:
        M, B, K = (names[f"{kind}_{axis}"] for kind in ("mass", "damping", "stiffness"))
        steps.append(expm(np.array([[0, 1, 0], [-K / M, -B / M, 1 / M], [0, 0, 0]]) * period)[:2])
    by_motion, by_force = np.array(steps)[:, :, :2], np.array(steps)[:, :, 2]
    moved, z = np.zeros_like(push), np.zeros((len(steps), 2))
    for k, pushed in enumerate(push):
        moved[k] = z[:, 0]
        force = pushed
        if len(steps) > 2:
            force = np.concatenate([pushed[:3], find_left_jacobian(z[3:, 0]).T @ pushed[3:]])
        z = np.einsum("aij,aj->ai", by_motion, z) + by_force * force[:, None]
    return moved


def find_left_jacobian(e: Array) -> Array:
    """Find what makes an angular velocity of the rate of a rotation vector.

    Args:
        e: (3), rotation vector, rad.

    Returns:
        (3, 3), D(e).

    """
    x, y, z = e
    turned = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    square = float(e @ e) + 1e-14
    angle = np.sqrt(square)
    halved = np.sin(angle / 2) / angle
    return np.asarray(np.eye(3) + 2 * halved**2 * turned + (1 - np.sin(angle) / angle) / square * turned @ turned)
