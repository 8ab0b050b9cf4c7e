"""A measured or simulated log: samples row by row, checked, in SI, under the names of docs/guides/bring_your_log.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from hdagen.log import column_map_file, data_table
from hdagen.log.column_map import ColumnMap, ColumnsError, ColumnSource, MappedColumns, split_column_name
from hdagen.log.csv_file import read_csv
from hdagen.log.data_table import LogError, Table
from hdagen.log.log_requirements import (
    POSITION_CHANNELS,
    count_joints,
    find_column_problems,
    find_time_problems,
    find_value_problems,
)
from hdagen.log.mat_file import read_mat
from hdagen.log.timestamps import judge_clock, spread_repeated_stamps
from hdagen.support.input_file import InputFileError, check_file
from hdagen.support.messages import join_names, make_printable, show_path, show_value

__all__ = ["ColumnsError", "Log", "LogError", "find_gaps", "read", "write"]

MOST_LOG_BYTES = 4 << 30  # bytes of a file
_LOG_FORMATS = (".csv", ".tsv", ".txt", ".parquet", ".mat")
# Share of rows with a repeated stamp that differ from the row before, where a clock is coarse
_LEAST_CHANGED_ROW_SHARE = 0.1
_GAP_PERIODS = 1.75  # periods between rows from where a row is missing: two, less a quarter for jitter


@dataclass(frozen=True, eq=False)
class Log:
    """A log with one sample a row. Row k is sampled at time[k]; a command in row k is held to the next row.

    Attributes:
        time: (T,), increasing, s.
        columns: (T,) each, float64, SI, by name (``motor_current_1``, …).
        n_joints: The number of joints.
        source: Its origin, for sentences on it.
        notes: Sentences on conversions and repairs.
        stamps: (T,), the time column as logged where ``time`` is a better clock; else None.
        time_uncertainty: Standard deviation of ``time``, s.

    """

    time: np.ndarray
    columns: dict[str, np.ndarray]
    n_joints: int
    source: str
    notes: tuple[str, ...] = ()
    stamps: np.ndarray | None = None
    time_uncertainty: float = 0.0

    def __post_init__(self) -> None:
        for name, values in self.columns.items():
            if split_column_name(name) in (None, ("time", 0)):
                raise ValueError(f"{name[:80]!r} is not a column of a log")
            if values.shape != self.time.shape or values.ndim != 1:
                raise ValueError(f"column {name} has shape {values.shape}, time {self.time.shape}")

    def __getitem__(self, name: str) -> np.ndarray:
        """The column ``name`` (or "time"), (T,). Raises KeyError with the names of the columns."""
        if name == "time":
            return self.time
        if name not in self.columns:
            raise KeyError(f"the log {self.source} has no column {name}; it has {join_names(list(self.columns))}")
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name == "time" or name in self.columns

    def __len__(self) -> int:
        return len(self.time)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Time as logged and all columns by Arrow's C interface, as `pyarrow.table` and `polars.DataFrame` ask for
        it."""
        columns = {"time": self.logged_time, **self.columns}
        return data_table.stream_columns(columns, requested_schema)

    @property
    def period(self) -> float:
        """Median time between rows, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def logged_time(self) -> np.ndarray:
        """The time column as it was logged, (T,), s."""
        return self.time if self.stamps is None else self.stamps

    def rows(self, start: int, stop: int) -> Log:
        """Take a range of rows.

        Args:
            start: The first row, from 0.
            stop: The row after the last.

        Returns:
            The rows as a log whose arrays are views.

        """
        return self.select_rows(slice(start, stop))

    def select_rows(self, rows: np.ndarray | slice) -> Log:
        """Take some rows.

        Args:
            rows: Row numbers, a mask (T,) or a slice.

        Returns:
            The rows as a log.

        """
        part = {name: values[rows] for name, values in self.columns.items()}
        stamps = None if self.stamps is None else self.stamps[rows]
        return replace(self, time=self.time[rows], columns=part, stamps=stamps)


def read(
    path: Path | str,
    columns: Path | str | ColumnMap | None = None,
    joints: int | None = None,
    holes: bool = False,
    names: Sequence[str | None] = (),
) -> Log:
    """Read a log, through a columns.toml where its names, units or signs are foreign.

    Args:
        path: The log, .csv, .tsv, .txt, .parquet or .mat.
        columns: The columns.toml, or the map of columns that it states, if any.
        joints: The robot's number of joints, which the log must have; None: any number.
        holes: Whether missing values stay NaN, for `hdagen.data_quality.log_repair`; else they are refused.
        names: Names of the robot's joints, which columns may have in place of their numbers.

    Returns:
        The log, in SI.

    Raises:
        LogError: The log cannot be used; every problem is listed.
        ColumnsError: The columns.toml is at fault.

    """
    mapping = columns or ColumnMap({}, joints=tuple(names))
    if not isinstance(mapping, ColumnMap):
        mapping = column_map_file.read_column_map(mapping, names)
    return build_log(_read_table(Path(path), mapping), str(Path(path)), mapping, joints, holes)


def build_log(raw: Table, source: str, mapping: ColumnMap, joints: int | None = None, holes: bool = False) -> Log:
    """Build a log from a table: its columns mapped, checked and put on the best clock.

    Args:
        raw: The table, in the names and units of its origin.
        source: The origin, for sentences.
        mapping: The map of its columns.
        joints: The robot's number of joints, which the log must have; None: any number.
        holes: Whether missing values stay NaN; else they are refused.

    Returns:
        The log, in SI.

    Raises:
        LogError: The table is no log; every problem is listed.

    """
    mapped = mapping.apply(raw)
    logged = mapped.time
    mapped = _spread_coarse_stamps(mapped, mapping.sources.get("time"))
    problems = find_column_problems(source, raw, mapped, joints)
    if mapped.time is not None:
        problems += find_time_problems(source, raw, mapped, mapped.time, mapping.sources.get("time"))
    problems += find_value_problems(source, raw, mapped, holes)
    if problems or mapped.time is None:
        raise LogError(problems)
    notes: list[str] = []
    part = np.arange(mapped.start, mapped.stop)
    if (lost := len(mapped.time) - len(part)) > 0:
        notes.append(f"{lost} row(s) at the ends were cut: a moved or filled column has no value there.")
    same = np.diff(mapped.time[part], prepend=-np.inf) == 0
    if same.any():
        notes.append(f"{np.count_nonzero(same)} row(s) with a repeated time stamp were dropped.")
        part = part[~same]
    time, values, stamps = mapped.time, mapped.columns, None
    if len(part) < len(time):  # else nothing is copied
        time, values = time[part], {name: column[part] for name, column in values.items()}
    ignored = [name for name in raw.names if name and not mapping.needs_column(name)]
    if ignored:
        notes.append(f"Columns not used: {join_names(ignored, 12)}.")
    if logged is not None and logged is not mapped.time:
        stamps = logged[part]
    log = _put_on_better_clock(
        Log(time, values, count_joints(values), make_printable(source), tuple(mapped.notes), stamps)
    )
    all_notes = (*raw.notes, *log.notes, *notes, *_describe_gaps(log.time, raw, part))
    return replace(log, notes=tuple(make_printable(note) for note in all_notes))


def write(log: Log | Mapping[str, np.ndarray], path: Path | str) -> None:
    """Write a log, or columns by name; reading gives the same numbers back, to the last bit.

    The file appears whole or not at all.

    Args:
        log: The log, or arrays (T,) by name.
        path: The file, ending in .csv or .parquet.

    Raises:
        LogError: The columns or the path will not do, or the file cannot be written.

    """
    if isinstance(log, Log):
        log = {"time": log.logged_time, **log.columns}
    data_table.write_table(log, path)


def find_gaps(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the gaps in which rows are missing.

    Args:
        time: (T,), increasing, s.

    Returns:
        (G,) the row before each gap, and (G,) the number of rows that are missing in it.

    """
    steps = np.diff(time)
    if not len(steps):
        return np.empty(0, int), np.empty(0, int)
    usual = np.median(steps)
    missing = np.rint(steps / usual).astype(int) - 1
    rows = np.flatnonzero((missing > 0) & (steps > _GAP_PERIODS * usual))
    return rows, missing[rows]


