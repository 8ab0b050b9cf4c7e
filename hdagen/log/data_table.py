"""A table of numbers and its files, CSV and Parquet: exact both ways, written whole or not at all."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from hdagen.support.atomic_write import open_atomically
from hdagen.support.messages import join_names, make_printable, show_path, show_value

MOST_COLUMNS = 10_000  # columns of a file
MOST_CELLS = 100_000_000  # rows times columns in use: an hour of 27 columns at 1 kHz
_MOST_UNPACKED_BYTES = 10 * MOST_CELLS  # bytes
_MOST_FOOTER_BYTES = 16 << 20  # bytes that describe the columns and row groups of a Parquet file
_MOST_PROBLEMS = 100  # problems that are listed
_SMALLER_LOG_ADVICE = "cut the log into shorter ones, or leave columns out with ignore in a columns.toml"
_WRITABLE_FORMATS = (".csv", ".parquet")
_WRITABLE_NAME_PATTERN = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,63}")  # a column name that needs no quoting anywhere


class LogError(Exception):
    """A log that cannot be used or written.

    Attributes:
        problems: One printable sentence for each problem; of very many the first ones.

    """

    def __init__(self, problems: list[str]) -> None:
        self.problems = [make_printable(problem) for problem in problems[:_MOST_PROBLEMS]]
        if len(problems) > _MOST_PROBLEMS:
            self.problems.append(f"{len(problems) - _MOST_PROBLEMS} more problems are not listed: mend these first.")
        super().__init__("\n".join(self.problems))


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of equal length as they stand in a file, no unit converted.

    Attributes:
        columns: (T,) each, float64, for the names that were asked for; NaN where a cell is empty.
        names: All names in the file.
        first_line: The text line of row 1; None where the file is not text.
        notes: Sentences on how the file was read.

    """

    columns: dict[str, np.ndarray]
    names: tuple[str, ...]
    first_line: int | None
    notes: tuple[str, ...]

    def describe_row(self, row: int) -> str:
        """Name a row as a person counts it.

        Args:
            row: The row's number, from 0.

        Returns:
            The number from 1 in words, with the row's line in a text file.

        """
        if self.first_line is None:
            return f"row {row + 1}"
        return f"row {row + 1} (line {row + self.first_line})"


