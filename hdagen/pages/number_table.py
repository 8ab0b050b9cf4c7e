"""A table of key numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hdagen.pages import frame
from hdagen.pages.quantity import format_number

TableCell = str | float | int | bool | None


def draw_table(
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[TableCell]],
    *,
    digits: int = 4,
    caption: str = "",
    sentences: Sequence[str] = (),
    links: Sequence[str | None] = (),
    searchable: bool = False,
) -> str:
    """Draw a table of words and numbers; its CSV holds the numbers in full.

    Args:
        title: Heading.
        columns: Headings of the columns.
        rows: Cells, one for every column; None is written as a dash.
        digits: Count of significant digits of numbers.
        caption: Text below the table.
        sentences: Headings of the columns whose text breaks its lines.
        links: A relative address for each row, to which its first cell leads; None, or nothing: no link.
        searchable: Whether readers can search the rows and sort them by any column.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: A row does not have one cell for every column.

    """
    for at, row in enumerate(rows):
        if len(row) != len(columns):
            raise ValueError(
                f"table {title!r}: row {at} has {len(row)} cells for {len(columns)} columns; give one for every column"
            )
    written, sent = [], [list[TableCell](columns)]
    for row in rows:
        written.append([format_cell(cell, digits) for cell in row])
        sent.append([_encode_cell(cell) for cell in row])
    data: dict[str, object] = {"rows": sent}
    if searchable:
        data["searchable"] = True
    body = frame.build_rows_table(columns, written, sentences=sentences, links=links)
    return frame.build_figure("table", title, body, caption=caption, data=data)


def format_cell(cell: TableCell, digits: int) -> str:
    """Write a cell as text.

    Args:
        cell: Words, a number, a Boolean, or None.
        digits: Count of significant digits of numbers.

    Returns:
        The text; a dash for None, yes and no for a Boolean.

    """
    if cell is None:
        return "–"
    if cell is True:
        return "yes"
    if cell is False:
        return "no"
    if isinstance(cell, str):
        return cell
    return format_number(cell, digits)


def _encode_cell(cell: TableCell) -> TableCell:
    """The cell as JSON takes it: NaN and infinities, which JSON lacks, become words."""
    if isinstance(cell, (str, bool)) or cell is None:
        return cell
    value = float(cell)
    if not math.isfinite(value):
        return str(value)
    if value == int(value):
        return int(cell)
    return value
