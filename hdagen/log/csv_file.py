"""CSV files as people really have them: read fast, and where that fails read slowly to name each bad place."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hdagen.log.data_table import MOST_CELLS, LogError, Table, check_cells, check_columns, get_first_line
from hdagen.support.messages import join_names

_HEAD_BYTES = 1 << 20  # bytes within which the header must end, and every row
_TAIL_BYTES = 4096  # bytes at the end that are checked for zeros
_MOST_BAD_PLACES = 10_000  # bad rows and cells, after which reading stops
_MOST_CELL_CHARACTERS = 131_072  # characters of a cell at most, by Python's reader
_MOST_NAMED_PLACES = 5  # bad rows named one by one; the others are counted
_EMPTY_CELLS = ("", "nan", "-nan", "NaN", "NAN", "Nan", "NA", "N/A", "#N/A", "null", "NULL", "None")
_NUMBER_PATTERN = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|Inf|INF|infinity|Infinity)")
_FOREIGN_FORMATS = {  # first bytes of other formats that get the wrong ending
    b"PAR1": "a Parquet file: name it .parquet",
    b"MATLAB": "a MATLAB file: name it .mat",
    b"\x89HDF": "an HDF5 file (MATLAB 7.3 and others): export it as CSV or Parquet",
    b"PK\x03\x04": "a zip archive (or a spreadsheet): unpack it, or export the sheet as CSV",
    b"\x1f\x8b": "gzip-compressed: unpack it",
    b"\x28\xb5\x2f\xfd": "zstd-compressed: unpack it",
    b"SQLite": "an SQLite database (a rosbag?): export the topics as CSV or Parquet",
    b"\x89MCAP": "an MCAP recording: export the topics as CSV or Parquet",
}
_BYTE_ORDER_MARKS = (
    (b"\xff\xfe\0\0", "UTF-32"),
    (b"\0\0\xfe\xff", "UTF-32"),
    (b"\xff\xfe", "UTF-16"),
    (b"\xfe\xff", "UTF-16"),
)


@dataclass(frozen=True)
class _Layout:
    """The layout of a CSV file: the header's names, and the first data row as text line ``first_line``."""

    names: tuple[str, ...]
    delimiter: str
    decimal: str
    first_line: int
    notes: tuple[str, ...]


def read_csv(path: Path, keep: Callable[[str], bool]) -> Table:
    """Read columns of a CSV file; an empty cell is NaN.

    Args:
        path: The file.
        keep: Tells by a column's name whether it is read.

    Returns:
        The columns as they stand in the file.

    Raises:
        LogError: The file cannot be read; bad rows and cells are named.

    """
    layout = _find_layout(path)
    kept = set(check_columns(path, layout.names, keep))
    wanted = [i for i, name in enumerate(layout.names) if name in kept]
    _check_rows(path, len(layout.names), len(wanted))
    import pyarrow as pa
    import pyarrow.csv as pa_csv

    keys = [str(i) for i in range(len(layout.names))]
    try:
        with pa.memory_map(str(path)) as file:
            arrow = pa_csv.read_csv(
                file,
                pa_csv.ReadOptions(column_names=keys, skip_rows=layout.first_line - 1, block_size=1 << 22),
                pa_csv.ParseOptions(delimiter=layout.delimiter),
                pa_csv.ConvertOptions(
                    # with no column wanted the first is read all the same: it carries the number of rows
                    include_columns=[keys[i] for i in wanted] or keys[:1],
                    column_types={keys[i]: pa.float64() for i in wanted} or {keys[0]: pa.string()},
                    decimal_point=layout.decimal,
                    null_values=list(_EMPTY_CELLS),
                ),
            )
    except MemoryError:
        raise LogError([f"{path}: there is not enough memory to read it; cut it into shorter logs."]) from None
    except (pa.ArrowException, OSError) as error:
        raise LogError(_find_bad_places(path, layout, wanted) or [_describe_unreadable(path, error)]) from None
    columns = {}
    for i in wanted:
        columns[layout.names[i]] = np.ascontiguousarray(arrow[keys[i]].to_numpy())
        arrow = arrow.drop_columns(keys[i])  # or the table would be there twice
    return Table(columns, layout.names, layout.first_line, layout.notes)


