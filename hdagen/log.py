"""A measured or simulated log: what was sampled, row by row, checked, in SI, under the names of docs/log.md."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from hdagen import columns_toml, table
from hdagen.columns import ColumnMap, ColumnsError, Mapped, Source, split_name
from hdagen.csvfile import read_csv
from hdagen.input_file import InputFileError, check_file
from hdagen.matfile import read_mat
from hdagen.names import list_some, printable, shown, shown_path
from hdagen.stretches import stretches
from hdagen.table import LogError, Table

__all__ = ["ColumnsError", "Log", "LogError", "gaps", "read", "write"]

_LARGEST = 16 << 30  # bytes of a file
_FORMATS = (".csv", ".tsv", ".txt", ".parquet", ".mat")
_INPUTS = ("motor_current_command", "motor_current", "motor_torque_command", "motor_torque")
_POSITIONS = ("motor_position", "joint_position")
_SLOWEST = 0.2  # s between rows; a control log is faster, so an undeclared unit is taken for ms, us or ns
_FASTEST = 1e-6  # s
_HUGE = 1e9  # SI; no channel of an arm reaches it
_GAP = 1.75  # periods between rows that count as a gap: two where one row is missing, less a quarter of jitter


@dataclass(frozen=True, eq=False)
class Log:
    """One row a sample. ``time`` (T,) in s, increasing; ``columns`` float64 (T,) by name (``motor_current_1``, …), SI.

    Row k holds what is sampled at time[k]; a command in row k is held from there to the next row.
    ``notes`` says, in sentences, what was converted or repaired.
    """

    time: np.ndarray
    columns: dict[str, np.ndarray]
    n_joints: int
    source: str
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, values in self.columns.items():
            if split_name(name) in (None, ("time", 0)):
                raise ValueError(f"{name[:80]!r} is not a column of a log")
            if values.shape != self.time.shape or values.ndim != 1:
                raise ValueError(f"column {name} has shape {values.shape}, time {self.time.shape}")

    def __getitem__(self, name: str) -> np.ndarray:
        """Column ``name`` (or ``time``), shape (T,). Raises KeyError saying what there is."""
        if name == "time":
            return self.time
        if name not in self.columns:
            raise KeyError(f"the log {self.source} has no column {name}; it has {list_some(list(self.columns))}")
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name == "time" or name in self.columns

    def __len__(self) -> int:
        return len(self.time)

    @property
    def period(self) -> float:
        """Median time between rows, s."""
        return float(np.median(np.diff(self.time)))

    def rows(self, start: int, stop: int) -> Log:
        """The rows start … stop − 1, counted from 0, as views."""
        part = {name: values[start:stop] for name, values in self.columns.items()}
        return Log(self.time[start:stop], part, self.n_joints, self.source, self.notes)


def read(path: Path | str, columns: Path | str | None = None, joints: int | None = None, holes: bool = False) -> Log:
    """Read a log (.csv, .parquet, .mat), through a columns.toml where its names, units or signs are foreign.

    ``joints``: how many the robot has; the log must have the same. ``holes``: values that are missing stay NaN, for
    `hdagen.repair`, where otherwise they are refused. Raises LogError with every problem at once,
    ColumnsError where columns.toml is at fault.
    """
    path = Path(path)
    mapping = columns_toml.load(columns) if columns is not None else ColumnMap({})
    raw = _read_table(path, mapping)
    mapped = mapping.apply(raw)
    problems = _check_columns(path, raw, mapped, joints)
    if mapped.time is not None:
        problems += _check_time(path, raw, mapped, mapped.time, mapping.sources.get("time"))
    problems += _check_values(path, raw, mapped, holes)
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
    whole = len(part) == len(mapped.time)  # then nothing is copied
    time = mapped.time if whole else mapped.time[part]
    values = {name: column if whole else column[part] for name, column in mapped.columns.items()}
    ignored = [name for name in raw.names if name and not mapping.reads(name)]
    if ignored:
        notes.append(f"Columns not used: {list_some(ignored, 12)}.")
    notes += _gap_notes(time, raw, mapped.start)
    said = tuple(printable(note) for note in (*raw.notes, *mapped.notes, *notes))
    return Log(time, values, _count_joints(values), printable(path), said)


def write(log: Log | Mapping[str, np.ndarray], path: Path | str) -> None:
    """Write a log, or columns by name, to .csv or .parquet; reading gives the same numbers back, to the last bit.

    The file appears whole or not at all. Raises LogError.
    """
    table.write({"time": log.time, **log.columns} if isinstance(log, Log) else log, path)


def gaps(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where rows are missing: the rows before each gap, shape (G,), and how many are missing in each, shape (G,)."""
    steps = np.diff(time)
    missing = np.rint(steps / np.median(steps)).astype(int) - 1 if len(steps) else np.empty(0, int)
    rows = np.flatnonzero((missing > 0) & (steps > _GAP * np.median(steps))) if len(steps) else np.empty(0, int)
    return rows, missing[rows]


def parts(time: np.ndarray, longest: float) -> list[tuple[int, int]]:
    """Rows [start, stop) between the steps of ``time`` (T,), s, that are longer than ``longest``."""
    cuts = [0, *(np.flatnonzero(np.diff(time) > longest) + 1).tolist(), len(time)]
    return [(a, b) for a, b in pairwise(cuts) if b > a]


def check_log(path: Path) -> None:
    """Refuse a log that is of no known format, not there, no regular file or too large, before anything is read. Raises
    LogError."""
    if path.suffix.lower() not in _FORMATS:
        possible = ", ".join(_FORMATS)
        raise LogError([f"{shown_path(path)}: no log ends in {shown(path.suffix)}; possible are {possible}."])
    try:
        check_file(path, _LARGEST, "give the path of a log")
    except InputFileError as error:
        raise LogError([str(error)]) from None


