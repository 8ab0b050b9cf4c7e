"""Robots as callers have them: presets, robot files, and arms that are loaded already."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hdagen.adoption import verdict
from hdagen.arm.build_loader import PlantError, StructuredController
from hdagen.arm.compiled_arm import Arm, load
from hdagen.arm.joint_names import list_joint_names, read_joint_names

RobotSource = str | Path | Arm  # a preset, the path of a robot.toml, or an arm that was loaded from one of them


def load_robot(
    robot: RobotSource = "paper",
    *,
    effects: tuple[str, ...] = (),
    profile: str = "portable",
    out: str | Path | None = None,
    mpc: StructuredController | None = None,
) -> Arm:
    """Load a robot as a compiled arm; one that is not built yet is built first.

    Args:
        robot: A preset, or the path of a robot.toml. An arm is returned as it is.
        effects: Names of effects that are added to the model.
        profile: "portable" or "native", which is for this machine alone.
        out: The folder where builds lie; None: $HDAGEN_BUILD, else ./build if it exists, else the user's cache.
        mpc: A configuration of the predictive controller, which is then compiled into the library.

    Returns:
        The arm.

    Raises:
        PlantError: The robot file has problems, or the robot cannot be built or loaded.

    """
    if isinstance(robot, Arm):
        return robot
    return load(robot, profile, effects, out, mpc)


def find_robot_file(robot: RobotSource) -> str | Path:
    """Find the preset or the robot file of a robot, whose model is then built with other effects.

    Args:
        robot: A preset, a path, or an arm.

    Returns:
        The preset or the path.

    Raises:
        PlantError: The arm was loaded from the folder of a build, or has other parameters than its robot file.

    """
    if not isinstance(robot, Arm):
        return robot
    if robot.source is None:
        raise PlantError(
            f"{robot!r} was loaded from the folder of a build, and other effects are wanted: "
            "give the preset or the robot.toml."
        )
    changed = [
        name for name, q in robot.parameters.described.items() if not np.isclose(robot.parameters[name], q.nominal)
    ]
    if changed:
        raise PlantError(
            f"{robot.source}: {', '.join(changed[:8])} differ from the robot file, which is built anew with other "
            "effects: write them into the file, or give the file to leave them out."
        )
    return robot.source


def name_joints(robot: RobotSource) -> tuple[str | None, ...]:
    """Name the joints of a robot.

    Args:
        robot: A preset, a path, or an arm.

    Returns:
        A name each, None where the robot file gives none; empty where there is no file to read.

    Raises:
        PlantError: A model cannot be imported.

    """
    if isinstance(robot, Arm):
        return list_joint_names(robot)
    return read_joint_names(robot)


def load_diagnosed_robot(robot: RobotSource, stated: verdict.Verdict | None, profile: str = "portable") -> Arm:
    """Load a robot whose model has the effects of a verdict, at the parameters of the robot file.

    Args:
        robot: A preset, a path, or an arm.
        stated: The verdict; None: the robot as it is.
        profile: "portable" or "native".

    Returns:
        The arm.

    Raises:
        PlantError: The robot cannot be loaded, or the verdict is of another one.

    """
    if stated is None:
        return load_robot(robot, profile=profile)
    return verdict.load_with_effects(find_robot_file(robot), profile, stated)
