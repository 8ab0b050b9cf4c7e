"""A table in memory as a log's columns: an Arrow table, a data frame of pandas or polars, or arrays by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hdagen.log.data_table import LogError, Table, check_cells, check_columns, convert_to_float, find_type_problems
from hdagen.support.messages import show_value

POSSIBLE_TABLES = "an Arrow table, a data frame of pandas or polars, or a dict of arrays"


def convert_table(data: Any, source: str, keep: Callable[[str], bool]) -> Table:
    """Convert a table in memory to columns of numbers.

    Arrow's C interface is asked for first, then the interchange protocol of data frames, then ``to_dict("list")``.

    Args:
        data: The table: anything with one of these, or arrays (T,) by name.
        source: Its name, for sentences.
        keep: Tells by a column's name whether it is taken.

    Returns:
        The columns, in the units that they had; time stamps as seconds from their first row.

    Raises:
        LogError: The data are no table, or a column that is taken is not numeric.

    """
    arrow = _convert_to_arrow(data, source)
    wanted = check_columns(source, arrow.column_names, keep)
    check_cells(source, arrow.num_rows, len(wanted))
    if problems := find_type_problems(source, arrow.schema, wanted):
        raise LogError(problems)
    notes: list[str] = []
    columns = {name: convert_to_float(name, arrow.column(name), notes) for name in wanted}
    return Table(columns, tuple(arrow.column_names), None, tuple(notes))


def is_table(data: Any) -> bool:
    """Tell whether data have one of the interfaces of a table.

    Args:
        data: Anything.

    Returns:
        Whether `convert_table` takes it.

    """
    named = ("__arrow_c_stream__", "__dataframe__", "to_dict")
    return isinstance(data, Mapping) or any(hasattr(data, name) for name in named)


def _convert_to_arrow(data: Any, source: str) -> Any:
    """The data as an Arrow table. Raises LogError."""
    import pyarrow as pa

    if not is_table(data):
        raise LogError([f"{source}: found {show_value(data)}, possible are {POSSIBLE_TABLES}."])
    try:
        if hasattr(data, "__arrow_c_stream__"):
            return pa.table(data)
        if hasattr(data, "__dataframe__"):
            from pyarrow.interchange import from_dataframe

            return from_dataframe(data)
        columns = data
        if not isinstance(data, Mapping):
            columns = data.to_dict("list")
        return pa.table({str(name): np.asarray(values) for name, values in columns.items()})
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise LogError(
            [f"{source}: is no table of columns of equal length ({error}); possible are {POSSIBLE_TABLES}."]
        ) from None
