"""The columns of a log: names, units, and the conversion from foreign columns, units, signs, frames and rows."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from hdagen.log.data_table import LogError, Table
from hdagen.support.messages import join_names, join_nearest_names, show_value, suggest_name

COUNT_UNIT = "counts"  # of an encoder; needs counts_per_turn
_ANGLE_UNITS = {"rad": 1.0, "deg": math.pi / 180, "turn": 2 * math.pi, COUNT_UNIT: 2 * math.pi}
_RATE_UNITS = {
    "rad/s": 1.0,
    "deg/s": math.pi / 180,
    "rpm": math.pi / 30,
    "turn/s": 2 * math.pi,
    "counts/s": 2 * math.pi,
}
_TORQUE_UNITS = {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3, "N": 1.0, "mN": 1e-3, "kN": 1e3}

# Per column the known units, each with its size in SI; the first is the column's own. A prismatic joint has its
# position in m, its speed in m/s and its force in N under the same names.
COLUMN_UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "motor_current_command": {"A": 1.0, "mA": 1e-3},
    "motor_current": {"A": 1.0, "mA": 1e-3},
    "motor_torque_command": _TORQUE_UNITS,
    "motor_torque": _TORQUE_UNITS,
    "motor_position": _ANGLE_UNITS,
    "joint_position": {**_ANGLE_UNITS, "m": 1.0, "mm": 1e-3, "um": 1e-6},
    "joint_torque": _TORQUE_UNITS,
    "joint_position_reference": {**_ANGLE_UNITS, "m": 1.0, "mm": 1e-3, "um": 1e-6},
    "motor_velocity": _RATE_UNITS,
    "joint_velocity": {**_RATE_UNITS, "m/s": 1.0, "mm/s": 1e-3},
    "motor_temperature": {"K": 1.0, "degC": 1.0},
    **{f"tip_force_{axis}": {"N": 1.0, "mN": 1e-3, "kN": 1e3} for axis in "xyz"},
    **{f"tip_moment_{axis}": {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3} for axis in "xyz"},
}
WHOLE_ARM_COLUMNS = ("time", *(f"tip_{noun}_{axis}" for noun in ("force", "moment") for axis in "xyz"))
RAW_UNITS = ("V", "mV", "percent", "counts")  # units of any column that needs a scale
_MOST_NAMED_COLUMNS = 20  # missing columns that are named
_MOST_COMPARED_COLUMNS = 1000  # names among which the nearest one is looked for
_CELSIUS_ZERO = 273.15  # K
_JOINT_COLUMN_PATTERN = re.compile(r"(?P<base>[a-z_]+?)_(?P<joint>[1-9]\d?)")


class ColumnsError(LogError):
    """A columns.toml that cannot be used; the log itself was not looked at."""


def split_column_name(name: str) -> tuple[str, int] | None:
    """Split the name of a column into its quantity and its joint.

    Args:
        name: The name, such as "motor_current_2".

    Returns:
        The quantity and the joint's number, ("motor_current", 2); the number is 0 for a column of the whole arm, as in
        ("time", 0); None for a name that no log's column has.

    """
    if name in WHOLE_ARM_COLUMNS:
        return name, 0
    match = _JOINT_COLUMN_PATTERN.fullmatch(name)
    if match and match["base"] in COLUMN_UNITS and match["base"] not in WHOLE_ARM_COLUMNS:
        return match["base"], int(match["joint"])
    return None


def number_column(name: str, joints: Sequence[str | None]) -> str:
    """Give the number of the joint in place of its name in the name of a column.

    Args:
        name: The column's name, as "motor_torque_elbow_joint".
        joints: Names of the robot's joints, None where one has no name.

    Returns:
        The name that a log's column has, as "motor_torque_3"; another name as it is.

    """
    if split_column_name(name) is None:
        for quantity in sorted(COLUMN_UNITS, key=len, reverse=True):
            joint = name.removeprefix(f"{quantity}_")
            if joint != name and joint in joints:
                return f"{quantity}_{joints.index(joint) + 1}"
    return name


def is_command_channel(name: str) -> bool:
    """Tell whether a channel is a command.

    Args:
        name: The channel's name.

    Returns:
        Whether it was commanded, not measured.

    """
    return "_command_" in name


def name_command_channel(measured: str) -> str:
    """Name the command channel of a measured input.

    Args:
        measured: The measured channel, such as "motor_current_2".

    Returns:
        The command channel, "motor_current_command_2".

    """
    base, _, joint = measured.rpartition("_")
    return f"{base}_command_{joint}"


@dataclass(frozen=True)
class ColumnSource:
    """The origin of one column, as a table of columns.toml states it.

    In this order: a wrapped counter is unwrapped, missing values are filled, ``subtract`` is taken off, then
    value = sign · scale · (logged, in SI) [· or / ratio] + offset, and it moves down by ``shift_rows``.
    """

    name: str
    foreign_column: str  # the foreign column; "" where value or period says all
    value: float | None = None  # a constant column
    period: float | None = None  # time only: rows this far apart, s
    unit: str = ""
    scale: float = 1.0
    sign: float = 1.0
    offset: float = 0.0
    counts_per_turn: float | None = None
    wrap: float | None = None  # in the logged unit
    subtract: str = ""
    joint_side_ratio: float | None = None
    shift_rows: int = 0
    fill: str = ""
    duplicates: str = ""  # time only


@dataclass(frozen=True)
class ForceFrame:
    """The frame of a logged tip force: ``rotation`` (rad) from the base or, if ``is_moving``, from the last link."""

    is_moving: bool = False
    rotation: float = 0.0
    turning_joints: tuple[int, ...] | None = None  # revolute joints; None: all


@dataclass(frozen=True)
class MappedColumns:
    """A table under the contract's names, in SI. Rows outside [start, stop) lack a value that was shifted or filled."""

    time: np.ndarray | None  # None where the log has none
    columns: dict[str, np.ndarray]
    start: int
    stop: int
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ColumnMap:
    """A columns.toml, checked. Columns of the log that already have a contract name need no entry.

    ``joints``: names of the robot's joints, which may stand in the names of columns in place of their numbers.
    """

    sources: dict[str, ColumnSource]
    ignore: tuple[str, ...] = ()
    frame: ForceFrame | None = None
    path: Path | None = None
    joints: tuple[str | None, ...] = ()

    @cached_property
    def _foreign_columns(self) -> frozenset[str]:
        return frozenset(
            name for source in self.sources.values() for name in (source.foreign_column, source.subtract) if name
        )

    def needs_column(self, name: str) -> bool:
        """Tell whether a column of the file is needed.

        Args:
            name: The column's name in the file.

        Returns:
            Whether a table of columns.toml takes it, or it has a log's name and is not ignored.

        """
        column = number_column(name, self.joints)
        return name in self._foreign_columns or (
            split_column_name(column) is not None and name not in self.ignore and column not in self.sources
        )

    def apply(self, table: Table) -> MappedColumns:
        """Bring a table under a log's names and units.

        Args:
            table: The columns as they stand in the file.

        Returns:
            The columns in SI.

        Raises:
            ColumnsError: Columns are missing or differ in length; every problem is listed.

        """
        own, problems = self._find_own_columns(table)
        sources = self.sources | own
        problems += self._absent_columns(sources, table)
        lengths = {
            name: len(table.columns[name])
            for s in sources.values()
            for name in (s.foreign_column, s.subtract)
            if name in table.columns
        }
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            problems.append(
                f"{self.path or 'the log'}: the columns differ in length ({listed}); take columns of one recording."
            )
        if not lengths and sources:
            problems.append(f"{self.path}: no column of the log is used: give at least one 'from'.")
        if problems:
            raise ColumnsError(problems)
        rows = next(iter(lengths.values()), 0)
        converted = {name: _convert_column(source, table, rows) for name, source in sources.items()}
        notes = [note for source in sources.values() for note in _describe_conversion(source, table)]
        if self.frame is not None:
            notes.append(_rotate_tip_force(self.frame, converted, self.path))
        start = max((_find_known_rows(sources[n], v)[0] for n, v in converted.items()), default=0)
        stop = min((_find_known_rows(sources[n], v)[1] for n, v in converted.items()), default=rows)
        return MappedColumns(converted.pop("time", None), converted, start, max(start, stop), tuple(notes))

    def _find_own_columns(self, table: Table) -> tuple[dict[str, ColumnSource], list[str]]:
        """The columns of a table that have a log's names already, and a sentence for each that is there twice."""
        own: dict[str, ColumnSource] = {}
        problems = []
        for read in table.columns:
            name = number_column(read, self.joints)
            if split_column_name(name) is None or not self.needs_column(read) or name in self.sources:
                continue
            if name in own:
                both = f"{own[name].foreign_column} and {read}"
                problems.append(f"{self.path or 'the log'}: {both} are the same column; ignore one of them.")
            own[name] = ColumnSource(name, read)
        return own, problems

    def _absent_columns(self, sources: dict[str, ColumnSource], table: Table) -> list[str]:
        """One sentence for each of the first columns that are taken and not there, and one on the columns there are."""
        absent = [
            (source.name, read)
            for source in sources.values()
            for read in (source.foreign_column, source.subtract)
            if read and read not in table.columns
        ]
        if not absent:
            return []
        problems = [
            f"{self.path}: [{name}] takes column {show_value(read)}, not in the"
            f" log{suggest_name(read, table.names[:_MOST_COMPARED_COLUMNS])}."
            for name, read in absent[:_MOST_NAMED_COLUMNS]
        ]
        listed = f"the log has {join_nearest_names([read for _, read in absent], table.names, 40)}."
        if len(absent) > _MOST_NAMED_COLUMNS:
            listed = f"{len(absent)} columns in all are not there; {listed}"
        return [*problems, f"{self.path}: {listed}"]


