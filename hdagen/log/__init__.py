"""Logs: read from CSV, Parquet and MATLAB files, mapped to the columns of bring_your_log.md, checked, written."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from hdagen.log.column_map import ColumnsError
    from hdagen.log.data_table import LogError
    from hdagen.log.measured_log import Log, read, write

__all__ = ["ColumnsError", "Log", "LogError", "read", "write"]
__getattr__, __dir__ = lazy_names(
    __name__, {"column_map": ("ColumnsError",), "data_table": ("LogError",), "measured_log": ("Log", "read", "write")}
)
