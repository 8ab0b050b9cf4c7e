"""Walls that the tip keeps, and the room between them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

WALL_ROUNDING = 1e-9  # m
LEAST_WALL_GAP = 1e-8  # m: walls with less room than this between them leave none


@dataclass(frozen=True)
class Wall:
    """A half-plane that the tip keeps: normal · tip ≤ offset (m). With ``stiffness`` (N/m) it is a surface that the tip
    may press with ``force`` (N); without, a fixture that is only in the controller. ``margin``, m."""

    normal: tuple[float, float]
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

    The nearest point is the base itself, its foot on a wall, or a crossing of two walls.

    Args:
        walls: The walls.

    Returns:
        The distance, m; None where no point lies behind all walls.

    """
    lines = [(*wall.normal, wall.offset) for wall in walls]
    points = [(0.0, 0.0)] + [(x * offset, y * offset) for x, y, offset in lines]
    for (a, b, one), (p, q, other) in itertools.combinations(lines, 2):
        across = a * q - b * p
        if abs(across) > 1e-12:
            points.append(((one * q - other * b) / across, (other * a - one * p) / across))
    distances = []
    for x, y in points:
        if all(a * x + b * y <= offset + WALL_ROUNDING for a, b, offset in lines):
            distances.append(math.hypot(x, y))
    return min(distances, default=None)
