"""`hdagen.export`: a robot with the verdict of a diagnosis, as a model of another simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hdagen.api.log_replay import DiagnosisSource, get_content
from hdagen.api.robot_loading import RobotSource, find_robot_file
from hdagen.model_export.corrected_robot import load_corrected_robot
from hdagen.model_export.export_formats import Exported, check_destination, write_export


def export(
    format: str,
    robot: RobotSource,
    out: str | Path,
    *,
    diagnosis: DiagnosisSource | None = None,
    force: bool = False,
    profile: str = "portable",
    **options: Any,
) -> Exported:
    """Write a robot as a model of another simulator.

    Args:
        format: "mjcf", "urdf", "json", …, as `hdagen export --help` lists them.
        robot: A preset, the path of a robot.toml, or the robot that was loaded from it.
        out: Where it is written.
        diagnosis: A diagnosis, the path of its diagnosis.json, or its content; None: the robot as its file has it.
        force: Whether a file that is there may be replaced.
        profile: Profile of the build of the model, "portable" or "native".
        options: What the format takes beside these.

    Returns:
        The files, the numbers that the verdict changed, and what the format cannot hold.

    Raises:
        PlantError: The format cannot be written, or the diagnosis is of another robot.

    """
    check_destination(format, Path(out), force)
    stated = None if diagnosis is None else get_content(diagnosis)
    corrected = load_corrected_robot(find_robot_file(robot), stated, profile)
    return write_export(format, corrected, Path(out), **options)