def _find_unit_factor(source: ColumnSource) -> float:
    """The size of the logged unit in the column's own unit, before the scale."""
    base = (split_column_name(source.name) or (source.name, 0))[0]
    factor = COLUMN_UNITS[base].get(source.unit, 1.0)
    if source.unit not in (COUNT_UNIT, "counts/s"):
        return factor
    if not source.counts_per_turn:
        return 1.0
    return factor / source.counts_per_turn


def _convert_column(source: ColumnSource, table: Table, rows: int) -> np.ndarray:
    """One column of shape (rows,) in SI, NaN where shifting or filling left no value."""
    if source.value is not None:
        return np.full(rows, source.value)
    if source.period is not None:
        return np.arange(rows) * source.period
    logged = _unwrap_and_fill(table.columns[source.foreign_column], source)
    if source.subtract:
        logged = logged - _unwrap_and_fill(table.columns[source.subtract], source)
    factor, offset = source.sign * source.scale * _find_unit_factor(source), source.offset
    if source.joint_side_ratio is not None:
        if source.name.startswith("motor_torque"):
            factor = factor / source.joint_side_ratio
        else:
            factor = factor * source.joint_side_ratio
    if source.unit == "degC":
        offset += _CELSIUS_ZERO
    values = logged
    if factor != 1.0 or offset != 0.0:
        values = factor * logged + offset
    k = source.shift_rows
    if k:
        values = np.roll(values, k)
    if k > 0:
        values[:k] = np.nan
    elif k < 0:
        values[k:] = np.nan
    return values


