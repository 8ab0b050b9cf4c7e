"""The chain of a robot description: its links as numbers and names of parameters.

The frame of a joint in `gen.model.kinematic_chain` turns about its z or slides along its x. Where a robot file states
another axis, the frame is turned, and with it the link's centre of mass and inertia: these are constants of the model,
so that the turn costs nothing at run time.
"""

from __future__ import annotations

import numpy as np

from gen.model.chain_dynamics import ChainDynamics
from gen.model.kinematic_chain import ChainLink, ChainTip, planar_links
from gen.model.spatial_vectors import Matrix
from gen.robot.description import Robot
from gen.robot.link_geometry import Array, clean_matrix, list_link_geometry, make_rotation
from gen.robot.model_parameters import SPACE_ENTRIES


def make_chain(robot: Robot) -> ChainDynamics:
    """Make the chain of a robot.

    Args:
        robot: The robot description.

    Returns:
        The chain.

    """
    kinds = [joint.kind for joint in robot.joints]
    if robot.tip is None:
        return ChainDynamics(*planar_links(kinds), in_space=False)
    links, before = [], np.eye(3)  # components in the stated frame of a vector given in the joint's own
    for j, (kind, link) in enumerate(zip(kinds, list_link_geometry(robot.joints), strict=True), 1):
        own = _align_axis(link.axis, along=2 if kind == "revolute" else 0)
        names = {key: tuple(f"{key}_{entry}_{j}" for entry in entries) for key, entries in SPACE_ENTRIES.items()}
        x, y, z = clean_matrix(before.T @ link.origin)
        center, inertia = names["center_of_mass"], names["inertia"]
        rotation, turn = _to_rows(before.T @ link.rotation @ own), _to_rows(own.T)
        links.append(ChainLink(kind, rotation, (x, y, z), f"mass_{j}", center, inertia, turn))  # type: ignore[arg-type]
        before = own
    x, y, z = clean_matrix(before.T @ np.array(robot.tip.origin))
    tip = ChainTip((x, y, z), _to_rows(before.T @ make_rotation(robot.tip.rotation)))
    return ChainDynamics(links, tip, in_space=True)


def _align_axis(axis: Array, along: int) -> Array:
    """A rotation whose column ``along`` is a unit vector; of axes of the frame a permutation of these."""
    largest = int(np.argmax(np.abs(axis)))
    start = np.zeros(3)
    start[(largest + (1 if axis[largest] > 0 else 2)) % 3] = 1.0
    if axis[along] == 1.0:
        start = np.roll(np.eye(3)[along], 1)
    second = start - axis * (axis @ start)
    second = second / np.linalg.norm(second)
    columns = [np.zeros(3)] * 3
    columns[along], columns[(along + 1) % 3], columns[(along + 2) % 3] = axis, second, np.cross(axis, second)
    return clean_matrix(np.column_stack(columns))


def _to_rows(matrix: Array) -> Matrix:
    """A matrix as rows of numbers."""
    return tuple((float(x), float(y), float(z)) for x, y, z in clean_matrix(matrix))
