"""The axes of the predictive controller's target: the joints, or the tip's position and in space its turn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def count_tip_coordinates(robot: Mapping[str, Any]) -> int:
    """Count the coordinates of the tip's position.

    Args:
        robot: Description of the robot, as the manifest of a build holds it.

    Returns:
        2, or 3 of an arm in space.

    """
    return 3 if "tip" in robot else 2


def count_positions(robot: Mapping[str, Any], space: str) -> int:
    """Count the axes of a target that are places.

    Args:
        robot: Description of the robot, as the manifest of a build holds it.
        space: Space of the target, "tip" or "joint".

    Returns:
        The coordinates of the tip, or the joints.

    """
    return len(robot["joints"]) if space == "joint" else count_tip_coordinates(robot)


def follows_pose(robot: Mapping[str, Any], space: str) -> bool:
    """Tell whether a target has an orientation.

    Args:
        robot: Description of the robot, as the manifest of a build holds it.
        space: Space of the target, "tip" or "joint".

    Returns:
        True for a tip in space.

    """
    return space == "tip" and "tip" in robot
