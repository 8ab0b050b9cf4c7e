"""Logs: exact round trips, every bad log named with its place, columns.toml held against independent arithmetic."""

from __future__ import annotations

import errno
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hdagen.log import column_map_file
from hdagen.log.column_map import ColumnsError
from hdagen.log.data_table import LogError
from hdagen.log.mat_file import read_mat
from hdagen.log.measured_log import Log, find_gaps, read, write

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
HEADER = "time,motor_current_1,joint_position_1"


def rows(count: int = 8) -> list[str]:
    """Good rows, 1 ms apart."""
    return [f"{k * 1e-3:.6f},{0.1 * k:.3f},{0.01 * k:.4f}" for k in range(count)]


def csv(tmp_path: Path, *lines: str, name: str = "log.csv") -> Path:
    """A CSV file of these lines."""
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def problems(path: Path, columns: Path | None = None, joints: int | None = None) -> list[str]:
    """What reading complains of; it must complain, in sentences that name the file."""
    with pytest.raises(LogError) as raised:
        read(path, columns, joints)
    assert raised.value.problems
    for sentence in raised.value.problems:
        assert str(path) in sentence or (columns is not None and str(columns) in sentence)
        assert sentence.endswith((".", "?")) and "\n" not in sentence and len(sentence) < 1500
    return raised.value.problems


def one(path: Path, columns: Path | None = None, joints: int | None = None) -> str:
    """The only complaint."""
    found = problems(path, columns, joints)
    assert len(found) == 1, found
    return found[0]


def mapped(tmp_path: Path, log: str, toml: str) -> Log:
    """The log of these CSV lines through this columns.toml."""
    columns = tmp_path / "columns.toml"
    columns.write_text(toml)
    return read(csv(tmp_path, *log.split()), columns)


# Round trips


def bits(values: np.ndarray) -> np.ndarray:
    """Numbers as bit patterns, so that 0 differs from -0."""
    return np.ascontiguousarray(values).view(np.int64)


NUMBERS = st.floats(min_value=-1e9, max_value=1e9, allow_nan=False)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=2, max_size=40), start=st.floats(-1e6, 1e9))
def test_what_is_written_is_read_back_to_the_bit(
    tmp_path: Path, suffix: str, data: list[tuple[float, float]], start: float
) -> None:
    time = start + 0.001953125 * np.arange(len(data))
    values = np.array(data)
    log = Log(time, {"motor_current_1": values[:, 0], "joint_position_1": values[:, 1]}, 1, "made here")
    path = tmp_path / f"log{suffix}"
    write(log, path)
    back = read(path)
    assert list(back.columns) == list(log.columns) and back.n_joints == 1 and back.source == str(path)
    for name in ("time", *log.columns):
        assert np.array_equal(bits(back[name]), bits(log[name]))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_hardest_numbers_survive(tmp_path: Path, suffix: str) -> None:
    values = np.array(
        [0.0, -0.0, 5e-324, -2.2250738585072014e-308, 0.1, 1 / 3, 2 / 3 * 1e9, np.nextafter(1.0, 2), -1e9]
    )
    path = tmp_path / f"log{suffix}"
    write({"time": np.arange(9) * 1e-3, "motor_torque_1": values, "motor_position_1": values[::-1]}, path)
    back = read(path)
    assert np.array_equal(bits(back["motor_torque_1"]), bits(values))
    assert np.array_equal(bits(back["motor_position_1"]), bits(values[::-1]))


def test_a_log_gives_views_names_and_its_period(tmp_path: Path) -> None:
    log = read(csv(tmp_path, HEADER, *rows(10)))
    part = log.rows(3, 6)
    assert len(log) == 10 and len(part) == 3 and part.time[0] == log.time[3]
    assert part["motor_current_1"].base is not None and "motor_current_1" in log and "motor_current_2" not in log
    assert log.period == pytest.approx(1e-3)
    with pytest.raises(KeyError, match="no column motor_current_2; it has motor_current_1, joint_position_1"):
        log["motor_current_2"]
    with pytest.raises(ValueError, match="shape"):
        Log(log.time, {"motor_current_1": np.zeros(3)}, 1, "")
    with pytest.raises(ValueError, match="not a column"):
        Log(log.time, {"current": log.time}, 1, "")


def test_pyarrow_is_loaded_only_to_read_or_write() -> None:
    code = (
        "import sys, hdagen.log.measured_log, hdagen.data_quality.log_triage; sys.exit('pyarrow' in sys.modules or"
        " 'scipy' in sys.modules)"
    )
    folder = Path(__file__).resolve().parents[2]
    assert subprocess.run([sys.executable, "-c", code], cwd=folder, check=False).returncode == 0