def _unwrap_and_fill(values: np.ndarray, source: ColumnSource) -> np.ndarray:
    """Unwrap a counter over the rows that have a value, then fill the others (never beyond the first and last)."""
    known = np.flatnonzero(np.isfinite(values))
    if source.wrap is not None and len(known):
        values = values.copy()
        values[known] = np.unwrap(values[known], period=source.wrap)
    if not source.fill or len(known) in (0, len(values)):
        return values
    if source.fill == "linear":
        return np.interp(np.arange(len(values)), known, values[known], left=np.nan, right=np.nan)
    last = np.searchsorted(known, np.arange(len(values)), side="right") - 1
    return np.where(last >= 0, values[known[np.maximum(last, 0)]], np.nan)


def _find_known_rows(source: ColumnSource, values: np.ndarray) -> tuple[int, int]:
    """The rows [start, stop) outside which a shifted or filled column has no value."""
    start, stop = max(source.shift_rows, 0), len(values) + min(source.shift_rows, 0)
    if source.fill and len(known := np.flatnonzero(np.isfinite(values))):
        start, stop = max(start, int(known[0])), min(stop, int(known[-1]) + 1)
    return start, stop


def _describe_conversion(source: ColumnSource, table: Table) -> list[str]:
    """Say in a sentence how a column was converted; nothing for a column taken as it is."""
    if source.value is not None:
        return [f"{source.name} is not logged: taken as {source.value:g} throughout."]
    if source.period is not None:
        return [f"time is not logged: rows are {source.period:g} s apart."]
    parts = []
    if source.wrap is not None:
        parts.append(f"unwrapped at {source.wrap:g}")
    if source.subtract:
        parts.append(f"less {source.subtract}")
    factor = source.sign * source.scale * _find_unit_factor(source)
    if factor != 1.0 or source.unit == "degC":
        parts.append(f"converted from {source.unit or 'the logged sign and scale'} (times {factor:.10g})")
    if source.joint_side_ratio is not None:
        parts.append(f"brought from the joint's side to the motor's (ratio {source.joint_side_ratio:g})")
    if source.offset:
        parts.append(f"{source.offset:g} added")
    if source.shift_rows:
        parts.append(f"moved by {source.shift_rows} row(s)")
    missing = int(np.count_nonzero(~np.isfinite(table.columns[source.foreign_column])))
    if source.fill and missing:
        parts.append(f"{missing} missing value(s) filled ({source.fill})")
    if not parts:
        return []
    return [f"{source.name} is {source.foreign_column}, {', '.join(parts)}."]


