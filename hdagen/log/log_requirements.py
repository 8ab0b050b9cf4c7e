"""What a log must hold: time that increases, an input and a position of each joint, and values of a possible size."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdagen.log.column_map import ColumnSource, MappedColumns, split_column_name
from hdagen.log.data_table import Table
from hdagen.support.messages import join_nearest_names
from hdagen.support.row_runs import find_true_runs

_INPUT_CHANNELS = ("motor_current_command", "motor_current", "motor_torque_command", "motor_torque")
POSITION_CHANNELS = ("motor_position", "joint_position")
_LONGEST_PERIOD = 0.2  # s between rows; a control log is faster, so an undeclared unit is taken for ms, us or ns
_SHORTEST_PERIOD = 1e-6  # s
_LARGEST_VALUE = 1e9  # SI; no channel of an arm reaches it
_LARGEST_STAMP = 1e20  # s; stamps of any unit are nearer to the beginning of any clock


def count_joints(columns: Mapping[str, np.ndarray]) -> int:
    """Count the joints that columns name.

    Args:
        columns: (T,) each, by name.

    Returns:
        The largest number of a joint; 0 where no column is of a joint.

    """
    return max((split[1] for name in columns if (split := split_column_name(name))), default=0)


def find_column_problems(source: str, raw: Table, mapped: MappedColumns, joints: int | None) -> list[str]:
    """Find the columns that a log lacks: time, and for each joint one current or torque and one position.

    Args:
        source: The log's origin, for sentences.
        raw: The table as it was read.
        mapped: Its columns under the names of a log.
        joints: The robot's number of joints; None: any number.

    Returns:
        One sentence for each problem.

    """
    problems, lacking = [], list[str]()
    if mapped.time is None:
        problems.append(f"{source}: there is no column time: name it so, or say in columns.toml [time] from = which.")
        lacking.append("time")
    found = count_joints(mapped.columns)
    if joints is not None and found > joints:
        problems.append(
            f"{source}: the log has columns of {found} joints, the robot has {joints}: use the robot's own log, or a "
            "columns.toml that takes the joints wanted and ignores the others."
        )
    wanted = found if joints is None else joints
    if wanted == 0:
        problems.append(f"{source}: no column of any joint was found: map them with a columns.toml.")
        lacking += [f"{base}_1" for base in (*_INPUT_CHANNELS, *POSITION_CHANNELS)]
    for joint in range(1, wanted + 1):
        for what, bases in (("current or torque", _INPUT_CHANNELS), ("position", POSITION_CHANNELS)):
            names = [f"{base}_{joint}" for base in bases]
            if not any(name in mapped.columns for name in names):
                problems.append(
                    f"{source}: joint {joint} has no {what}; one of {', '.join(names)} is needed: log it, or map it "
                    "with a columns.toml."
                )
                lacking += names
    if lacking:
        problems.append(f"{source}: the file has {join_nearest_names(lacking, raw.names, 40)}.")
    return problems


def find_time_problems(
    source: str, raw: Table, mapped: MappedColumns, time: np.ndarray, stated: ColumnSource | None
) -> list[str]:
    """Find the reasons why time is not finite, not increasing or not in s.

    A unit that columns.toml declares is believed.

    Args:
        source: The log's origin, for sentences.
        raw: The table as it was read.
        mapped: Its columns under the names of a log.
        time: (T,), the time as it was logged.
        stated: The table [time] of columns.toml, if any.

    Returns:
        One sentence for each problem.

    """
    if not len(time):
        return [f"{source}: there are no rows: record again, or copy it again."]
    if mapped.stop - mapped.start < 2:
        return [
            f"{source}: {mapped.stop - mapped.start} row(s) only; a log needs at least two, and a motion among them."
        ]
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        return [
            f"{source}, {raw.describe_row(int(bad[0]))}: time has no value there, {len(bad)} time(s) in all: delete "
            "these rows."
        ]
    far = np.flatnonzero(np.abs(time) > _LARGEST_STAMP)
    if len(far):
        return [
            f"{source}, {raw.describe_row(int(far[0]))}: time is {time[far[0]]:.3g} s, {len(far)} value(s) beyond "
            f"±{_LARGEST_STAMP:g} s in all: memory that was never written? Delete these rows."
        ]
    problems = []
    declared = stated is not None and bool(stated.unit)
    steps = np.diff(time)
    back, same = np.flatnonzero(steps < 0), np.flatnonzero(steps == 0)
    if len(back):
        k = int(back[0])
        problems.append(
            f"{source}, {raw.describe_row(k + 1)}: time runs backwards, from {time[k]:.9g} s to {time[k + 1]:.9g} s, "
            f"{len(back)} time(s) in all: two recordings in one file, or rows out of order? Cut or sort the file."
        )
    if len(same) and not (stated and stated.duplicates):
        k = int(same[0])
        problems.append(
            f"{source}, {raw.describe_row(k + 1)}: the time stamp repeats the one before ({time[k]:.9g} s), {len(same)}"
            " in all: log time with more digits; or, in columns.toml under [time], give the period, where rows are"
            ' even, or keep the first of each with duplicates = "first".'
        )
    if not declared and not len(back):
        problems += _find_unit_problems(source, float(np.median(steps)))
    return problems


def _find_unit_problems(source: str, step: float) -> list[str]:
    """Find the unit that time seems to be in, where a usual step between rows, s, is that of no control loop."""
    problems = []
    if step >= _LONGEST_PERIOD:
        unit, word = "ns", "nano"
        if step < 100:
            unit, word = "ms", "milli"
        elif step < 1e5:
            unit, word = "us", "micro"
        problems.append(
            f"{source}: time looks like {word}seconds (rows are {step:.6g} apart, and s is expected): set "
            f'unit = "{unit}" under [time] in columns.toml, or unit = "s" if it is right.'
        )
    if 0 < step < _SHORTEST_PERIOD:
        problems.append(
            f"{source}: rows are {step:.3g} s apart, faster than any control loop: "
            "set unit under [time] in columns.toml, or period = the true step in s."
        )
    return problems


def find_value_problems(source: str, raw: Table, mapped: MappedColumns, holes: bool) -> list[str]:
    """Find values that are missing, or larger than those of any arm.

    Args:
        source: The log's origin, for sentences.
        raw: The table as it was read.
        mapped: Its columns under the names of a log.
        holes: Whether values may be missing.

    Returns:
        One sentence for each problem.

    """
    problems = []
    for name, values in mapped.columns.items():
        part = values[mapped.start : mapped.stop]
        bad = np.flatnonzero(~np.isfinite(part)) + mapped.start
        if len(bad) and len(bad) == len(part) and not holes:
            problems.append(f'{source}: column {name} has no value in any row: leave it out with ignore = ["{name}"].')
        elif len(bad) and not holes:
            longest = int(np.diff(find_true_runs(~np.isfinite(part))).max())
            problems.append(
                f"{source}, {raw.describe_row(int(bad[0]))}: column {name} has no value in {len(bad)} row(s), up to"
                f" {longest} "
                f'together: cut them, or fill them with columns.toml [{name}] fill = "linear" ("hold" for a command).'
            )
        huge = np.flatnonzero(np.abs(part) > _LARGEST_VALUE) + mapped.start
        if len(huge) and np.isfinite(part[huge - mapped.start]).any():
            k = int(huge[np.isfinite(values[huge])][0])
            problems.append(
                f"{source}, {raw.describe_row(k)}: column {name} is {values[k]:.3g}, {len(huge)} value(s) beyond"
                f" ±{_LARGEST_VALUE:g} in all: memory that was never written? Delete these rows."
            )
    return problems