def _read_table(path: Path, mapping: ColumnMap) -> Table:
    check_log(path)
    if path.suffix.lower() == ".parquet":
        return table.read_parquet(path, mapping.reads)
    if path.suffix.lower() == ".mat":
        arrays = read_mat(path)
        return Table({n: v for n, v in arrays.items() if mapping.reads(n)}, tuple(arrays), None, ())
    return read_csv(path, mapping.reads)


def _count_joints(columns: Mapping[str, np.ndarray]) -> int:
    return max((split[1] for name in columns if (split := split_name(name))), default=0)


def _check_columns(path: Path, raw: Table, mapped: Mapped, joints: int | None) -> list[str]:
    """What a log needs: time, and per joint one current or torque and one position."""
    problems = []
    has = f"the file has {list_some(raw.names)}"
    if mapped.time is None:
        problems.append(
            f"{path}: there is no column time; {has}: name it so, or say in columns.toml [time] from = which."
        )
    found = _count_joints(mapped.columns)
    if joints is not None and found > joints:
        problems.append(
            f"{path}: the log has columns of {found} joints, the robot has {joints}: use the robot's own log, or a "
            "columns.toml that takes the joints wanted and ignores the others."
        )
    wanted = found if joints is None else joints
    if wanted == 0:
        problems.append(f"{path}: no column of any joint was found; {has}: map them with a columns.toml.")
    for joint in range(1, wanted + 1):
        for what, bases in (("current or torque", _INPUTS), ("position", _POSITIONS)):
            names = [f"{base}_{joint}" for base in bases]
            if not any(name in mapped.columns for name in names):
                problems.append(
                    f"{path}: joint {joint} has no {what}; one of {', '.join(names)} is needed and {has}: "
                    "log it, or map it with a columns.toml."
                )
    return problems


def _check_time(path: Path, raw: Table, mapped: Mapped, time: np.ndarray, source: Source | None) -> list[str]:
    """Time must be finite, increase, and be in s; a unit that columns.toml declares is believed."""
    if not len(time):
        return [f"{path}: there are no rows: record again, or copy it again."]
    if mapped.stop - mapped.start < 2:
        return [f"{path}: {mapped.stop - mapped.start} row(s) only; a log needs at least two, and a motion among them."]
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        return [
            f"{path}, {raw.place(int(bad[0]))}: time has no value there, {len(bad)} time(s) in all: delete these rows."
        ]
    problems = []
    declared = source is not None and bool(source.unit)
    steps = np.diff(time)
    back, same = np.flatnonzero(steps < 0), np.flatnonzero(steps == 0)
    if len(back):
        k = int(back[0])
        problems.append(
            f"{path}, {raw.place(k + 1)}: time runs backwards, from {time[k]:.9g} s to {time[k + 1]:.9g} s, "
            f"{len(back)} time(s) in all: two recordings in one file, or rows out of order? Cut or sort the file."
        )
    if len(same) and not (source and source.duplicates):
        k = int(same[0])
        problems.append(
            f"{path}, {raw.place(k + 1)}: the time stamp repeats the one before ({time[k]:.9g} s), {len(same)} in all: "
            'log time with more digits, or keep the first of each with columns.toml [time] duplicates = "first".'
        )
    step = float(np.median(steps))
    if not declared and not len(back) and step >= _SLOWEST:
        unit, word = ("ms", "milli") if step < 100 else ("us", "micro") if step < 1e5 else ("ns", "nano")
        problems.append(
            f"{path}: time looks like {word}seconds (rows are {step:.6g} apart, and s is expected): set "
            f'unit = "{unit}" under [time] in columns.toml, or unit = "s" if it is right.'
        )
    if not declared and not len(back) and 0 < step < _FASTEST:
        problems.append(
            f"{path}: rows are {step:.3g} s apart, faster than any control loop: "
            "set unit under [time] in columns.toml, or period = the true step in s."
        )
    return problems


def _check_values(path: Path, raw: Table, mapped: Mapped, holes: bool) -> list[str]:
    """Every value finite, unless ``holes`` are wanted, and of a size that an arm can have."""
    problems = []
    for name, values in mapped.columns.items():
        part = values[mapped.start : mapped.stop]
        bad = np.flatnonzero(~np.isfinite(part)) + mapped.start
        if len(bad) and not holes:
            longest = int(np.diff(stretches(~np.isfinite(part))).max())
            problems.append(
                f"{path}, {raw.place(int(bad[0]))}: column {name} has no value in {len(bad)} row(s), up to {longest} "
                f'together: cut them, or fill them with columns.toml [{name}] fill = "linear" ("hold" for a command).'
            )
        huge = np.flatnonzero(np.abs(part) > _HUGE) + mapped.start
        if len(huge) and np.isfinite(part[huge - mapped.start]).any():
            k = int(huge[np.isfinite(values[huge])][0])
            problems.append(
                f"{path}, {raw.place(k)}: column {name} is {values[k]:.3g}, {len(huge)} value(s) beyond ±{_HUGE:g} in "
                "all: memory that was never written? Delete these rows."
            )
    return problems


def _gap_notes(time: np.ndarray, raw: Table, start: int) -> list[str]:
    rows, missing = gaps(time)
    if not len(rows):
        return []
    k = int(rows[np.argmax(missing)])
    share = 100 * missing.sum() / (len(time) + missing.sum())
    return [
        f"{missing.sum()} sample(s) are missing in {len(rows)} gap(s), {share:.2g} % of the log; "
        f"the longest is {time[k + 1] - time[k]:.4g} s after {raw.place(k + start)}."
    ]
