"""Tables in memory as logs: Arrow, data frames by their interfaces, arrays by name; and what is no table."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import hdagen
from hdagen.log.measured_log import Log, write

ROWS = 400
TIME = np.arange(ROWS) * 1e-3
COLUMNS = {
    "time": TIME,
    "motor_current_1": np.sin(9 * TIME),
    "motor_position_1": 1.0 - np.cos(7 * TIME),
    "remark": np.arange(ROWS),
}


class ArrowFrame:
    """A table by Arrow's C interface, as polars and newer pandas give it."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self.table = pa.table(columns)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.table.__arrow_c_stream__(requested_schema)


class InterchangeFrame:
    """A table by the interchange protocol of data frames."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self.table = pa.table(columns)

    def __dataframe__(self, *arguments: Any, **options: Any) -> Any:
        return self.table.__dataframe__(*arguments, **options)


class PlainFrame:
    """A table that only becomes a dict of lists, as older pandas does."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self.columns = columns

    def to_dict(self, orient: str = "dict") -> dict[str, Any]:
        assert orient == "list"
        return {name: list(values) for name, values in self.columns.items()}


MAKERS = [dict, pa.table, ArrowFrame, InterchangeFrame, PlainFrame]


def same(one: Log, other: Log) -> bool:
    return one.columns.keys() == other.columns.keys() and all(
        np.array_equal(one[name], other[name], equal_nan=True) for name in ("time", *one.columns)
    )


@pytest.mark.parametrize("make", MAKERS)
def test_a_table_is_the_log_that_its_file_would_be(make: Callable[[dict[str, Any]], Any], tmp_path: Path) -> None:
    write(COLUMNS, tmp_path / "log.parquet")
    log = hdagen.read_log(make(COLUMNS))
    assert same(log, hdagen.read_log(tmp_path / "log.parquet"))
    assert log.source == "table" and log.n_joints == 1 and "Columns not used: remark." in log.notes


def test_a_pandas_frame_is_a_table() -> None:
    pandas = pytest.importorskip("pandas")
    assert same(hdagen.read_log(pandas.DataFrame(COLUMNS)), hdagen.read_log(COLUMNS))


def test_a_polars_frame_is_a_table() -> None:
    polars = pytest.importorskip("polars")
    assert same(hdagen.read_log(polars.DataFrame(COLUMNS)), hdagen.read_log(COLUMNS))


def test_foreign_names_and_units_are_mapped_by_tables_or_a_file(tmp_path: Path) -> None:
    foreign = {"t": 1e3 * TIME, "i": COLUMNS["motor_current_1"], "angle": np.degrees(COLUMNS["motor_position_1"])}
    mapped = {
        "time": {"from": "t", "unit": "ms"},
        "motor_current_1": {"from": "i"},
        "motor_position_1": {"from": "angle", "unit": "deg"},
    }
    log = hdagen.read_log(foreign, columns=mapped)
    assert np.allclose(log.time, TIME) and np.allclose(log["motor_position_1"], COLUMNS["motor_position_1"])
    file = tmp_path / "columns.toml"
    file.write_text(
        "\n".join(f"[{n}]\n" + "\n".join(f'{k} = "{v}"' for k, v in each.items()) for n, each in mapped.items())
    )
    assert same(hdagen.read_log(pa.table(foreign), columns=file), log)


def test_a_log_is_returned_as_it_is_and_goes_into_arrow() -> None:
    log = hdagen.read_log(COLUMNS)
    assert hdagen.read_log(log) is log
    assert same(hdagen.read_log(pa.table(log)), log)


def test_missing_values_and_time_stamps() -> None:
    current = pa.array([None, *COLUMNS["motor_current_1"][1:]])
    stamps = pa.array((1e6 * TIME).round().astype(np.int64), pa.timestamp("us"))
    log = hdagen.read_log(pa.table(COLUMNS | {"time": stamps, "motor_current_1": current}))
    assert np.isnan(log["motor_current_1"][0]) and np.allclose(log.time, TIME)
    assert any("taken as seconds from its first row" in note for note in log.notes)


@pytest.mark.parametrize(
    "data, said",
    [
        (7, "table: found 7, possible are an Arrow table"),
        ([1.0], "table: found [1.0]"),
        ({}, "table: there is no column time"),
        (COLUMNS | {"time": TIME[1:]}, "table: is no table of columns of equal length"),
        (COLUMNS | {"motor_position_1": ["a"] * ROWS}, "table: column motor_position_1 holds string, not numbers"),
        (COLUMNS | {"motor_position_1": [[1.0, 2.0]] * ROWS}, "table: "),
        (COLUMNS | {"time": -TIME}, "table, row 2: time runs backwards"),
        ({"time": TIME}, "table: no column of any joint was found"),
    ],
)
def test_what_is_no_log_is_refused(data: Any, said: str) -> None:
    with pytest.raises(hdagen.LogError, match=re.escape(said)):
        hdagen.read_log(data)


def test_a_wrong_map_of_columns_is_refused() -> None:
    with pytest.raises(hdagen.ColumnsError, match=r"columns: \[motor\] is not a column of a log"):
        hdagen.read_log(COLUMNS, columns={"motor": {"from": "i"}})