def _check_rows(path: Path, width: int, wanted: int) -> None:
    """Refuse a file that ends in zeros, and one with more cells than a log may have; a row has a byte for each of
    ``width`` columns, and ends in a line. Raises LogError."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(0, size - _TAIL_BYTES))
        if not file.read(_TAIL_BYTES).strip(b"\0"):
            raise LogError(
                [f"{path}: the file ends in zero bytes, as a crash leaves them: cut them off, or copy it again."]
            )
        if size // max(width, 1) * wanted <= MOST_CELLS:
            return
        file.seek(0)
        ends = b"\n" if b"\n" in file.read(_HEAD_BYTES) else b"\r"
        file.seek(0)
        rows = sum(block.count(ends) for block in iter(lambda: file.read(1 << 22), b""))
    check_cells(path, rows, wanted)


def _find_layout(path: Path) -> _Layout:
    """Find the layout of a CSV file from its head. Raises LogError."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except (OSError, ValueError) as error:
        raise LogError([_describe_unreadable(path, error)]) from None
    _refuse_foreign_format(path, head)
    notes: list[str] = []
    lines = re.split(r"\r\n|\n|\r", head.decode("utf-8", errors="replace").removeprefix("\ufeff"))
    number = 0  # lines before the header: blank, or comments
    while number < len(lines) - 1 and (not lines[number].strip() or lines[number].lstrip().startswith(("#", "%"))):
        number += 1
    if number == len(lines) - 1 and len(head) == _HEAD_BYTES:
        raise LogError([f"{path}: no header ends in the first {_HEAD_BYTES} bytes; export fewer columns or comments."])
    header, first = lines[number], number + 2
    if number and _is_number_row(header) and lines[number - 1].strip():  # numpy.savetxt puts the header into a comment
        header, first = lines[number - 1].lstrip("#% \t"), number + 1
        notes.append(f"The header was taken from the comment in line {number}.")
    if "\ufffd" in header:
        raise LogError(
            [f"{path}: the header is not UTF-8 text: convert it, as in iconv -f LATIN1 -t UTF-8 old.csv > new.csv."]
        )
    delimiter = max(",;\t", key=header.count)
    try:
        names = tuple(name.strip() for name in next(csv.reader([header], delimiter=delimiter), []))
    except csv.Error:
        raise LogError(
            [f"{path}: the name of a column is longer than {_MOST_CELL_CHARACTERS} characters; shorten it."]
        ) from None
    if _is_number_row(header):
        raise LogError(
            [f"{path}: no header, line {first - 1} holds numbers ({header[:60]}…): write the column names above it."]
        )
    if len(names) == 1 and len(header.split()) > 1:
        raise LogError(
            [f"{path}: the columns are separated by spaces ({header[:60]}…); possible are comma, semicolon and tab."]
        )
    if len(head) < _HEAD_BYTES and not any(line.strip() for line in lines[first - 1 :]):
        raise LogError(
            [f"{path}: the file has a header ({join_names(names, 8)}) and no rows: record again, or copy it again."]
        )
    decimal = "."
    if delimiter != "," and re.search(r"\d,\d", lines[first - 1]):
        decimal = ","
        notes.append(f"Decimal commas were read (the columns are separated by {delimiter!r}).")
    return _Layout(names, delimiter, decimal, first, tuple(notes))


def _refuse_foreign_format(path: Path, head: bytes) -> None:
    """Refuse an empty file, another format under the name of a CSV, and text that is not UTF-8."""
    what = None
    for mark, encoding in _BYTE_ORDER_MARKS:
        if what is None and head.startswith(mark):
            what = f"{encoding} text; possible is UTF-8: iconv -f {encoding} -t UTF-8 old.csv > new.csv converts it"
    for mark_, format_ in _FOREIGN_FORMATS.items():
        if what is None and head.startswith(mark_):
            what = format_
    if what is None and head and not head.strip(b"\0"):
        what = "nothing but zero bytes, as a crash leaves them: copy it again"
    if what is None and not head.strip():
        what = "empty: record it again, or copy it again"
    begin = head[:4096].rstrip(b"\0")  # zeros at the end are told of where the rows are
    if what is None and b"\0" in begin:  # UTF-16 without its mark has a zero in every other byte
        what = "binary, not text; possible are CSV text, .parquet and .mat: export it as one of these"
        if begin.count(b"\0") > 0.3 * len(begin):
            what = "UTF-16 text; possible is UTF-8: iconv -f UTF-16LE -t UTF-8 old.csv > new.csv converts it"
    if what is not None:
        raise LogError([f"{path}: the file is {what}."])