def split_at_pauses(time: np.ndarray, longest: float) -> list[tuple[int, int]]:
    """Split rows at long pauses.

    Args:
        time: (T,), increasing, s.
        longest: The longest step that is no pause, s.

    Returns:
        The rows [start, stop) of each part, none empty.

    """
    cuts = [0, *(np.flatnonzero(np.diff(time) > longest) + 1).tolist(), len(time)]
    return [(a, b) for a, b in pairwise(cuts) if b > a]


def _spread_coarse_stamps(mapped: MappedColumns, source: ColumnSource | None) -> MappedColumns:
    """Even time where stamps repeat because their clock is coarse; the stamps where a columns.toml treats them."""
    inside = slice(mapped.start, mapped.stop)
    if mapped.time is None or (source and source.duplicates) or not np.isfinite(mapped.time[inside]).all():
        return mapped
    repeats = np.flatnonzero(np.diff(mapped.time[inside]) == 0) + inside.start
    changed = [values[repeats + 1] != values[repeats] for values in mapped.columns.values()]
    clock = spread_repeated_stamps(mapped.time[inside])
    if clock is None or np.mean(np.any(changed, axis=0)) < _LEAST_CHANGED_ROW_SHARE:  # rows that were written twice
        return mapped
    time = mapped.time.copy()
    time[inside] = clock.time
    return replace(mapped, time=time, notes=(*mapped.notes, clock.note))


