"""`hdagen.adopt`: the verdict of a diagnosis, put into the robot file."""

from __future__ import annotations

from pathlib import Path

from hdagen.adoption import robot_update
from hdagen.adoption.robot_update import AdoptedRobot
from hdagen.api.log_replay import DiagnosisSource, get_content
from hdagen.api.robot_loading import RobotSource, find_robot_file


def adopt(
    diagnosis: DiagnosisSource,
    robot: RobotSource,
    out: str | Path | None = None,
    *,
    force: bool = False,
    profile: str = "portable",
) -> AdoptedRobot:
    """Put the verdict of a diagnosis into the robot file, whose comments and layout stay as they are.

    Args:
        diagnosis: A diagnosis, the path of its diagnosis.json, or its content.
        robot: The robot.toml that was diagnosed, or the robot that was loaded from it.
        out: Where the new file goes; None: nothing is written.
        force: Whether a file that is there may be replaced.
        profile: Profile of the builds that are made, "portable" or "native".

    Returns:
        The new text, the changed numbers, and the lines that differ.

    Raises:
        PlantError: The diagnosis is of another robot, no model can be built from the corrected file, or ``out`` cannot
            be written.

    """
    return robot_update.adopt(get_content(diagnosis), find_robot_file(robot), out, force, profile)