def read_parquet(path: Path, keep: Callable[[str], bool]) -> Table:
    """Read columns of a Parquet file; pages with a wrong checksum are refused.

    Args:
        path: The file.
        keep: Tells by a column's name whether it is read.

    Returns:
        The columns as they stand in the file; time stamps as seconds from their first row.

    Raises:
        LogError: The file cannot be read, is too large, or holds a column that is not numeric.

    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        _check_footer(path)
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            schema = file.schema_arrow
            wanted = check_columns(path, schema.names, keep)
            check_cells(path, file.metadata.num_rows, len(wanted))
            _check_unpacked(path, file.metadata, set(wanted))
            if problems := find_type_problems(path, schema, wanted):
                raise LogError(problems)
            notes: list[str] = []
            columns = {}
            for name in wanted:
                columns[name] = convert_to_float(name, file.read(columns=[name]).column(0), notes)
    except MemoryError:
        raise LogError([f"{path}: there is not enough memory to read it; {_SMALLER_LOG_ADVICE}."]) from None
    except (pa.ArrowException, OSError, ValueError) as error:
        raise LogError(
            [
                f"{path}: not a readable Parquet file ({get_first_line(error)}): the file is damaged, incomplete or of "
                "another format; copy or export it again."
            ]
        ) from None
    return Table(columns, tuple(schema.names), None, tuple(notes))


def is_number_type(kind: Any) -> bool:
    """Tell whether an Arrow type converts to float64.

    Args:
        kind: The type.

    Returns:
        Whether it is one of integers, floating point or Booleans.

    """
    import pyarrow as pa

    types = pa.types
    return types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)


def find_type_problems(source: Path | str, schema: Any, wanted: Sequence[str]) -> list[str]:
    """Find columns that hold no numbers.

    Args:
        source: The origin of the table, for sentences.
        schema: The Arrow schema.
        wanted: The names of the columns that are read.

    Returns:
        One sentence for each column that is not numeric.

    """
    import pyarrow as pa

    problems = []
    for name in wanted:
        kind = schema.field(name).type
        if not (is_number_type(kind) or pa.types.is_timestamp(kind) or pa.types.is_duration(kind)):
            problems.append(
                f"{source}: column {name} holds {kind}, not numbers; possible are integers, floating point, "
                "booleans and time stamps: convert it, or leave the column out."
            )
    return problems


def convert_to_float(name: str, column: Any, notes: list[str]) -> np.ndarray:
    """Convert an Arrow column to float64; time stamps become seconds from the first one.

    Args:
        name: The column's name, for the note.
        column: The column.
        notes: Receives a sentence where time stamps are converted.

    Returns:
        (T,), NaN where a value is missing.

    """
    import pyarrow as pa

    if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
        per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[column.type.unit]
        ticks = column.cast(pa.int64())
        if ticks.null_count == 0 and len(ticks):
            notes.append(f"{name} holds {column.type}: taken as seconds from its first row.")
            ticks = ticks.to_numpy()
            return (ticks - ticks[0]) / per_second
        return np.full(len(ticks), np.nan)
    return np.ascontiguousarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def check_columns(path: Path | str, names: Sequence[str], keep: Callable[[str], bool]) -> list[str]:
    """Choose the columns of a file that are read.

    Args:
        path: The file, for the error.
        names: All names in its header.
        keep: Tells by a column's name whether it is read.

    Returns:
        The names of the columns that are read.

    Raises:
        LogError: There are too many columns, or one that is read stands in the header more than once.

    """
    if len(names) > MOST_COLUMNS:
        raise LogError(
            [f"{path}: found {len(names)} columns, possible are {MOST_COLUMNS}; export those that are needed."]
        )
    wanted = [name for name in dict.fromkeys(names) if name and keep(name)]
    places: dict[str, list[str]] = {name: [] for name in wanted}
    for i, name in enumerate(names, 1):
        if name in places:
            places[name].append(str(i))
    problems = [
        f"{path}: column {name} stands {len(at)} times in the header (columns {join_names(at, 8)}); "
        "which one counts cannot be known: rename or delete all but one."
        for name, at in places.items()
        if len(at) > 1
    ]
    if problems:
        raise LogError(problems)
    return wanted


def check_cells(path: Path | str, rows: int, columns: int) -> None:
    """Refuse a file with more cells than a log may have, before any is read.

    Args:
        path: The file, for the error.
        rows: Its rows.
        columns: Its columns in use.

    Raises:
        LogError: There are more than `MOST_CELLS` cells.

    """
    if rows * columns > MOST_CELLS:
        raise LogError(
            [
                f"{path}: found {rows} rows of {columns} columns in use, possible are {MOST_CELLS} cells;"
                f" {_SMALLER_LOG_ADVICE}."
            ]
        )


def _check_footer(path: Path) -> None:
    """Refuse a Parquet file whose description of itself is too long to be one of a log's columns. Raises LogError."""
    with path.open("rb") as file:
        file.seek(-min(8, path.stat().st_size), os.SEEK_END)
        length = int.from_bytes(file.read(4), "little")
    if _MOST_FOOTER_BYTES < length < path.stat().st_size:
        raise LogError(
            [
                f"{path}: its columns are described in {length} bytes, possible are {_MOST_FOOTER_BYTES}; export those"
                " in use."
            ]
        )


