"""The robot that is exported: its model with the verdict of a diagnosis, beside the robot file's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hdagen.adoption import verdict
from hdagen.adoption.diagnosis_file import read_content
from hdagen.adoption.verdict import Verdict
from hdagen.arm.compiled_arm import Arm


@dataclass(frozen=True)
class CorrectedRobot:
    """A robot as a writer of `hdagen.model_export` takes it.

    Attributes:
        source: The preset or the path of the robot.toml.
        file: The model at the numbers of the robot file; it has the equations of the verdict's effects.
        corrected: The same model at the numbers of the verdict; without one it is ``file``.
        stated: The verdict; None: the robot is exported as its file has it.
        content: The content of the diagnosis.json; None without one.
        notes: Sentences on what the verdict could not change.

    """

    source: str | Path
    file: Arm
    corrected: Arm
    stated: Verdict | None = None
    content: Mapping[str, Any] | None = None
    notes: tuple[str, ...] = ()

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints' names, base first: those of the robot file, else joint1, joint2, …."""
        joints = self.file.robot["joints"]
        return tuple(str(joint.get("name") or f"joint{j}") for j, joint in enumerate(joints, 1))

    def leave_out_effect(self, name: str, joint: int) -> CorrectedRobot:
        """Leave one effect of the verdict out.

        Args:
            name: The effect's name.
            joint: Its joint; 0 is the whole arm.

        Returns:
            The robot corrected by all that remains of the verdict.

        """
        assert self.stated is not None
        kept = tuple(effect for effect in self.stated.effects if (effect.name, effect.joint) != (name, joint))
        stated = replace(self.stated, effects=kept)
        return replace(self, corrected=verdict.apply_verdict(self.file, stated)[0], stated=stated)


def load_corrected_robot(
    robot: str | Path, diagnosis: str | Path | Mapping[str, Any] | None = None, profile: str = "portable"
) -> CorrectedRobot:
    """Load a robot with the verdict of a diagnosis.

    Args:
        robot: A preset or the path of a robot.toml.
        diagnosis: A diagnosis.json or its content; None: the robot as its file has it.
        profile: Profile of the build, "portable" or "native".

    Returns:
        The robot.

    Raises:
        PlantError: The robot cannot be loaded, or the diagnosis is of another one.

    """
    if diagnosis is None:
        arm = verdict.load(robot, profile)
        return CorrectedRobot(robot, arm, arm)
    stated = verdict.read_verdict(diagnosis)
    content = diagnosis
    if not isinstance(content, Mapping):
        content = read_content(Path(content))
    arm = verdict.load_with_effects(robot, profile, stated)
    corrected, notes = verdict.apply_verdict(arm, stated)
    return CorrectedRobot(robot, arm, corrected, stated, content, tuple(notes))
