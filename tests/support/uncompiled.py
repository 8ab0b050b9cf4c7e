"""Arms without a compiled library: parameters and description of a robot file as a build would have them."""

from __future__ import annotations

import json
from pathlib import Path

from gen.builder.build import assemble_library
from gen.builder.build_files import make_manifest
from gen.builder.step_stability import StepExamination
from gen.effects.effect import Effect
from gen.model.function_library import Library
from gen.robot.description import RobotError
from gen.robot.load_robot import load as load_description
from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm


class UncompiledArm(Arm):
    """An arm that has parameters and can compute nothing."""

    def __init__(self, robot: str | Path, effects: tuple[str, ...] = ()) -> None:
        made, present, examined = _assemble(robot, effects)
        if problems := examined.refusals(str(robot)):
            raise PlantError("\n".join(problems))
        self.manifest = json.loads(json.dumps(make_manifest(made, present, "", {"profile": "none"}), default=list))
        self._read_manifest()

    def _set_parameters(self, p: Array) -> None:
        self.p = p


def load_uncompiled(robot: str | Path, profile: str = "portable", effects: tuple[str, ...] = ()) -> UncompiledArm:
    """In the place of `hdagen.arm.compiled_arm.load`."""
    return UncompiledArm(robot, effects)


def find_settings(robot: Path) -> tuple[float, tuple[float, ...]]:
    """In the place of `hdagen.arm.build_loader.find_stable_settings`."""
    return _assemble(robot, ())[2].find_remedy()


def _assemble(robot: str | Path, effects: tuple[str, ...]) -> tuple[Library, tuple[Effect, ...], StepExamination]:
    try:
        return assemble_library(str(robot), load_description(str(robot)), tuple(sorted(effects)))
    except RobotError as error:
        raise PlantError("\n".join(error.problems)) from None
