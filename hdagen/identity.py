"""What makes two robot files the same robot: the numbers that its equations of motion are made of, not the bytes.

Of meaning are gravity, the links, the drives and the stated effects, each number with its tolerance. Not of meaning are
name, comments, order and spelling (1 or 1.0; a lumped inertia or its parts; a default written out), the step and the
smoothing of friction, which are of the integration, and limits, sensors and their noise, which no parameter is fitted
of.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

DIGITS = 10  # that two spellings of a number share: a lumped inertia goes through a sum and a difference
_LINK = ("kind", "length", "mass", "center_of_mass", "inertia", "drive")
_INTEGRATION = ("friction_smoothing",)  # of a drive


def identity(robot: Mapping[str, Any]) -> str:
    """The SHA-256, hexadecimal, of the meaning of a robot.

    Args:
        robot: its complete description, as a build's manifest has it (`Arm.robot`).

    Returns:
        64 characters.

    """
    joints = [{key: joint[key] for key in _LINK} for joint in robot["joints"]]
    for joint in joints:
        joint["drive"] = {key: value for key, value in joint["drive"].items() if key not in _INTEGRATION}
    effects = sorted(robot["effects"], key=lambda effect: (effect["name"], effect["joint"]))
    meaning = _rounded({"gravity": robot["gravity"], "joints": joints, "effects": effects})
    return hashlib.sha256(json.dumps(meaning, sort_keys=True).encode()).hexdigest()


def _rounded(value: Any) -> Any:
    """The same with every number to `DIGITS` digits, and without what is not there."""
    if isinstance(value, Mapping):
        return {key: _rounded(part) for key, part in value.items() if part is not None and part is not False}
    if isinstance(value, list | tuple):
        return [_rounded(part) for part in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return float(f"{value:.{DIGITS - 1}e}") + 0.0
