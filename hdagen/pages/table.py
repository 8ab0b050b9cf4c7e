"""A table of key numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hdagen.pages import frame
from hdagen.pages.quantity import number

Cell = str | float | int | bool | None


def table(
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[Cell]],
    *,
    digits: int = 4,
    caption: str = "",
    sentences: Sequence[str] = (),
) -> str:
    """``rows`` of words and numbers under ``columns``; numbers to ``digits`` significant digits, None is a dash; the
    columns named in ``sentences`` hold text that breaks its lines.

    The CSV holds the numbers in full. ValueError where a row does not have one cell for every column.
    """
    for at, row in enumerate(rows):
        if len(row) != len(columns):
            raise ValueError(
                f"table {title!r}: row {at} has {len(row)} cells for {len(columns)} columns; give one for every column"
            )
    written = [[_written(cell, digits) for cell in row] for row in rows]
    data = {"rows": [list(columns), *([_sent(cell) for cell in row] for row in rows)]}
    return frame.figure(
        "table", title, frame.rows_table(columns, written, sentences=sentences), caption=caption, data=data
    )


def _written(cell: Cell, digits: int) -> str:
    if cell is None:
        return "–"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return cell if isinstance(cell, str) else number(cell, digits)


def _sent(cell: Cell) -> Cell:
    """NaN and infinities are no JSON; they go as words."""
    if isinstance(cell, (str, bool)) or cell is None:
        return cell
    value = float(cell)
    return str(value) if not math.isfinite(value) else int(cell) if value == int(value) else value