def _is_number_row(line: str) -> bool:
    """Whether a line holds numbers alone."""
    cells = [cell.strip().strip('"') for cell in re.split(r"[,;\t ]+", line.strip())]
    return bool(cells) and all(_NUMBER_PATTERN.fullmatch(cell) or cell in _EMPTY_CELLS for cell in cells)


def _find_bad_places(path: Path, layout: _Layout, wanted: list[int]) -> list[str]:
    """Walk a file that the fast reader refused; name each row of the wrong length and each cell that is no number."""
    width = len(layout.names)
    problems: list[str] = []
    ragged = cells = last_ragged = last_cell = 0
    for line, row in _read_rows(path, layout):
        if ragged + cells > _MOST_BAD_PLACES:
            problems.append(f"{path}: there are more, and what follows line {line} was not looked at.")
            break
        if isinstance(row, str):
            problems.append(f"{path}, line {line}: {row}.")
        elif len(row) != width:
            ragged, last_ragged = ragged + 1, line
            if ragged <= _MOST_NAMED_PLACES:
                problems.append(_describe_ragged_row(path, layout, line, len(row)))
        else:
            for i in wanted:
                text = row[i].strip().replace(layout.decimal, ".")
                if text not in _EMPTY_CELLS and not _NUMBER_PATTERN.fullmatch(text):
                    cells, last_cell = cells + 1, line
                    if cells <= _MOST_NAMED_PLACES:
                        problems.append(_describe_bad_cell(path, layout, line, i, row[i].strip()))
    for what, bad, last in (
        ("line(s) of the wrong length", ragged, last_ragged),
        ("cell(s) that are not numbers", cells, last_cell),
    ):
        if bad > _MOST_NAMED_PLACES:
            problems.append(f"{path}: {bad} {what} in all, the last in line {last}.")
    return problems


def _describe_ragged_row(path: Path, layout: _Layout, line: int, length: int) -> str:
    """Describe a row of ``length`` cells, which is too long or too short."""
    width, hint = len(layout.names), "delete or complete the line"
    if layout.delimiter == "," and length > width:
        hint = "if the numbers have decimal commas, export with decimal points, or with semicolons between the columns"
    return f"{path}, line {line}: {length} cells where the header has {width}: {hint}."


def _describe_bad_cell(path: Path, layout: _Layout, line: int, column: int, text: str) -> str:
    """Describe a cell that is no number."""
    hint = "correct or delete it (an empty cell means: no value)"
    if re.fullmatch(r"[+-]?\d+,\d+([eE][+-]?\d+)?", text):
        hint = "it has a decimal comma: export with decimal points, or with semicolons between the columns"
    elif line == layout.first_line:
        hint = "if the line holds units, delete it and state them in columns.toml"
    return f"{path}, line {line}, column {layout.names[column]}: {text[:40]!r} is not a number: {hint}."


def _read_rows(path: Path, layout: _Layout) -> Iterator[tuple[int, list[str] | str]]:
    """The data rows with their line numbers, without blank lines.

    In place of a line that is too long comes the end of a sentence on it, and nothing after it.
    """
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for line, text in enumerate(iter(lambda: file.readline(_HEAD_BYTES), ""), start=1):
            if len(text) == _HEAD_BYTES:
                found = "no end of the line"
                if text.count("\0") > _HEAD_BYTES / 2:
                    found = "nothing but zeros"
                yield line, f"there is {found}, in {_HEAD_BYTES} characters: cut the file before it, or copy it again"
                return
            if line < layout.first_line or not text.strip():
                continue
            try:
                yield line, next(csv.reader([text.replace("\0", "\ufffd")], delimiter=layout.delimiter))
            except csv.Error:
                yield line, f"a cell is longer than {_MOST_CELL_CHARACTERS} characters: correct or delete it"


def _describe_unreadable(path: Path, error: BaseException) -> str:
    why = getattr(error, "strerror", None) or get_first_line(error)
    return f"{path}: cannot be read ({why}): check that the file is whole and that it may be read."
