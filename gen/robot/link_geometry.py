"""The links of a robot as numbers in space, whichever form the robot file has.

In the short form a revolute joint turns about z and a prismatic joint slides along x; each link lies along x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gen.robot.description import Joint, PlanarLink, Robot

Array = NDArray[np.float64]
AXES = ("x", "y", "z")
STEEP = 0.8  # cosine of the angle to upright of an axis that is too steep to be level
ROUNDING = 1e-15  # of an entry of a product of rotations


@dataclass(frozen=True)
class LinkGeometry:
    """A link with its joint, in the joint's frame but for the frame itself.

    Attributes:
        origin: (3), the joint's frame in the frame before, m.
        rotation: (3 × 3), components in the frame before of a vector given in the joint's.
        axis: (3), unit vector.
        mass: kg.
        center_of_mass: (3), m.
        inertia: (3 × 3), about the centre of mass, kg m².

    """

    origin: Array
    rotation: Array
    axis: Array
    mass: float
    center_of_mass: Array
    inertia: Array


def list_link_geometry(joints: tuple[Joint, ...]) -> list[LinkGeometry]:
    """List the links of a chain.

    Args:
        joints: The joints, base first.

    Returns:
        The links with their nominal values.

    """
    links, end = [], 0.0  # end of the link before, of the short form
    for joint in joints:
        link, mass = joint.link, joint.mass.nominal
        if isinstance(link, PlanarLink):
            axis = {"revolute": [0.0, 0.0, 1.0], "prismatic": [1.0, 0.0, 0.0]}[joint.kind]
            center, inertia = [link.center_of_mass.nominal, 0.0, 0.0], np.diag([0.0, 0.0, link.inertia.nominal])
            links.append(
                LinkGeometry(np.array([end, 0, 0]), np.eye(3), np.array(axis), mass, np.array(center), inertia)
            )
            end = link.length.nominal
            continue
        xx, yy, zz, xy, xz, yz = (value.nominal for value in link.inertia)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        place = np.array([value.nominal for value in link.center_of_mass])
        rotation = make_rotation(link.rotation)
        links.append(LinkGeometry(np.array(link.origin), rotation, np.array(link.axis), mass, place, tensor))
    return links


def find_tip_offset(robot: Robot) -> Array:
    """Find the tip in the last joint's frame.

    Args:
        robot: The robot description.

    Returns:
        (3), m.

    """
    link = robot.joints[-1].link
    if robot.tip is not None:
        return np.array(robot.tip.origin)
    assert isinstance(link, PlanarLink)
    return np.array([link.length.nominal, 0.0, 0.0])


def find_level_axes(robot: Robot) -> tuple[Array, Array]:
    """Find two level directions of the base frame, across gravity and each other.

    Args:
        robot: The robot description.

    Returns:
        The level part of x, or of y where x is within 37° of upright, and the direction across it to its left, seen
        from above ((3) each, unit vectors). Without gravity or in the plane, x and y.

    """
    parts = np.array([part.nominal for part in robot.gravity])
    if len(parts) < len(AXES) or not parts.any():
        return np.eye(3)[0], np.eye(3)[1]
    up = -parts / np.linalg.norm(parts)
    start = np.eye(3)[int(abs(up[0]) > STEEP)]
    first = start - up * (up @ start)
    first = first / np.linalg.norm(first)
    return first, np.cross(up, first)


def make_rotation(quaternion: tuple[float, ...]) -> Array:
    """Make the matrix of a rotation.

    Args:
        quaternion: Unit quaternion w, x, y, z.

    Returns:
        (3 × 3), components in the frame before of a vector given in the turned one. Entries that only rounding keeps
        from 0 and ±1 are these.

    """
    w, x, y, z = quaternion
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return clean_matrix(np.array(rows))


def clean_matrix(matrix: Array) -> Array:
    """Replace entries that only rounding keeps from 0 and ±1.

    Args:
        matrix: A rotation (3 × 3).

    Returns:
        The rotation.

    """
    whole = np.round(matrix)
    return np.where(np.abs(matrix - whole) < ROUNDING, whole, matrix) + 0.0
