"""Logs as callers have them: files, logs that are read already, and tables in memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hdagen.log.column_map import ColumnMap
from hdagen.log.column_map_file import build_column_map, read_column_map
from hdagen.log.data_frame import POSSIBLE_TABLES, convert_table, is_table
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log, build_log, check_log_file, read
from hdagen.support.messages import show_value

LogSource = Any  # a path, a Log, an Arrow table, a data frame of pandas or polars, or arrays by name
ColumnSources = str | Path | Mapping[str, Any] | None  # a columns.toml, or its tables as a dict

TABLE_NAME = "table"  # names a table in memory in sentences


def read_log(source: LogSource, *, columns: ColumnSources = None, joints: Sequence[str | None] = ()) -> Log:
    """Read a log from a file or from a table in memory.

    Missing values stay NaN: `hdagen.diagnose`, `hdagen.replay` and `hdagen.check` repair them or refuse the log.

    Args:
        source: A .csv, .tsv, .txt, .parquet or .mat file, an Arrow table, a data frame of pandas or polars, or a dict
            of arrays (T,) by column name. A `Log` is returned as it is.
        columns: A columns.toml, or its tables as a dict, where names, units or signs are foreign.
        joints: Names of the robot's joints, where the columns have them in place of numbers.

    Returns:
        The log, in SI.

    Raises:
        LogError: The source is no log; every problem is listed.
        ColumnsError: The columns.toml is at fault.

    """
    if isinstance(source, Log):
        return source
    mapping = _read_mapping(columns, joints)
    if isinstance(source, str | Path):
        return read(source, mapping, holes=True)
    return build_log(convert_table(source, TABLE_NAME, mapping.needs_column), TABLE_NAME, mapping, holes=True)


def read_logs(
    sources: LogSource | Iterable[LogSource], columns: ColumnSources = None, joints: Sequence[str | None] = ()
) -> list[Log]:
    """Read one log or several.

    Args:
        sources: One source of a log as `read_log` takes it, or several.
        columns: A columns.toml, or its tables as a dict, for each of them.
        joints: Names of the robot's joints, where the columns have them in place of numbers.

    Returns:
        The logs.

    Raises:
        LogError: A source is no log; files are looked at before any of them is read.
        ColumnsError: The columns.toml is at fault.

    """
    every = [sources]
    if not (isinstance(sources, str | Path | Log) or is_table(sources)):
        if not isinstance(sources, Iterable):
            found = show_value(sources)
            raise LogError([f"logs: found {found}, possible are paths, logs, {POSSIBLE_TABLES}, or a list of them."])
        every = list(sources)
    for source in every:
        if isinstance(source, str | Path):
            check_log_file(Path(source))
    return [read_log(source, columns=columns, joints=joints) for source in every]


def _read_mapping(columns: ColumnSources, joints: Sequence[str | None]) -> ColumnMap:
    """The map of columns that a columns.toml or its tables state. Raises ColumnsError."""
    if columns is None:
        return ColumnMap({}, joints=tuple(joints))
    if isinstance(columns, Mapping):
        return build_column_map(dict(columns), Path("columns"), joints)
    return read_column_map(columns, joints)
