"""Checks of joints in space: one form in a file, unit quaternions and axes, inertias that a body can have."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from gen.robot.schema import keys_of
from gen.robot.table_reader import RobotFileReader, key_path
from gen.robot.value_reader import show_value

JOINT_NAME_PATTERN = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,63}")
SPACE_KEYS = ("origin", "rotation", "axis")
PLANE_KEYS = ("length", "inertia_about_joint")
UNIT_TOLERANCE = 1e-6  # of the length of a quaternion or an axis
INERTIA_TOLERANCE = 1e-6  # of the largest principal moment, by which rounded numbers may break the triangle inequality


def uses_long_form(table: Mapping[str, Any]) -> bool:
    """Tell whether a robot file states joints in space.

    Args:
        table: The parsed file.

    Returns:
        True where a joint has a frame, a centre of mass or an inertia in space, or where there is a [tip].

    """
    joints = table.get("joint", [])
    if not isinstance(joints, list):
        return "tip" in table
    return "tip" in table or any(isinstance(raw, Mapping) and _stands_in_space(raw) for raw in joints)


def _stands_in_space(raw: Mapping[str, Any]) -> bool:
    lists = any(isinstance(raw.get(name), list) for name in ("center_of_mass", "inertia"))
    return lists or any(name in raw for name in SPACE_KEYS)


def check_gravity(values: dict[str, Any], in_space: bool, reading: RobotFileReader) -> None:
    """Check the number of components of gravity against the form of the joints.

    Args:
        values: The values of the top of the file.
        in_space: Whether the joints stand in space.
        reading: Collects the problems.

    """
    found, possible = len(values.get("gravity", ())), {False: 2, True: 3}[in_space]
    if found not in (0, possible):
        form = {False: "in the plane, along x and y", True: "in space"}[in_space]
        reading.add_problem(
            "gravity", f"found {found} components, possible are {possible} of joints {form}; correct it or the joints"
        )


def read_joint_in_space(raw: Mapping[str, Any], place: str, reading: RobotFileReader) -> dict[str, Any]:
    """Read a joint of the long form.

    Args:
        raw: The table as parsed.
        place: Its full name in the file.
        reading: Collects the problems.

    Returns:
        The values that fit, by key.

    """
    for name in PLANE_KEYS:
        if name in raw:
            reading.add_problem(
                key_path(place, name), "found in a file with joints in space, possible is one form; remove it"
            )
    kept = {name: entry for name, entry in raw.items() if name not in PLANE_KEYS}
    values = reading.read_table(kept, "joint in space", place)
    values |= {name: _make_unit(values[name], place, name, reading) for name in ("rotation", "axis") if name in values}
    if "inertia" in values:
        _check_inertia([value.nominal for value in values["inertia"]], key_path(place, "inertia"), reading)
    return values


def read_tip(table: Mapping[str, Any], reading: RobotFileReader) -> dict[str, Any]:
    """Read [tip].

    Args:
        table: The parsed file.
        reading: Collects the problems.

    Returns:
        The values that fit, by key.

    """
    values = reading.read_table(table.get("tip", {}), "tip", "tip")
    if "rotation" in values:
        values["rotation"] = _make_unit(values["rotation"], "tip", "rotation", reading)
    return values


def _make_unit(vector: tuple[float, ...], place: str, name: str, reading: RobotFileReader) -> tuple[float, ...]:
    """The vector at length 1; a problem where it is not of that length but for rounding."""
    length = float(np.linalg.norm(vector))
    if abs(length - 1.0) <= UNIT_TOLERANCE:
        return tuple(entry / length for entry in vector)
    cure = "divide it by its length"
    if length < UNIT_TOLERANCE:
        cure = "write a direction" if name == "axis" else "write 1, 0, 0, 0 for no turn"
    noun = {"axis": "unit vector"}.get(name, "unit quaternion w, x, y, z")
    reading.add_problem(key_path(place, name), f"found the length {length:.6g}, possible is a {noun}; {cure}")
    return vector


def _check_inertia(entries: list[float], place: str, reading: RobotFileReader) -> None:
    """Whether a body can have the inertia: positive definite, and no principal moment above the sum of the others."""
    xx, yy, zz, xy, xz, yz = entries
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    shown = ", ".join(f"{moment:.4g}" for moment in moments)
    if moments[0] <= 0:
        possible = "possible are moments above 0, and none above the sum of the others"
    elif moments[2] > (moments[0] + moments[1]) * (1 + INERTIA_TOLERANCE):
        possible = "possible is none above the sum of the others"
    else:
        return
    reading.add_problem(place, f"found the principal moments {shown} kg m², {possible}; correct signs or order")


def check_joint_names(joints: list[dict[str, dict[str, Any]]], reading: RobotFileReader) -> None:
    """Check the labels of joints: their letters, and that each stands once.

    Args:
        joints: The values of each joint, base first.
        reading: Collects the problems.

    """
    first: dict[str, int] = {}
    for number, values in enumerate(joints, 1):
        name, place = values["joint"].get("name"), f"joint[{number}].name"
        if name is None:
            continue
        if not JOINT_NAME_PATTERN.fullmatch(name):
            possible = keys_of("joint")["name"].meaning.partition(": ")[2]
            reading.add_problem(place, f"found {show_value(name)}, possible are {possible}; choose such a label")
        elif first.setdefault(name, number) != number:
            reading.add_problem(place, f"found {show_value(name)} as at joint[{first[name]}]; give each its own label")
