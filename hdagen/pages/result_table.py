"""A small table of results that prints as text, shows in a notebook, and goes into Arrow, pandas or polars."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hdagen.pages.markup import build_element, escape_html
from hdagen.pages.number_table import TableCell, format_cell

PRINTED_DIGITS = 4  # significant digits of a printed number
MOST_PRINTED_ROWS = 20  # rows that are printed; the table holds all of them
CELL_GAP = "  "  # between the columns of the printed table


@dataclass(frozen=True, eq=False)
class ResultTable:
    """Rows of results under named columns; None stands where a row has no value.

    Attributes:
        title: The heading.
        columns: Cells of each column by its name, all of one length.

    """

    title: str
    columns: Mapping[str, Sequence[TableCell]]

    def __post_init__(self) -> None:
        lengths = {name: len(cells) for name, cells in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"the columns of {self.title!r} differ in length: {lengths}")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __getitem__(self, name: str) -> Sequence[TableCell]:
        """The cells of a column. Raises KeyError with the names of the columns."""
        if name not in self.columns:
            raise KeyError(f"{self.title!r} has no column {name}; it has {', '.join(self.columns)}")
        return self.columns[name]

    def __iter__(self) -> Iterator[dict[str, TableCell]]:
        """The rows, each as cells by column."""
        for cells in zip(*self.columns.values(), strict=True):
            yield dict(zip(self.columns, cells, strict=True))

    def __str__(self) -> str:
        written = [list(self.columns), *self._write_rows()]
        widths = [max(map(len, column)) for column in zip(*written, strict=True)]
        lines = [self.title]
        for row in written:
            cells = (self._align(k, cell, widths[k]) for k, cell in enumerate(row))
            lines.append(CELL_GAP.join(cells).rstrip())
        return "\n".join([*lines, *self._count_hidden_rows()])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """The table as HTML, for notebooks."""
        heading = build_element("tr", *(build_element("th", escape_html(name)) for name in self.columns))
        rows = []
        for row in self._write_rows():
            rows.append(build_element("tr", *(build_element("td", escape_html(cell)) for cell in row)))
        caption = build_element("caption", escape_html(self.title))
        body = build_element("tbody", *rows)
        table = build_element("table", caption, build_element("thead", heading), body)
        return table + "".join(build_element("p", escape_html(line)) for line in self._count_hidden_rows())

    def to_dict(self) -> dict[str, list[TableCell]]:
        """Copy the columns.

        Returns:
            The cells of each column by its name.

        """
        return {name: list(cells) for name, cells in self.columns.items()}

    def to_pandas(self) -> Any:
        """Convert to pandas, which must be installed.

        Returns:
            The table as a pandas.DataFrame.

        """
        import pyarrow

        return pyarrow.table(self.to_dict()).to_pandas()

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """The table by Arrow's C interface, as `pyarrow.table` and `polars.DataFrame` ask for it."""
        import pyarrow

        return pyarrow.table(self.to_dict()).__arrow_c_stream__(requested_schema)

    def _write_rows(self) -> list[list[str]]:
        """The cells of the first rows as text."""
        rows = list(zip(*self.columns.values(), strict=True))[:MOST_PRINTED_ROWS]
        return [[format_cell(cell, PRINTED_DIGITS) for cell in row] for row in rows]

    def _count_hidden_rows(self) -> list[str]:
        """A line on the rows that are not printed; none where all are."""
        hidden = len(self) - MOST_PRINTED_ROWS
        if hidden <= 0:
            return []
        return [f"… and {hidden} more rows"]

    def _align(self, k: int, cell: str, width: int) -> str:
        """A cell of column ``k`` in its width: numbers to the right, words to the left."""
        cells = list(self.columns.values())[k]
        if all(one is None or (isinstance(one, int | float) and not isinstance(one, bool)) for one in cells):
            return cell.rjust(width)
        return cell.ljust(width)
