"""`hdagen.export`: a robot with the verdict of a diagnosis, as a model of another simulator."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hdagen.adoption.diagnosis_file import read_content
from hdagen.api.log_replay import DiagnosisSource, get_content
from hdagen.api.robot_loading import RobotSource, find_robot_file, name_joints
from hdagen.model_export.corrected_robot import load_corrected_robot
from hdagen.model_export.export_formats import Exported, check_destination, write_export


def export(
    format: str,
    robot: RobotSource,
    out: str | Path,
    *,
    diagnosis: DiagnosisSource | None = None,
    joints: Sequence[str] = (),
    prove: str | Path | None = None,
    closed_loop: str | Path | None = None,
    columns: str | Path | None = None,
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
        joints: The joints' names in the other simulator, base first; none: those of the robot file.
        prove: A log that MuJoCo replays with the model before and after; None: no proof.
        closed_loop: Of a proof, the controller.toml that drives; None: the logged commands do.
        columns: Of a proof, the columns.toml of the log.
        force: Whether a file that is there may be replaced.
        profile: Profile of the build of the model, "portable" or "native".
        options: What the format takes beside these (mjcf, urdf: ``into``, a model to correct; json: ``samples``).

    Returns:
        The files, the numbers that the verdict changed, what the format cannot hold, and the proof.

    Raises:
        PlantError: The format cannot be written, or the diagnosis is of another robot.
        LogError: The log of the proof cannot be used.

    """
    check_destination(format, Path(out), force)
    content = None if diagnosis is None else get_content(diagnosis)
    if isinstance(content, str | Path):
        content = read_content(Path(content))
    if prove is not None:
        from hdagen.model_export.mujoco_proof import read_proof_log

        options["prove"] = read_proof_log(
            prove,
            content,
            Path(closed_loop) if closed_loop else None,
            Path(columns) if columns else None,
            name_joints(robot),
        )
    options = {name: Path(value) if name == "into" and value else value for name, value in options.items()}
    corrected = load_corrected_robot(find_robot_file(robot), content, profile, tuple(joints))
    return write_export(format, corrected, Path(out), **options)
