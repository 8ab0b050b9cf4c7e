"""The robot that is exported: its model with the verdict of a diagnosis, beside the robot file's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hdagen.adoption import verdict
from hdagen.adoption.diagnosis_file import read_content
from hdagen.adoption.verdict import Verdict
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.support.messages import show_value


@dataclass(frozen=True)
class CorrectedRobot:
    """A robot as a writer of `hdagen.model_export` takes it.

    Attributes:
        source: The preset or the path of the robot.toml.
        file: The model of the robot file.
        corrected: The model with the verdict's effects, at the numbers of the verdict; without one it is ``file``.
        stated: The verdict; None: the robot is exported as its file has it.
        content: The content of the diagnosis.json; None without one.
        notes: Sentences on what the verdict could not change.
        given_names: The joints' names, base first, where they are not the robot file's.

    """

    source: str | Path
    file: Arm
    corrected: Arm
    stated: Verdict | None = None
    content: Mapping[str, Any] | None = None
    notes: tuple[str, ...] = ()
    given_names: tuple[str, ...] = ()

    @property
    def has_joint_names(self) -> bool:
        """Whether every joint has a name that somebody gave it."""
        return bool(self.given_names) or all(joint.get("name") for joint in self.file.robot["joints"])

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints' names, base first: those that were given, those of the robot file, else joint1, joint2, …."""
        if self.given_names:
            return self.given_names
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
        model = self.corrected.with_parameters(self.corrected.p)
        model.parameters.reset()
        return replace(self, corrected=verdict.apply_verdict(model, stated)[0], stated=stated)


def read_joint_names(text: str | None) -> tuple[str, ...]:
    """Read names of joints that stand in one text, with commas between.

    Args:
        text: The text; None: no names.

    Returns:
        The names.

    Raises:
        PlantError: A name is empty, or stands twice.

    """
    if text is None:
        return ()
    names = tuple(name.strip() for name in text.split(","))
    if not all(names) or len(set(names)) < len(names):
        raise PlantError(f"--joints {show_value(text)}: possible are different names with commas between, as hip,knee.")
    return names


def load_corrected_robot(
    robot: str | Path,
    diagnosis: str | Path | Mapping[str, Any] | None = None,
    profile: str = "portable",
    names: tuple[str, ...] = (),
) -> CorrectedRobot:
    """Load a robot with the verdict of a diagnosis.

    Args:
        robot: A preset or the path of a robot.toml.
        diagnosis: A diagnosis.json or its content; None: the robot as its file has it.
        profile: Profile of the build, "portable" or "native".
        names: The joints' names in the other simulator, base first; none: those of the robot file.

    Returns:
        The robot.

    Raises:
        PlantError: The robot cannot be loaded, or the diagnosis is of another one.

    """
    if diagnosis is None:
        arm = load(robot, profile)
        return _name_joints(CorrectedRobot(robot, arm, arm), names)
    stated = verdict.read_verdict(diagnosis)
    content = diagnosis
    if not isinstance(content, Mapping):
        content = read_content(Path(content))
    corrected, notes = verdict.apply_verdict(verdict.load_with_effects(robot, profile, stated), stated)
    found = CorrectedRobot(robot, load(robot, profile), corrected, stated, content, tuple(notes))
    return _name_joints(found, names)


def _name_joints(robot: CorrectedRobot, names: tuple[str, ...]) -> CorrectedRobot:
    """The robot with these names. Raises PlantError where their number is another."""
    if names and len(names) != robot.file.n:
        raise PlantError(f"--joints: {len(names)} name(s) for {robot.file.n} joint(s); name each, base first.")
    return replace(robot, given_names=names)