def _check_unpacked(path: Path, metadata: Any, wanted: set[str]) -> None:
    """Refuse a Parquet file whose columns in use unpack to more than a log may have. Raises LogError."""
    groups = (metadata.row_group(g) for g in range(metadata.num_row_groups))
    chunks = (group.column(i) for group in groups for i in range(group.num_columns))
    unpacked = sum(max(c.total_uncompressed_size, 0) for c in chunks if c.path_in_schema in wanted)
    if unpacked > _MOST_UNPACKED_BYTES:
        raise LogError(
            [f"{path}: unpacks to {unpacked} bytes, possible are {_MOST_UNPACKED_BYTES}; {_SMALLER_LOG_ADVICE}."]
        )


def find_write_problems(path: Path) -> list[str]:
    """Find the reasons why no table can be written to a path, before the work for the table is done.

    Args:
        path: The file to be written.

    Returns:
        One sentence for each problem; none where the path will do.

    """
    problems = []
    if path.suffix not in _WRITABLE_FORMATS:
        problems.append(
            f"cannot write a file ending in {show_value(path.suffix)}; possible are {' and '.join(_WRITABLE_FORMATS)}."
        )
    folder = path.absolute().parent
    if not os.path.isdir(folder):
        problems.append(f"there is no folder {show_path(folder)}; make it or name another.")
    elif os.path.isdir(path):
        problems.append("is a folder; name a file in it.")
    return [f"{show_path(path)}: {problem}" for problem in problems]


def write_table(table: Mapping[str, np.ndarray], path: Path | str) -> None:
    """Write columns as float64: to .csv in the shortest text that reads back exactly, or to .parquet with checksums.

    The file appears whole or not at all; where writing fails an earlier file stays as it was.

    Args:
        table: (T,) each, by name.
        path: The file, ending in .csv or .parquet.

    Raises:
        LogError: The columns or the path will not do, or the file cannot be written.

    """
    path = Path(path)
    columns = {name: np.asarray(values, dtype=np.float64) for name, values in table.items()}
    problems = [
        f"{path}: column name {name[:80]!r} cannot be written; possible are letters, digits and _, at most 64."
        for name in columns
        if not _WRITABLE_NAME_PATTERN.fullmatch(name)
    ]
    if len({values.shape for values in columns.values()}) != 1 or any(v.ndim != 1 for v in columns.values()):
        shapes = ", ".join(f"{name} {values.shape}" for name, values in columns.items())
        problems.append(f"{path}: a table needs at least one column and all of one length; given: {shapes or 'none'}.")
    problems += find_write_problems(path)
    if problems:
        raise LogError(problems)
    import pyarrow as pa

    arrow = pa.table(columns)
    try:
        with open_atomically(path) as file:
            _write_arrow_table(arrow, path.suffix, file)
    except (OSError, pa.ArrowException) as error:
        why = getattr(error, "strerror", None) or get_first_line(error)
        raise LogError(
            [f"{path}: cannot be written ({why}); nothing was left half-written: make room or choose another place."]
        ) from None


def stream_columns(columns: Mapping[str, Any], requested_schema: object) -> object:
    """Give columns out by Arrow's C interface.

    Args:
        columns: (T,) each, by name.
        requested_schema: The schema that the receiver asks for, if any.

    Returns:
        The capsule of a stream.

    """
    import pyarrow as pa

    return pa.table(dict(columns)).__arrow_c_stream__(requested_schema)


def _write_arrow_table(arrow: Any, suffix: str, file: BinaryIO) -> None:
    if suffix == ".parquet":
        import pyarrow.parquet as pq

        pq.write_table(arrow, file, compression="zstd", write_page_checksum=True)
        return
    import pyarrow.csv as pa_csv

    file.write((",".join(arrow.column_names) + "\n").encode())
    pa_csv.write_csv(arrow, file, pa_csv.WriteOptions(include_header=False))


def get_first_line(error: BaseException) -> str:
    """Take the first line of an error's text.

    Args:
        error: The error.

    Returns:
        The line without its final full stop, of 300 characters at most.

    """
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(". ")[:300]
