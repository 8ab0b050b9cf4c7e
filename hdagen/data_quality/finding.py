"""Findings of the checks of a log, and the facts of its robot that the checks need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class Severity(Enum):
    """REFUSE: a diagnosis would be wrong. WARN: somebody should look at it. NOTE: good to know."""

    REFUSE = "refuse"
    WARN = "warn"
    NOTE = "note"


@dataclass(frozen=True)
class Finding:
    """One finding in a log: a stable name, the joint (0: the whole log), and a sentence with the cure.

    ``repair`` is the cure as tables of a columns.toml, by column; empty where only a person can decide.
    """

    severity: Severity
    name: str
    joint: int
    sentence: str
    repair: Mapping[str, Any] = field(default_factory=dict, hash=False)


def format_repair(repair: Mapping[str, Any]) -> str:
    """Write a repair in a sentence, as in ``unit = "deg" under [motor_position_1]``.

    Args:
        repair: tables of a columns.toml, by column.

    Returns:
        The words.

    """
    parts = []
    for column, table in repair.items():
        if column == "ignore":
            names = ", ".join(f'"{name}"' for name in table)
            parts.append(f"ignore = [{names}]")
            continue
        keys = []
        for key, value in table.items():
            if isinstance(value, str):
                keys.append(f'{key} = "{value}"')
            else:
                keys.append(f"{key} = {value:.16g}")
        parts.append(f"{' and '.join(keys)} under [{column}]")
    return " and ".join(parts)


@dataclass(frozen=True)
class RobotFacts:
    """The facts of a robot that triage needs, one entry a joint; None where the robot file does not say.

    Ratios are of motor over joint (1, or rad/m where the joint slides), resolutions in rad or m, currents in A, and
    position limits in rad or m. In space, what a joint carries changes with the pose of all others.
    """

    ratios: tuple[float, ...]
    resolutions: Mapping[str, float]  # by column name
    max_currents: tuple[float | None, ...]
    position_limits: tuple[tuple[float, float] | None, ...]
    prismatic: tuple[bool, ...]
    in_space: bool = False

    @classmethod
    def from_robot(cls, robot: Mapping[str, Any]) -> RobotFacts:
        """Collect the facts of a robot.

        Args:
            robot: as a build's manifest describes it (`Arm.robot`).

        Returns:
            The facts.

        """
        joints = robot["joints"]
        resolutions = {
            f"{side}_position_{j}": joint["sensor"][f"{side}_encoder_resolution"]
            for j, joint in enumerate(joints, 1)
            for side in ("motor", "joint")
        }
        return cls(
            tuple(float(joint["drive"]["ratio"]["nominal"]) for joint in joints),
            {name: value for name, value in resolutions.items() if value},
            tuple(joint["drive"]["max_current"] for joint in joints),
            tuple(joint["limits"]["position"] for joint in joints),
            tuple(joint["kind"] == "prismatic" for joint in joints),
            "tip" in robot,
        )


def state_max_current(stated: float | None) -> str:
    """State a drive's largest current in a sentence.

    Args:
        stated: in A, as the robot file has it.

    Returns:
        The words.

    """
    if stated:
        return f"the robot file states at most {stated:g} A"
    return "the robot file states no max_current"
