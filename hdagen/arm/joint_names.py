"""Names of a robot's joints: read without a build, and put in place of numbers or taken for them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import find_build_folder, find_robot_file
from hdagen.arm.compiled_model import CompiledModel
from hdagen.arm.preset_files import find_preset_files
from hdagen.model_import.model_file import is_model_file
from hdagen.support.input_file import InputFileError, read_toml

JointNames = Sequence[str | None]  # of all joints, None where one has no name
MOST_ROBOT_BYTES = 1_000_000  # bytes of a robot file


def list_joint_names(arm: CompiledModel) -> tuple[str | None, ...]:
    """List the names of an arm's joints.

    Args:
        arm: The arm.

    Returns:
        A name each, None where the robot file gives none.

    """
    return tuple(joint.get("name") for joint in arm.robot["joints"])


def read_joint_names(robot: str | Path) -> tuple[str | None, ...]:
    """Read the names of a robot's joints from its file, before anything is built.

    Args:
        robot: A preset, a robot.toml or a model, which is imported.

    Returns:
        A name each, None where the file gives none; empty where the file cannot be read, which loading it then says.

    Raises:
        PlantError: A model cannot be imported.

    """
    file = find_preset_files().get(str(robot), Path(robot))
    if is_model_file(file):
        file = Path(find_robot_file(str(file), find_build_folder()))
    try:
        joints: Any = read_toml(file, MOST_ROBOT_BYTES, "name a robot.toml or a preset").get("joint", [])
    except InputFileError:
        return ()
    if not isinstance(joints, list):
        return ()
    names = [joint.get("name") if isinstance(joint, dict) else None for joint in joints]
    return tuple(name if isinstance(name, str) else None for name in names)


def number_joint(joint: str, names: JointNames) -> str:
    """Give a joint's number in place of its name.

    Args:
        joint: A number or a name.
        names: Names of the joints.

    Returns:
        The number; a text that names no joint as it is.

    """
    if joint in names:
        return str(names.index(joint) + 1)
    return joint


def number_effect(entry: str, names: JointNames) -> str:
    """Give the number of the joint in place of its name in effect@joint.

    Args:
        entry: The effect, as "stribeck_friction@elbow_joint".
        names: Names of the joints.

    Returns:
        The effect, as "stribeck_friction@3".

    """
    effect, at, joint = entry.partition("@")
    return effect + at + number_joint(joint, names)