# Writing: whole or not at all


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("step", ["open", "fsync", "replace"])
def test_a_failed_write_leaves_what_was_there(
    tmp_path: Path, suffix: str, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"log{suffix}"
    write({"time": np.arange(3.0), "motor_current_1": np.ones(3)}, path)
    before = path.read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, step, full)
    with pytest.raises(LogError, match="cannot be written .No space left on device.; nothing was left half-written"):
        write({"time": np.arange(99.0), "motor_current_1": np.zeros(99)}, path)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform != "linux", reason="limits the size of a file as Linux does")
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_disk_that_fills_up_in_the_middle_leaves_nothing(tmp_path: Path, suffix: str) -> None:
    code = (
        "import resource, sys, numpy as np\n"
        "from hdagen.log import LogError, write\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))\n"
        "noise = np.random.default_rng(1).random(100000)\n"
        "try:\n    write({'time': noise}, sys.argv[1])\n"
        "except LogError as error:\n    sys.exit(7 if 'nothing was left half-written' in str(error) else 8)\n"
    )
    folder = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / f"log{suffix}")], cwd=folder, check=False)
    assert done.returncode == 7
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write({"time": np.arange(3.0)}, tmp_path / "log.csv")
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    table = {"time": np.arange(3.0)}
    with pytest.raises(LogError, match="nowhere/log.csv: there is no folder .*nowhere; make it"):
        write(table, tmp_path / "nowhere" / "log.csv")
    if sys.platform == "linux":  # a file system that is read-only even for the superuser
        with pytest.raises(LogError, match="/proc/log.csv: cannot be written"):
            write(table, "/proc/log.csv")
    (tmp_path / "locked").mkdir()
    (tmp_path / "locked").chmod(0o500)
    if os.access(tmp_path / "locked", os.W_OK):
        return  # the superuser writes everywhere
    with pytest.raises(LogError, match="cannot be written .Permission denied"):
        write(table, tmp_path / "locked" / "log.csv")


def test_a_table_that_cannot_be_written_is_named_with_every_fault(tmp_path: Path) -> None:
    with pytest.raises(LogError) as raised:
        write({"time": np.arange(3.0), 'a",b\n': np.arange(4.0)}, tmp_path / "log.xlsx")
    text = str(raised.value)
    assert len(raised.value.problems) == 3
    assert (
        "'a\",b\\n' cannot be written" in text
        and "all of one length" in text
        and "possible are .csv and .parquet" in text
    )


# Bad files

