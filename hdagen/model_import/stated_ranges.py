"""Ranges that a model states: those that stand upside down are refused, and those of one point hold their joint."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hdagen.model_import.model_file import ModelError, ModelFile
from hdagen.support.messages import show_value

Range = tuple[float, float]
NEVER = 0  # mjLIMITED_FALSE


def take_stuck_joints(spec: Any, file: ModelFile) -> dict[str, float]:
    """Take the limits off joints that cannot move, which MuJoCo refuses or overlooks, and check all other ranges.

    Args:
        spec: The document as MuJoCo read it; changed in place.
        file: The model file.

    Returns:
        By name of each joint with equal limits its only position, rad or m.

    Raises:
        ModelError: A range stands upside down, or one of forces or controls is a point.

    """
    stuck = _find_stuck_links(file)
    for joint in spec.joints:
        low, high = _read_range(joint.range)
        if _states(int(joint.limited), low, high):
            if low > high:
                raise _refuse(file, "joint", joint.name, "range", (low, high))
            if low == high:
                stuck[joint.name] = math.radians(low) if _is_in_degrees(spec, joint) else low
                joint.limited = NEVER
        _check_forces(file, "joint", joint.name, "actuatorfrcrange", joint.actfrclimited, joint.actfrcrange)
    for actuator in spec.actuators:
        label = actuator.name or actuator.target
        _check_forces(file, "actuator", label, "forcerange", actuator.forcelimited, actuator.forcerange)
        _check_forces(file, "actuator", label, "ctrlrange", actuator.ctrllimited, actuator.ctrlrange)
    return stuck


def find_urdf_range(file: ModelFile, name: str) -> Range | None:
    """Find the range of a URDF's joint that states one end alone, which MuJoCo overlooks; the other is 0 by the format.

    Args:
        file: The model file.
        name: The joint's name.

    Returns:
        The range, rad or m; None where it states both ends or none.

    """
    for joint in file.root.findall("joint"):
        limit = joint.find("limit")
        if joint.get("name") != name or joint.get("type") not in ("revolute", "prismatic") or limit is None:
            continue
        if ("lower" in limit.attrib) == ("upper" in limit.attrib):
            return None
        low, high = _read_end(limit.get("lower")), _read_end(limit.get("upper"))
        return (low, high) if low < high else None
    return None


def _find_stuck_links(file: ModelFile) -> dict[str, float]:
    """The joints of a URDF with equal limits, whose range MuJoCo throws away."""
    found = {}
    for joint in file.root.findall("joint") if file.is_urdf else []:
        limit = joint.find("limit")
        if limit is None or joint.get("type") not in ("revolute", "prismatic"):
            continue
        if "lower" in limit.attrib and "upper" in limit.attrib:
            low, high = _read_end(limit.get("lower")), _read_end(limit.get("upper"))
            if low == high:
                found[joint.get("name", "")] = low
    return found


def _read_end(text: str | None) -> float:
    """An end of a range as a number, 0 where it is not stated; NaN where it is none, which MuJoCo says."""
    try:
        return float("0" if text is None else text)
    except ValueError:
        return math.nan


def _read_range(ends: Any) -> Range:
    low, high = (float(end) for end in np.asarray(ends))
    return low, high


def _states(limited: int, low: float, high: float) -> bool:
    """Whether a range counts: where it is not switched off, and is more than the two zeros of none."""
    return limited != NEVER and (limited == 1 or (low, high) != (0.0, 0.0))


def _is_in_degrees(spec: Any, joint: Any) -> bool:
    return bool(spec.compiler.degree) and joint.type.name == "mjJNT_HINGE"


def _check_forces(file: ModelFile, kind: str, name: str, key: str, limited: Any, ends: Any) -> None:
    low, high = _read_range(ends)
    if _states(int(limited), low, high) and low >= high:
        raise _refuse(file, kind, name, key, (low, high))


def _refuse(file: ModelFile, kind: str, name: str, key: str, found: Range) -> ModelError:
    low, high = found
    return ModelError(
        f"{file.label}, {kind} {show_value(name)}: found the {key} {low:g} to {high:g}, possible is the lower end"
        f" before the upper; correct {key}."
    )
