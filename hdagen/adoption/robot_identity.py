"""A robot's identity: a hash of the numbers in its equations of motion, not of the bytes of its file.

Two robot files describe one robot if gravity, the links, the drives and the stated effects are equal, each number with
its tolerance. Name, comments, order and spelling do not count (1 or 1.0; a lumped inertia or its parts; a default
written out). Neither do the step and the smoothing of friction, which belong to the integration, nor limits, sensors
and their noise, which no fit changes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

SIGNIFICANT_DIGITS = 10  # significant digits that count: a lumped inertia goes through a sum and a difference
_LINK_IDENTITY_KEYS = ("kind", "length", "origin", "rotation", "axis", "mass", "center_of_mass", "inertia", "drive")
_INTEGRATION_KEYS = ("friction_smoothing",)  # keys of a drive that belong to the integration


def compute_robot_identity(robot: Mapping[str, Any]) -> str:
    """Hash the numbers that a robot's equations of motion are made of.

    Args:
        robot: The robot's complete description, as a build's manifest has it (`Arm.robot`).

    Returns:
        The SHA-256, 64 hexadecimal characters.

    """
    joints = []
    for stated in robot["joints"]:
        joint = {key: stated[key] for key in _LINK_IDENTITY_KEYS if key in stated}  # of either form
        joint["drive"] = {key: value for key, value in joint["drive"].items() if key not in _INTEGRATION_KEYS}
        joints.append(joint)
    effects = sorted(robot["effects"], key=lambda effect: (effect["name"], effect["joint"]))
    numbers = {"gravity": robot["gravity"], "joints": joints, "effects": effects, "tip": robot.get("tip")}
    meaning = _round_numbers(numbers)
    return hashlib.sha256(json.dumps(meaning, sort_keys=True).encode()).hexdigest()


def _round_numbers(value: Any) -> Any:
    """The same value with every number rounded to `SIGNIFICANT_DIGITS` digits, and without entries that are None or
    False."""
    if isinstance(value, Mapping):
        return {key: _round_numbers(part) for key, part in value.items() if part is not None and part is not False}
    if isinstance(value, list | tuple):
        return [_round_numbers(part) for part in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return float(f"{value:.{SIGNIFICANT_DIGITS - 1}e}") + 0.0