COLUMN_2 = "time,motor_current_1,joint_position_1,motor_current_1"


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "the file is empty"),
        (b" \n\n", "the file is empty"),
        (HEADER.encode(), "has a header .time, motor_current_1, joint_position_1. and no rows"),
        (HEADER.encode() + b"\n\n", "and no rows"),
        (f"{HEADER}\n{rows()[0]}\n".encode(), "1 row.s. only"),
        ("\n".join([HEADER, *rows()]).encode("utf-16"), "UTF-16 text; possible is UTF-8: iconv -f UTF-16 "),
        ("\n".join([HEADER, *rows()]).encode("utf-16-le"), "UTF-16 text; possible is UTF-8: iconv"),
        ("\n".join([HEADER, *rows()]).encode("utf-32"), "UTF-32 text"),
        ("\n".join([HEADER + ",Winkel°", *(r + ",0" for r in rows())]).encode("latin-1"), "header is not UTF-8.*iconv"),
        (b"PAR1" + bytes(50), "a Parquet file: name it .parquet"),
        (b"\x1f\x8b\x08" + bytes(50), "gzip-compressed: unpack it"),
        (b"PK\x03\x04" + bytes(50), "spreadsheet"),
        (b"time,a\n" + bytes(range(256)), "binary, not text"),
        ("\n".join(rows()).encode(), "no header, line 1 holds numbers"),
        ("\n".join([HEADER, *rows()]).replace(",", "  ").encode(), "separated by spaces"),
        (
            "\n".join([COLUMN_2, *(r + ",0" for r in rows())]).encode(),
            "motor_current_1 stands 2 times in the header .columns 2, 4.",
        ),
        ("\n".join([HEADER, *rows()[:3], "0.003,abc,0"]).encode(), "line 5, column motor_current_1: .abc."),
        ("\n".join([HEADER, "s,A,rad", *rows()]).encode(), "line 2, column time: 's'.*if the line holds units"),
        ("\n".join([HEADER, *rows()[:5], "0.005,1"]).encode(), "line 7: 2 cells where the header has 3"),
        ("\n".join([HEADER, *rows()[:2], "0,002,0,1,0,2"]).encode(), "line 4: 6 cells.*decimal commas"),
        ("\n".join([HEADER, *(",".join(f'"{c}"' for c in r.split(",")).replace(".", ",") for r in rows())]).encode(),
         "'0,000000' is not a number: it has a decimal comma"),
    ],
)  # fmt: skip
def test_a_bad_csv_is_named(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    text = "\n".join(problems(path))
    assert re.search(says, text), text


def test_every_bad_cell_and_row_is_named_and_the_rest_counted(tmp_path: Path) -> None:
    lines = [HEADER, *rows(40)]
    for k in range(3, 20):
        lines[k] = f"{k * 1e-3},x{k},0"
    lines[30] = "1"
    found = problems(csv(tmp_path, *lines))
    assert sum("is not a number" in sentence for sentence in found) == 5
    assert any("line 31: 1 cells where the header has 3" in sentence for sentence in found)
    assert any("17 cell(s) that are not numbers in all, the last in line 20" in sentence for sentence in found)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: t[[0, 1, 2, 3, 2, 5, 6, 7]], "row 5 .line 6.: time runs backwards, from 0.003 s to 0.002 s, 1 time"),
        (lambda t: t[::-1], "time runs backwards.*7 time"),
        (
            lambda t: t[[0, 1, 2, 2, 4, 5, 5, 7]],
            'row 4 .line 5.: the time stamp repeats.*2 in all.*duplicates = "first"',
        ),
        (lambda t: t * 1e3, 'looks like milliseconds .rows are 1 apart.*unit = "ms" under .time.'),
        (lambda t: t * 20e3, 'unit = "ms"'),
        (lambda t: t * 1e6, 'looks like microseconds.*unit = "us"'),
        (lambda t: t * 1e9 + 1.7e18, 'looks like nanoseconds.*unit = "ns"'),
        (lambda t: t * 1e-5, "rows are 1e-08 s apart, faster than any control loop"),
        (
            lambda t: np.where(np.arange(8) == 7, 1e200, t),
            "row 8 .line 9.: time is 1e.200 s, 1 value.*Delete these rows",
        ),
        (lambda t: np.where(np.arange(8) == 3, np.nan, t), "row 4 .line 5.: time has no value there, 1 time"),
    ],
)
def test_bad_time_is_named(tmp_path: Path, change: Callable[[np.ndarray], np.ndarray], says: str) -> None:
    time = change(np.arange(8) * 1e-3)
    lines = [f"{'' if np.isnan(t) else repr(float(t))},{k},{k}" for k, t in enumerate(time)]
    sentence = one(csv(tmp_path, HEADER, *lines))
    assert re.search(says, sentence), sentence


def test_a_declared_unit_of_time_is_believed(tmp_path: Path) -> None:
    lines = "\n".join([HEADER, *(f"{20 * k},{k},{k}" for k in range(5))])
    assert mapped(tmp_path, lines, '[time]\nunit = "ms"').period == pytest.approx(0.02)
    assert mapped(tmp_path, lines, '[time]\nunit = "s"').period == 20.0


def test_repeated_stamps_are_dropped_where_that_is_declared(tmp_path: Path) -> None:
    lines = "\n".join([HEADER, *(f"{(k - k % 3 // 2) * 1e-3},{k},{k}" for k in range(9))])
    log = mapped(tmp_path, lines, '[time]\nduplicates = "first"')
    assert list(log["motor_current_1"]) == [0, 1, 3, 4, 6, 7]
    assert any("3 row(s) with a repeated time stamp were dropped" in note for note in log.notes)


def test_missing_rows_are_counted_and_placed(tmp_path: Path) -> None:
    kept = [r for k, r in enumerate(rows(40)) if k not in (7, 20, 21, 22)]
    log = read(csv(tmp_path, HEADER, *kept))
    where, missing = find_gaps(log.time)
    assert list(where) == [6, 18] and list(missing) == [1, 3]
    note = next(note for note in log.notes if "missing" in note)
    assert "4 sample(s) are missing in 2 gap(s), 10 % of the log; the longest is 0.004 s after row 19 (line 20)" in note


def test_cells_without_a_value_are_named_with_their_run(tmp_path: Path) -> None:
    lines = rows(20)
    for k in (4, 5, 6, 12):
        lines[k] = lines[k].replace(f",{0.1 * k:.3f},", ",NaN,")
    lines[9] = "0.009,0.9,inf"
    lines[15] = "0.015,1.5,1e166"
    found = problems(csv(tmp_path, HEADER, *lines))
    assert any("row 5 (line 6): column motor_current_1 has no value in 4 row(s), up to 3 together" in s for s in found)
    assert any("row 10 (line 11): column joint_position_1 has no value in 1 row(s)" in s for s in found)
    assert any("row 16 (line 17): column joint_position_1 is 1e+166" in s for s in found)