def _rotate_tip_force(frame: ForceFrame, columns: dict[str, np.ndarray], path: Path | None) -> str:
    """Turn the tip force into the base frame, in place. Raises ColumnsError where a column for it is missing, or the
    force is one in space."""
    if beyond := [name for name in columns if name in WHOLE_ARM_COLUMNS[3:]]:
        told = join_names(beyond)
        raise ColumnsError([
            f"{path}: [tip_force] turns a force in the plane, and the log has {told}; log forces and moments in the"
            " base frame, and leave the table out."
        ])  # fmt: skip
    positions: list[str] = []
    if frame.is_moving and frame.turning_joints is not None:
        positions = [f"joint_position_{j}" for j in frame.turning_joints]
    elif frame.is_moving:
        positions = [name for name in columns if (split_column_name(name) or ("", 0))[0] == "joint_position"]
    missing = [name for name in ("tip_force_x", "tip_force_y", *positions) if name not in columns]
    if frame.is_moving and not positions and not missing:
        missing = ["joint_position_1"]
    if missing:
        lacking = join_names(missing)
        raise ColumnsError([f"{path}: [tip_force] needs {lacking}, which the log does not have: log it, or map it."])
    angle = frame.rotation + sum(columns[name] for name in positions)
    x, y = columns["tip_force_x"], columns["tip_force_y"]
    columns["tip_force_x"] = np.cos(angle) * x - np.sin(angle) * y
    columns["tip_force_y"] = np.sin(angle) * x + np.cos(angle) * y
    if frame.is_moving:
        return "The tip force was turned from the tip frame into the base frame."
    return "The tip force was turned from the sensor frame into the base frame."