def _put_on_better_clock(log: Log) -> Log:
    """The log on the clock on which its encoders' paths are smoothest, with the uncertainty that is left."""
    paths = {
        name: values
        for name, values in log.columns.items()
        if (split_column_name(name) or ("", 0))[0] in POSITION_CHANNELS
    }
    clock = judge_clock(log.time, paths)
    notes, stamps = log.notes, log.stamps
    if clock.note:
        notes = (*notes, clock.note)
    if clock.time is not log.time:
        stamps = log.logged_time
    return replace(log, time=clock.time, notes=notes, stamps=stamps, time_uncertainty=clock.uncertainty)


def check_log_file(path: Path) -> None:
    """Refuse a file that can be no log, before anything is read.

    Args:
        path: The file.

    Raises:
        LogError: The file has no known format, is missing, is not regular or is too large.

    """
    if path.suffix.lower() not in _LOG_FORMATS:
        possible = ", ".join(_LOG_FORMATS)
        raise LogError([f"{show_path(path)}: no log ends in {show_value(path.suffix)}; possible are {possible}."])
    try:
        check_file(path, MOST_LOG_BYTES, "give the path of a log")
    except InputFileError as error:
        raise LogError([str(error)]) from None


def _read_table(path: Path, mapping: ColumnMap) -> Table:
    check_log_file(path)
    if path.suffix.lower() == ".parquet":
        return data_table.read_parquet(path, mapping.needs_column)
    if path.suffix.lower() == ".mat":
        arrays = read_mat(path)
        return Table({n: v for n, v in arrays.items() if mapping.needs_column(n)}, tuple(arrays), None, ())
    return read_csv(path, mapping.needs_column)


def _describe_gaps(time: np.ndarray, raw: Table, rows_of: np.ndarray) -> list[str]:
    """Describe the gaps in ``time`` (T,), whose rows are ``rows_of`` (T,) of the file."""
    rows, missing = find_gaps(time)
    if not len(rows):
        return []
    k = int(rows[np.argmax(missing)])
    share = 100 * missing.sum() / (len(time) + missing.sum())
    return [
        f"{missing.sum()} sample(s) are missing in {len(rows)} gap(s), {share:.2g} % of the log; "
        f"the longest is {time[k + 1] - time[k]:.4g} s after {raw.describe_row(int(rows_of[k]))}."
    ]