def test_everything_wrong_with_a_log_is_said_at_once(tmp_path: Path) -> None:
    lines = ["time,motor_current_1,motor_current_3", *(f"{-k},{k},{'' if k == 4 else k}" for k in range(8))]
    text = "\n".join(problems(csv(tmp_path, *lines)))
    for part in (
        "joint 1 has no position",
        "joint 2 has no current or torque",
        "joint 2 has no position",
        "joint 3 has no position",
        "time runs backwards",
        "motor_current_3 has no value in 1 row",
    ):
        assert part in text


def test_the_joints_of_the_robot_must_be_those_of_the_log(tmp_path: Path) -> None:
    path = csv(tmp_path, HEADER, *rows())
    assert read(path, joints=1).n_joints == 1
    assert all("joint 2 has no" in sentence for sentence in problems(path, joints=2)[:-1])
    two = csv(tmp_path, HEADER + ",motor_current_2,motor_position_2", *(r + ",0,0" for r in rows()), name="two.csv")
    assert "columns of 2 joints, the robot has 1" in one(two, joints=1)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("log.xlsx", "no log ends in '.xlsx'; possible are"),
        ("nowhere.csv", "there is no such file"),
        ("folder.parquet", "is a folder"),
        ("x.mat", "no such file"),
    ],
)
def test_a_wrong_path_is_named(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / "folder.parquet").mkdir()
    assert says in one(tmp_path / name)


def test_a_log_without_the_contracts_names_lists_its_own(tmp_path: Path) -> None:
    found = problems(csv(tmp_path, "t,i,q", *rows()))
    assert "there is no column time:" in found[0] and "no column of any joint was found" in found[1]
    assert found[2].endswith(": the file has t, i, q.") and len(found) == 3


def test_the_columns_of_a_file_are_listed_once_the_nearest_first(tmp_path: Path) -> None:
    names = ["speed", "flag", "torque_1", "q1", "q2", "mode", "torque_2", "motor_pos_1", "temp", "seq", "stamp"]
    found = problems(csv(tmp_path, ",".join(names), *["0," * 10 + "0"] * 3), joints=2)
    assert len(found) == 6 and sum("flag" in sentence for sentence in found) == 1
    listed = found[-1].partition("the file has ")[2].rstrip(".").split(", ")
    assert sorted(listed) == sorted(names) and set(listed[:3]) == {"motor_pos_1", "torque_1", "torque_2"}


# Good files that look odd


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: ("﻿" + "\n".join(lines)).encode(),
        lambda lines: "\r\n".join(lines).encode(),
        lambda lines: "\r".join(lines).encode(),
        lambda lines: "\n".join(lines).replace(",", ";").replace(".", ",").encode(),
        lambda lines: "\n".join(lines).replace(",", ";").encode(),
        lambda lines: "\n".join(lines).replace(",", "\t").encode(),
        lambda lines: ("# " + "\n".join(lines)).encode(),
        lambda lines: ("# recorded on a Monday\n\n" + "\n".join(lines)).encode(),
        lambda lines: "\n".join(line.replace(",", " , ") for line in lines).encode(),
        lambda lines: "\n".join([",".join(f'"{c}"' for c in lines[0].split(",")), *lines[1:]]).encode(),
        lambda lines: "\n".join(f"{k or ''},{line}" for k, line in enumerate(lines)).encode(),
        lambda lines: "\n".join([lines[0] + ",mode", *(line + ",auto \xb0" for line in lines[1:])]).encode("latin-1"),
        lambda lines: ("\n".join(lines) + "\n\n\n").encode(),
    ],
    ids=[
        "bom", "crlf", "cr", "decimal commas", "semicolons", "tabs", "savetxt", "comment", "spaces", "quotes", "index",
        "text", "end",
    ],
)  # fmt: skip
def test_a_csv_in_another_dress_is_the_same_log(tmp_path: Path, change: Callable[[list[str]], bytes]) -> None:
    lines = [HEADER, *rows()]
    path = tmp_path / "log.csv"
    path.write_bytes(change(lines))
    log = read(path)
    assert np.array_equal(log.time, np.array([float(f"{k * 1e-3:.6f}") for k in range(8)]))
    assert np.array_equal(log["motor_current_1"], np.array([float(f"{0.1 * k:.3f}") for k in range(8)]))
    assert np.array_equal(log["joint_position_1"], np.array([float(f"{0.01 * k:.4f}") for k in range(8)]))


