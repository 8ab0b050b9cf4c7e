"""Walls that the tip keeps, and the room between them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

WALL_ROUNDING = 1e-9  # m
LEAST_WALL_GAP = 1e-8  # m: walls with less room than this between them leave none
LEAST_CROSSING = 1e-6  # sine of the angle at which walls cross


@dataclass(frozen=True)
class Wall:
    """A half-plane, in space a half-space, that the tip keeps: normal · tip ≤ offset (m). With ``stiffness`` (N/m)
    it is a surface that the tip may press with ``force`` (N); without, a fixture that is only in the controller.
    ``margin``, m."""

    normal: tuple[float, ...]
    offset: float
    stiffness: float | None = None
    force: float | None = None
    margin: float = 5e-4

    @property
    def give(self) -> float:
        """How far the tip may press into the wall, m."""
        if self.stiffness is None or self.force is None:
            return 0.0
        return self.force / self.stiffness


def leave_no_room(walls: tuple[Wall, ...]) -> bool:
    """Tell whether no point lies behind all walls, by more than rounding.

    Args:
        walls: The walls.

    """
    return find_least_distance([replace(wall, offset=wall.offset - LEAST_WALL_GAP) for wall in walls]) is None


def find_least_distance(walls: Sequence[Wall]) -> float | None:
    """Find how near to the base the walls let the tip come.

    The nearest point is the base itself, its foot on a wall, or its foot on where as many walls cross as there are
    coordinates, or fewer.

    Args:
        walls: The walls.

    Returns:
        The distance, m; None where no point lies behind all walls.

    """
    if not walls:
        return 0.0
    normals, offsets = np.array([wall.normal for wall in walls]), np.array([wall.offset for wall in walls])
    coordinates = normals.shape[1]
    distances = []
    for count in range(coordinates + 1):
        for chosen in map(list, itertools.combinations(range(len(walls)), count)):
            N = normals[chosen]
            if np.linalg.matrix_rank(N, LEAST_CROSSING) < count:
                continue
            point = N.T @ np.linalg.solve(N @ N.T, offsets[chosen])
            if (normals @ point <= offsets + WALL_ROUNDING).all():
                distances.append(float(np.linalg.norm(point)))
    return min(distances, default=None)
