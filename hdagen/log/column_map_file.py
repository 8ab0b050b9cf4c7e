"""``columns.toml``, the file that states the origin of each column of a log: read and checked as a whole."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hdagen.log.column_map import (
    COLUMN_UNITS,
    COUNT_UNIT,
    RAW_UNITS,
    WHOLE_ARM_COLUMNS,
    ColumnMap,
    ColumnsError,
    ColumnSource,
    ForceFrame,
    number_column,
    split_column_name,
)
from hdagen.support.input_file import InputFileError, read_toml
from hdagen.support.messages import join_names, show_value, suggest_name

_MOST_COLUMN_MAP_BYTES = 200_000  # bytes of a columns.toml
_MOST_TABLES = 1500  # every column of 99 joints


def read_column_map(path: Path | str, joints: Sequence[str | None] = ()) -> ColumnMap:
    """Read and check a columns.toml.

    Args:
        path: The file.
        joints: Names of the robot's joints, which the file may give in place of their numbers.

    Returns:
        The map of columns that it states.

    Raises:
        ColumnsError: The file cannot be used; every problem is listed.

    """
    path = Path(path)
    try:
        tables = read_toml(path, _MOST_COLUMN_MAP_BYTES, "see docs/guides/bring_your_log.md for columns.toml")
    except InputFileError as error:
        raise ColumnsError([str(error)]) from None
    if len(tables) > _MOST_TABLES:
        raise ColumnsError([f"{path}: found {len(tables)} tables; no log has more than {_MOST_TABLES} columns in use."])
    return build_column_map(tables, path, joints)


def build_column_map(tables: dict[str, Any], path: Path, joints: Sequence[str | None] = ()) -> ColumnMap:
    """Check the tables of a columns.toml and build the map of columns that they state.

    Args:
        tables: The tables as parsed.
        path: The file that the sentences name.
        joints: Names of the robot's joints, which the tables may give in place of their numbers.

    Returns:
        The map of columns.

    Raises:
        ColumnsError: A table is wrong; every problem is listed.

    """
    tables = dict(tables)
    problems: list[str] = []
    ignore = _check_ignored(path, tables.pop("ignore", []), problems)
    frame = None
    if "tip_force" in tables:
        frame = _parse_force_frame(path, tables.pop("tip_force"), problems)
    known = [_example_name(base) for base in COLUMN_UNITS]
    sources = {}
    for stated, entry in tables.items():
        name = number_column(stated, joints)
        if split_column_name(name) is None:
            problems.append(
                f"{path}: [{name[:80]}] is not a column of a log{suggest_name(name, known)}; possible are"
                f" {join_names(known)} (with the joint's number from 1), ignore and tip_force."
            )
        elif not isinstance(entry, dict):
            problems.append(
                f'{path}: {name} must be a table, as in [{name}] with from = "…" below it; found {show_value(entry)}.'
            )
        elif name in sources:
            problems.append(f"{path}: [{stated}] and [{name}] are the same column; leave one out.")
        else:
            sources[name] = _parse_column_source(path, name, stated, entry, problems)
    if problems:
        raise ColumnsError(problems)
    return ColumnMap(sources, ignore, frame, path, tuple(joints))


def _example_name(quantity: str) -> str:
    """The name of a column of a quantity, that of the first joint where each joint has one."""
    if quantity in WHOLE_ARM_COLUMNS:
        return quantity
    return f"{quantity}_1"


def _check_ignored(path: Path, value: Any, problems: list[str]) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        problems.append(f"{path}: ignore must be a list of column names; found {show_value(value)}.")
        return ()
    return tuple(value)


def _parse_force_frame(path: Path, entry: Any, problems: list[str]) -> ForceFrame | None:
    place = f"{path}: [tip_force]"
    if not isinstance(entry, dict):
        problems.append(f"{place} must be a table; found {show_value(entry)}.")
        return None
    for key in entry.keys() - {"frame", "rotation", "turning_joints"}:
        problems.append(f"{place} has no key {key[:60]}; possible are frame, rotation and turning_joints.")
    frame, rotation, joints = entry.get("frame", "base"), entry.get("rotation", 0.0), entry.get("turning_joints")
    if frame not in ("base", "tip"):
        problems.append(
            f'{place} frame = {show_value(frame)}; possible are "base" (fixed) and "tip" (turns with the last link).'
        )
    if not _is_number(rotation):
        problems.append(f"{place} rotation = {show_value(rotation)}; it must be a finite angle in rad.")
        rotation = 0.0
    if joints is None:
        return ForceFrame(frame == "tip", float(rotation))
    if not isinstance(joints, list) or not joints or not all(_is_whole(j) and j > 0 for j in joints):
        problems.append(
            f"{place} turning_joints = {show_value(joints)}; it must list joint numbers from 1, as in [1, 2]."
        )
        return None
    return ForceFrame(frame == "tip", float(rotation), tuple(joints))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= 1e300  # NaN is not


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 200


# key -> (test of its value, description of a right value, pattern of the columns that may have it)
_KEY_CHECKS: dict[str, tuple[Any, str, str]] = {
    "from": (_is_text, "the name of a column of the log", ""),
    "value": (_is_number, "a finite number", "_"),
    "period": (lambda v: _is_number(v) and v > 0, "a positive number of seconds", "^time$"),
    "unit": (_is_text, "the name of a unit", ""),
    "scale": (lambda v: _is_number(v) and v != 0, "a finite number other than 0", ""),
    "sign": (lambda v: _is_whole(v) and v in (1, -1), "1 or -1", "_"),
    "offset": (_is_number, "a finite number in the column's SI unit", ""),
    "counts_per_turn": (lambda v: _is_number(v) and v > 0, "a positive number", "_"),
    "wrap": (
        lambda v: v == "turn" or (_is_number(v) and v > 0),
        '"turn" or a positive number in the logged unit',
        "position",
    ),
    "subtract": (_is_text, "the name of a column of the log", "_"),
    "joint_side_ratio": (
        lambda v: _is_number(v) and v > 0,
        "the ratio, a positive number",
        "motor_(torque|position|velocity)",
    ),
    "shift_rows": (lambda v: _is_whole(v) and abs(v) <= 1000, "a whole number of rows, -1000 to 1000", "_"),
    "fill": (lambda v: v in ("hold", "linear"), '"hold" or "linear"', "_"),
    "duplicates": (lambda v: v == "first", '"first"', "^time$"),
}


def _parse_column_source(
    path: Path, name: str, stated: str, entry: dict[str, Any], problems: list[str]
) -> ColumnSource:
    """One table of the file, headed ``stated``, its problems appended; keys that are wrong count as absent."""
    place = f"{path}: [{name}]"
    good: dict[str, Any] = {}
    for key, value in entry.items():
        if key not in _KEY_CHECKS or not re.search(_KEY_CHECKS[key][2], name):
            possible = [k for k, (_, _, pattern) in _KEY_CHECKS.items() if re.search(pattern, name)]
            problems.append(f"{place} has no key {key[:60]}; possible are {join_names(possible)}.")
        elif not _KEY_CHECKS[key][0](value):
            problems.append(f"{place} {key} = {show_value(value)}; it must be {_KEY_CHECKS[key][1]}.")
        else:
            good[key] = value
    origin = "value" if "value" in good else "period"
    others = sorted(good.keys() - {origin})
    if origin in good and others:
        problems.append(
            f"{place} has {origin} and {join_names(others)}; a column that is not logged has {origin} alone."
        )
    unit = _parse_unit(place, name, good, problems)
    wrap = good.get("wrap")
    if wrap == "turn":
        turns = {"rad": 2 * math.pi, "deg": 360.0, "turn": 1.0, COUNT_UNIT: good.get("counts_per_turn")}
        wrap = turns.get(unit or "rad")
        if wrap is None:
            problems.append(
                f'{place} wrap = "turn" has no meaning with unit = "{unit}"; give the wrap as a number in that unit.'
            )
    keys: dict[str, Any] = {key: good[key] for key in _COPIED_KEYS if key in good}
    keys |= {key: float(good[key]) for key in ("value", "sign", "scale", "offset") if key in good}
    if wrap is not None:
        keys["wrap"] = float(wrap)
    read = good.get("from", stated)
    if origin in good:
        read = ""
    return ColumnSource(name, read, unit=unit, **keys)


COLUMN_KEYS = frozenset(_KEY_CHECKS)
_COPIED_KEYS = ("period", "counts_per_turn", "subtract", "joint_side_ratio", "shift_rows", "fill", "duplicates")


def _parse_unit(place: str, name: str, good: dict[str, Any], problems: list[str]) -> str:
    """The unit in its one spelling ("Nm" is "N m"); problems where it is unknown or lacks a key that it needs."""
    base = (split_column_name(name) or (name, 0))[0]
    if "unit" not in good:
        return ""
    spelt = {unit.replace(" ", ""): unit for unit in (*COLUMN_UNITS[base], *RAW_UNITS)}
    unit = spelt.get(re.sub(r"[ ·*]", "", good["unit"]).replace("µ", "u").replace("μ", "u").replace("°C", "degC"), "")
    own = next(iter(COLUMN_UNITS[base]))
    if not unit:
        listed = join_names(
            [*COLUMN_UNITS[base], *(f"{raw} (with scale)" for raw in RAW_UNITS if raw not in COLUMN_UNITS[base])]
        )
        problems.append(f"{place} unit = {show_value(good['unit'])}; possible are {listed}.")
    elif unit not in COLUMN_UNITS[base] and "scale" not in good:
        problems.append(f"{place} has unit = {unit!r} without a scale; add scale = how many {own} one {unit} is.")
    elif unit in (COUNT_UNIT, "counts/s") and "counts_per_turn" not in good and "scale" not in good:
        problems.append(f"{place} has unit = {unit!r}; add counts_per_turn (or scale, how many {own} one count is).")
    return unit