def test_decimal_commas_and_unused_columns_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([HEADER + ",spare", *(r + ",1" for r in rows())]).replace(",", ";").replace(".", ","))
    notes = " ".join(read(path).notes)
    assert "Decimal commas were read" in notes and "Columns not used: spare" in notes


# Parquet


def parquet(tmp_path: Path, **columns: object) -> Path:
    """A Parquet file with these columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(columns), path, write_page_checksum=True)
    return path


def test_other_types_of_a_parquet_become_numbers(tmp_path: Path) -> None:
    import pyarrow as pa

    stamps = np.datetime64("2024-05-01T12:00:00", "ns") + np.arange(5) * np.timedelta64(2_000_000, "ns")
    path = parquet(
        tmp_path,
        time=pa.array(stamps),
        motor_current_1=pa.array([1, 2, 3, 4, 200], pa.uint8()),
        joint_position_1=pa.array([True, False, True, False, True]),
        label=pa.array(list("abcde")),
    )
    log = read(path)
    assert np.allclose(log.time, np.arange(5) * 2e-3, rtol=0, atol=1e-15)
    assert list(log["motor_current_1"]) == [1, 2, 3, 4, 200] and list(log["joint_position_1"]) == [1, 0, 1, 0, 1]
    assert any("time holds timestamp[ns]: taken as seconds from its first row" in note for note in log.notes)


def test_text_and_nulls_in_a_parquet_are_named(tmp_path: Path) -> None:
    import pyarrow as pa

    time = pa.array(np.arange(3) * 1e-3)
    path = parquet(tmp_path, time=time, motor_current_1=pa.array(["1", "2", "3"]), joint_position_1=time)
    assert "column motor_current_1 holds string, not numbers" in one(path)
    path = parquet(tmp_path, time=time, motor_current_1=pa.array([1.0, None, 3.0]), joint_position_1=time)
    assert "row 2: column motor_current_1 has no value in 1 row(s)" in one(path)
    path = parquet(tmp_path, time=pa.array([], pa.float64()), motor_current_1=pa.array([], pa.float64()))
    assert any("there are no rows" in sentence for sentence in problems(path))


def test_a_damaged_parquet_is_refused_or_right(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    random = np.random.default_rng(5)
    values = random.standard_normal(500)
    write({"time": np.arange(500) * 1e-3, "motor_current_1": values, "joint_position_1": values}, path)
    content = path.read_bytes()
    refused = 0
    for _ in range(300):
        damaged = bytearray(content)
        damaged[int(random.integers(0, len(content)))] ^= 1 << int(random.integers(0, 8))
        path.write_bytes(damaged)
        try:
            log = read(path)
        except LogError:
            refused += 1
        else:
            assert np.array_equal(log["motor_current_1"], values)
    assert refused > 250
    path.write_bytes(content[: len(content) // 2])
    assert "not a readable Parquet file" in one(path)


# columns.toml


def test_units_signs_scales_and_offsets(tmp_path: Path) -> None:
    log = mapped(
        tmp_path,
        "stamp,i,volt,q,qd,temp,tau,unused\n0,100,1.5,90,6,20,600,7\n2,-200,-2,180,12,21.5,-60,7\n4,50,0,-90,0,22,0,7",
        """
        [time]
        from = "stamp"
        unit = "ms"
        [motor_current_1]
        from = "i"
        unit = "mA"
        sign = -1
        [motor_torque_command_1]
        from = "volt"
        unit = "V"
        scale = 35.15
        [joint_position_1]
        from = "q"
        unit = "deg"
        offset = 0.25
        [motor_velocity_1]
        from = "qd"
        unit = "rpm"
        [motor_temperature_1]
        from = "temp"
        unit = "°C"
        [motor_torque_1]
        from = "tau"
        unit = "mNm"
        joint_side_ratio = 6
        """,
    )
    assert np.allclose(log.time, [0, 0.002, 0.004], rtol=1e-15)
    assert np.allclose(log["motor_current_1"], [-0.1, 0.2, -0.05], rtol=1e-15)
    assert np.allclose(log["motor_torque_command_1"], [1.5 * 35.15, -2 * 35.15, 0], rtol=1e-15)
    assert np.allclose(log["joint_position_1"], [np.pi / 2 + 0.25, np.pi + 0.25, 0.25 - np.pi / 2], rtol=1e-15)
    assert np.allclose(log["motor_velocity_1"], [0.2 * np.pi, 0.4 * np.pi, 0], rtol=1e-15)
    assert np.allclose(log["motor_temperature_1"], [293.15, 294.65, 295.15], rtol=1e-15)
    assert np.allclose(log["motor_torque_1"], [0.1, -0.01, 0], rtol=1e-15)
    notes = " ".join(log.notes)
    assert "motor_torque_1 is tau" in notes and "ratio 6" in notes and "Columns not used: unused" in notes


def test_a_wrapped_counter_at_joint_scale_becomes_the_motors_angle(tmp_path: Path) -> None:
    true = np.linspace(-7.0, 9.0, 161)  # turns
    lines = [f"{k * 1e-3},0,{int(np.floor(turns * 4096)) % 4096}" for k, turns in enumerate(true)]
    toml = """
        [motor_position_1]
        from = "encoder"
        unit = "counts"
        counts_per_turn = 4096
        wrap = "turn"
        joint_side_ratio = 100
        """
    log = mapped(tmp_path, "\n".join(["time,motor_current_1,encoder", *lines]), toml)
    moved = log["motor_position_1"] - log["motor_position_1"][0]
    assert np.allclose(moved, 100 * 2 * np.pi * (true - true[0]), rtol=0, atol=100 * 2 * np.pi / 4096)
    log = mapped(tmp_path, "\n".join(["time,motor_current_1,encoder", *lines]), toml.replace('"turn"', "4096"))
    assert np.array_equal(log["motor_position_1"] - log["motor_position_1"][0], moved)


@pytest.mark.parametrize("wrap", ['wrap = "turn"', "wrap = 6.283185307179586"])
def test_an_angle_that_wraps_is_unwrapped(tmp_path: Path, wrap: str) -> None:
    true = np.linspace(0, 20, 200)
    lines = [f"{k * 1e-3},0,{q % (2 * np.pi)!r}" for k, q in enumerate(true.tolist())]
    log = mapped(tmp_path, "\n".join([HEADER, *lines]), f"[joint_position_1]\n{wrap}")
    assert np.allclose(log["joint_position_1"], true, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shift", [1, -1, 3, -2])
def test_a_shifted_column_moves_by_rows_and_the_ends_are_cut_everywhere(tmp_path: Path, shift: int) -> None:
    lines = "\n".join([HEADER, *rows(10)])
    log = mapped(tmp_path, lines, f"[motor_current_1]\nshift_rows = {shift}")
    whole = read(csv(tmp_path, HEADER, *rows(10)))
    here = slice(max(shift, 0), 10 + min(shift, 0))
    there = slice(max(-shift, 0), 10 - max(shift, 0))
    assert np.array_equal(log.time, whole.time[here])
    assert np.array_equal(log["joint_position_1"], whole["joint_position_1"][here])
    assert np.array_equal(log["motor_current_1"], whole["motor_current_1"][there])
    assert any(f"{abs(shift)} row(s) at the ends were cut" in note for note in log.notes)


def test_missing_values_are_filled_where_that_is_declared(tmp_path: Path) -> None:
    lines = [
        HEADER,
        "0,,",
        "0.001,7,",
        "0.002,2,1",
        "0.003,,",
        "0.004,,",
        "0.005,8,4",
        "0.006,9,",
        "0.007,,6",
        "0.008,1,",
    ]
    toml = '[motor_current_1]\nfill = "hold"\n[joint_position_1]\nfill = "linear"'
    log = mapped(tmp_path, "\n".join(lines), toml)  # the ends, where nothing can be filled in, are cut
    assert np.allclose(log.time, [0.002, 0.003, 0.004, 0.005, 0.006, 0.007])
    assert list(log["motor_current_1"]) == [2, 2, 2, 8, 9, 9]
    assert list(log["joint_position_1"]) == [1, 2, 3, 4, 5, 6]
    assert any("6 missing value(s) filled (linear)" in note for note in log.notes)


def test_constants_differences_and_a_time_that_is_not_logged(tmp_path: Path) -> None:
    log = mapped(
        tmp_path,
        "i,a1,a2\n1,10,30\n2,20,50\n3,30,20",
        """
        [time]
        period = 0.004
        [motor_current_1]
        from = "i"
        [joint_position_1]
        from = "a1"
        unit = "deg"
        [motor_current_2]
        value = 0.0
        [joint_position_2]
        from = "a2"
        subtract = "a1"
        unit = "deg"
        """,
    )
    assert list(log.time) == [0, 0.004, 0.008] and list(log["motor_current_2"]) == [0, 0, 0]
    assert np.allclose(log["joint_position_2"], np.deg2rad([20, 30, -10]), rtol=1e-14)


def test_columns_can_be_ignored_and_those_named_right_need_no_entry(tmp_path: Path) -> None:
    lines = "\n".join([HEADER + ",motor_position_1", *(r + ",broken" for r in rows())])
    log = mapped(tmp_path, lines, 'ignore = ["motor_position_1"]')
    assert list(log.columns) == ["motor_current_1", "joint_position_1"]


def test_a_tip_force_is_turned_into_the_base_frame(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    q, force = random.uniform(-3, 3, (6, 2)), random.uniform(-9, 9, (6, 2))
    header = "time,motor_current_1,joint_position_1,motor_current_2,joint_position_2,tip_force_x,tip_force_y"
    lines = [
        f"{k * 1e-3},0,{q[k, 0].item()!r},0,{q[k, 1].item()!r},{force[k, 0].item()!r},{force[k, 1].item()!r}"
        for k in range(6)
    ]
    text = "\n".join([header, *lines])

    def turned(angles: np.ndarray) -> np.ndarray:
        return np.array(
            [
                [np.cos(a) * x - np.sin(a) * y, np.sin(a) * x + np.cos(a) * y]
                for a, (x, y) in zip(angles, force, strict=True)
            ]
        )

    for toml, angles in (
        ('[tip_force]\nframe = "tip"', q.sum(axis=1)),
        ('[tip_force]\nframe = "tip"\nrotation = 0.3', q.sum(axis=1) + 0.3),
        ('[tip_force]\nframe = "tip"\nturning_joints = [2]', q[:, 1]),
        ("[tip_force]\nrotation = -0.7", np.full(6, -0.7)),
    ):
        log = mapped(tmp_path, text, toml)
        got = np.column_stack([log["tip_force_x"], log["tip_force_y"]])
        assert np.allclose(got, turned(angles), rtol=0, atol=1e-13)
    with pytest.raises(ColumnsError, match="needs tip_force_x, tip_force_y"):
        mapped(tmp_path, "\n".join([HEADER, *rows()]), '[tip_force]\nframe = "tip"')


BAD_COLUMNS = """
ignore = "motor_current_2"
joint_position_3 = "q"
[motor_curent_1]
from = "i"
[time]
unit = "fortnight"
sign = -1
[motor_current_1]
unit = "V"
sign = 2
colour = "red"
from = ""
[motor_position_1]
unit = "counts"
wrap = -1
offset = nan
joint_side_ratio = 0
shift_rows = 1.5
[motor_position_2]
unit = "V"
scale = 2
wrap = "turn"
[joint_torque_1]
value = 0.0
unit = "N m"
[joint_velocity_1]
wrap = 3
fill = "magic"
[tip_force]
frame = "moon"
rotation = "north"
turning_joints = [0]
angle = 1
"""


def test_everything_wrong_with_a_columns_toml_is_said_at_once(tmp_path: Path) -> None:
    columns = tmp_path / "columns.toml"
    columns.write_text(BAD_COLUMNS)
    with pytest.raises(ColumnsError) as raised:
        read(csv(tmp_path, HEADER, *rows()), columns)
    expected = [
        "ignore must be a list of column names",
        "joint_position_3 must be a table",
        "[motor_curent_1] is not a column of a log (did you mean motor_current_1?)",
        "[time] unit = 'fortnight'; possible are s, ms, us, ns, min",
        "[time] has no key sign; possible are from",
        "[motor_current_1] has unit = 'V' without a scale; add scale = how many A one V is",
        "[motor_current_1] sign = 2; it must be 1 or -1",
        "[motor_current_1] has no key colour",
        "[motor_current_1] from = ''; it must be the name of a column",
        "[motor_position_1] has unit = 'counts'; add counts_per_turn",
        '[motor_position_1] wrap = -1; it must be "turn" or a positive number',
        "[motor_position_1] offset = nan; it must be a finite number",
        "[motor_position_1] joint_side_ratio = 0; it must be the ratio",
        "[motor_position_1] shift_rows = 1.5; it must be a whole number",
        '[motor_position_2] wrap = "turn" has no meaning with unit = "V"',
        "[joint_torque_1] has value and unit",
        "[joint_velocity_1] has no key wrap",
        '[joint_velocity_1] fill = \'magic\'; it must be "hold" or "linear"',
        "[tip_force] frame = 'moon'",
        "[tip_force] rotation = 'north'",
        "[tip_force] turning_joints = [0]",
        "[tip_force] has no key angle",
    ]
    found = raised.value.problems
    for part in expected:
        assert sum(part in sentence for sentence in found) == 1, part
    assert len(found) == len(expected) and all(sentence.startswith(str(columns)) for sentence in found)


def test_columns_that_are_not_in_the_log_are_all_named(tmp_path: Path) -> None:
    columns = tmp_path / "columns.toml"
    columns.write_text('[motor_torque_1]\nfrom = "taau"\n[motor_position_1]\nfrom = "q"\nsubtract = "zero"\n')
    path = csv(tmp_path, "time,tau,q", *rows())
    found = problems(path, columns)
    assert len(found) == 3
    assert "[motor_torque_1] takes column 'taau', not in the log (did you mean tau?)" in found[0]
    assert found[1].endswith("[motor_position_1] takes column 'zero', not in the log.")
    assert found[2].endswith(": the log has tau, time, q.")


@pytest.mark.parametrize(
    "content", [b"[time\n", b"\xff\xfe[time]", b"a = 1\na = 2\n", b"[time]\nscale = 1" + b"0" * 400]
)
def test_a_broken_columns_toml_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    columns = tmp_path / "columns.toml"
    columns.write_bytes(content)
    with pytest.raises(ColumnsError) as raised:
        read(csv(tmp_path, HEADER, *rows()), columns)
    assert len(raised.value.problems) == 1 and str(columns) in raised.value.problems[0]
    with pytest.raises(ColumnsError, match="cannot be read"):
        read(csv(tmp_path, HEADER, *rows()), tmp_path / "none.toml")


def test_the_examples_of_the_documentation_are_valid() -> None:
    text = (EXAMPLES.parent / "guides" / "bring_your_log.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    assert blocks
    for path in EXAMPLES.glob("*/columns*.toml"):
        blocks.append(path.read_text(encoding="utf-8"))
    assert len(blocks) >= 5
    used = set()
    for block in blocks:
        used |= {key for table in tomllib.loads(block).values() if isinstance(table, dict) for key in table}
        column_map_file.build_column_map(tomllib.loads(block), Path("columns.toml"))
    table_of_keys = set(re.findall(r"`(\w+)`", " ".join(re.findall(r"^\| (`.*?) \|", text, re.MULTILINE))))
    assert used | {"period"} >= column_map_file.COLUMN_KEYS and table_of_keys >= column_map_file.COLUMN_KEYS


# Real machines, through the examples of the documentation


def difference(values: np.ndarray) -> np.ndarray:
    """Derivative at 1 kHz of the mean of two samples, as the EMPS controller takes it."""
    before = np.concatenate(([values[0]], values[:-1]))
    mean = (values + before) / 2
    return np.diff(mean, prepend=mean[0]) * 1e3


@pytest.mark.parametrize(
    ("file", "columns", "rms"),
    [("DATA_EMPS.mat", "columns.toml", 0.0106), ("DATA_EMPS_PULSES.mat", "columns_pulses.toml", 0.0108)],
)
def test_emps_obeys_its_own_control_law(data_dir: Path, file: str, columns: str, rms: float) -> None:
    path = data_dir / "real" / "emps" / file
    if not path.exists():
        pytest.skip(f"{path} is not there")
    log = read(path, EXAMPLES / "emps" / columns, joints=1)
    assert len(log) == 24841 and log.period == pytest.approx(1e-3, rel=1e-4)
    volts = log["motor_torque_command_1"] / 35.15065188248547
    position, reference = log["joint_position_1"], log["joint_position_reference_1"]
    control = 243.45 * (160.18 * (reference - position) - difference(position))
    pulses = read_mat(path).get("pulses_N", np.zeros(len(log)))
    assert pulses.dtype == np.float64 and pulses.sum() in (0.0, 5.0 * np.count_nonzero(pulses))
    gain = 1.0 if not pulses.any() else float((volts - control) @ pulses / (pulses @ pulses))
    assert gain == pytest.approx(1.014 if pulses.any() else 1.0, abs=1e-3)  # volts, and already inside the command
    assert np.sqrt(np.mean((volts - control - gain * pulses)[10:] ** 2)) < rms


def test_dfki_torques_come_to_the_motor(data_dir: Path) -> None:
    paths = sorted((data_dir / "real" / "dfki_double_pendulum").glob("**/trajectory.csv"))
    if not paths:
        pytest.skip("the double pendulum's logs are not there")
    for path in paths[:2] + paths[-1:]:
        log = read(path, EXAMPLES / "dfki" / "columns.toml", joints=2)
        table = np.genfromtxt(path, delimiter=",", names=True)
        assert np.array_equal(log.logged_time, table["time"])
        for joint in (1, 2):
            assert np.allclose(log[f"motor_torque_command_{joint}"], table[f"tau_con{joint}"] / 6, rtol=1e-15, atol=0)
            assert np.array_equal(log[f"joint_position_{joint}"], table[f"pos_meas{joint}"])
            assert np.array_equal(log[f"joint_velocity_{joint}"], table[f"vel_meas{joint}"])
