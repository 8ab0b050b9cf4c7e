"""A robot file as the exporters of models read an arm, without a build: its description and its nominal parameters."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, cast

from gen.presets import find_presets
from gen.robot.description import describe_robot
from gen.robot.load_robot import from_table
from gen.robot.model_parameters import list_parameters
from hdagen.arm.compiled_arm import Arm
from hdagen.model_export.corrected_robot import CorrectedRobot


class _Parameters(dict[str, float]):
    """Nominal values by name; no effect is in the model."""

    def __init__(self, values: dict[str, float]) -> None:
        super().__init__(values)
        self.described: dict[str, Any] = {}


class _DescribedArm:
    """The part of an arm that a robot file alone states."""

    def __init__(self, text: str) -> None:
        robot = from_table(tomllib.loads(text), "robot.toml", Path("robot.toml"))
        self.robot = json.loads(json.dumps(describe_robot(robot), default=list))
        self.n, self.moves_in_space, self.stable_step = len(robot.joints), robot.in_space, robot.step
        self.parameters = _Parameters({value.name: value.nominal for value in list_parameters(robot)})
        self.input_names = tuple(f"motor_torque_{j}" for j in range(1, self.n + 1))


def describe_arm(robot: str) -> CorrectedRobot:
    """A robot to export, of a preset's name or a robot file's text; no verdict, and no current as its input."""
    text = find_presets()[robot].read_text(encoding="utf-8") if robot in find_presets() else robot
    arm = cast("Arm", _DescribedArm(text))
    return CorrectedRobot("robot.toml", arm, arm)
