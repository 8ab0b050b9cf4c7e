"""What comes from outside: files that are none, too large or hostile, and a command that ends in a sentence whatever
happens."""

from __future__ import annotations

import errno
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import hdagen
from gen import __main__ as gen_command
from gen.builder.compiler import CompileError, find_compiler
from gen.robot.description import RobotError
from gen.robot.load_robot import load as load_robot
from hdagen import __main__ as command
from hdagen.adoption import verdict
from hdagen.arm.build_loader import MOST_ERROR_LINES, PlantError
from hdagen.blind import calibrate
from hdagen.diagnosis.decision import calibration
from hdagen.fleet import fleet_file
from hdagen.log import data_table
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import read, write
from hdagen.mpc import configuration
from hdagen.prediction import closed_loop_replay
from hdagen.support import input_file
from hdagen.support.messages import join_names, make_printable, show_path, show_value

ROOT = Path(__file__).parents[2]
LOG = {name: np.sin(np.arange(60) / 7) for name in ("motor_current_1", "joint_position_1")}
REFUSALS = (LogError, PlantError, RobotError, calibration.CalibrationError)
READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "csv": (".csv", read),
    "parquet": (".parquet", read),
    "mat": (".mat", read),
    "columns": (".toml", lambda path: read(good(path.parent), path)),
    "robot": (".toml", load_robot),
    "fleet": (".toml", fleet_file.read_fleet),
    "controller": (".toml", closed_loop_replay.read_controller),
    "predictive": (".toml", configuration.read_configuration),
    "diagnosis": (".json", verdict.read_verdict),
    "calibration": (".json", calibration.read),
    "cases": (".json", lambda path: calibrate.freeze_calibration([path], Path("never"))),
}


def good(folder: Path) -> Path:
    """A log that is read."""
    path = folder / "good.csv" if folder.is_dir() else Path("good.csv")
    write({"time": np.arange(60) / 1000, **LOG}, path)
    return path


def sentence(read_: Callable[[Path], object], path: Path) -> str:
    """Why a file is refused, within a second or two and in lines that can be printed."""
    begun = time.monotonic()
    with pytest.raises(REFUSALS) as raised:
        read_(path)
    assert time.monotonic() - begun < 10
    said = str(raised.value)
    assert said and all(line.isprintable() for line in said.split("\n"))
    assert len(said) < 50_000
    return said


# -- the gate ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", READERS)
def test_what_is_no_regular_file_is_refused_unopened(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    suffix, read_ = READERS[kind]
    os.mkfifo(tmp_path / f"pipe{suffix}")
    (tmp_path / f"endless{suffix}").symlink_to("/dev/zero")
    (tmp_path / f"folder{suffix}").mkdir()
    (tmp_path / f"loop{suffix}").symlink_to(tmp_path / f"loop{suffix}")
    for name in ("pipe", "endless", "folder", "loop"):
        assert name in sentence(read_, tmp_path / f"{name}{suffix}")
    for path in (f"a\0b{suffix}", "x" * 5000 + suffix, f"gone\x1b[31m\n{suffix}"):
        sentence(read_, Path(path))


TEXTS = {
    "lists": b"a=" + b"[" * 40_000,
    "tables": b"a=" + b"{a=" * 20_000,
    "long key": b".".join([b"a"] * 40_000) + b"=1",
    "long key in quotes": b".".join([b'"a,"'] * 15_000) + b"=1",
    "many keys": "".join(f"k{k}=1\n" for k in range(11_000)).encode(),
    "digits": b"[time]\nscale=" + b"9" * 5000,
    "more digits": b"[time]\nscale=0x" + b"f" * 50_000,
    "escapes": b'"\\u001b[31m"="\\u001b[31m\\n"',
    "no text": b"\xff\xfe\x00",
    "a large comment": b"a=1#" + b"x" * 2_000_000,
}


@pytest.mark.parametrize("kind", [kind for kind, (suffix, _) in READERS.items() if suffix == ".toml"])
@pytest.mark.parametrize("text", TEXTS)
def test_hostile_toml_is_refused_in_one_breath(kind: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "hostile.toml"
    path.write_bytes(TEXTS[text])
    assert "hostile.toml" in sentence(READERS[kind][1], path)


@pytest.mark.parametrize("kind", ["diagnosis", "calibration", "cases"])
@pytest.mark.parametrize(
    "text",
    [
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b'{"schema":' + b"9" * 5000 + b"}",
        b'{"schema":"\\u001b[31m"}',
        b'{"schema":2,"verdict":[],"causes":' + b"[" + b"3," * 90_000 + b"3]}",
        b"\xff\xfe",
        b" " * 11_000_000,
    ],
)
def test_hostile_json_is_refused_in_one_breath(kind: str, text: bytes, tmp_path: Path) -> None:
    path = tmp_path / "hostile.json"
    path.write_bytes(text)
    assert "hostile.json" in sentence(READERS[kind][1], path)


def test_a_file_that_grows_while_it_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(b"x" * 11)
    monkeypatch.setattr(input_file, "check_file", lambda *_: 0)
    with pytest.raises(input_file.InputFileError, match="found more than 10 bytes; shorten it"):
        input_file.read_bytes(path, 10, "shorten it")


CAUSE = {"effect": "viscous_friction", "joint": 1, "parameters": {"viscous_friction": {"value": 2e-4, "std": 1e-5}}}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"causes": CAUSE}, "causes: found .*, possible is a list"),
        ({"causes": [CAUSE | {"parameters": {"viscous_friction": {"value": 1.0, "std": 10**400}}}]}, "std: found 1000"),
        ({"verdict": ["viscous_friction@1", "viscous_friction@01"]}, "possible is name@joint"),
        ({"verdict": ["viscous_friction@1", "viscous_friction@1"]}, "stands there twice"),
        ({"verdict": ["unknown@1"] * 100_000}, "found 100000 effects"),
    ],
)
def test_a_diagnosis_of_another_shape_is_refused(changes: dict, words: str, tmp_path: Path) -> None:
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps({"schema": 2, "verdict": ["viscous_friction@1"], "causes": [CAUSE]} | changes))
    with pytest.raises(PlantError, match=words):
        verdict.read_verdict(path)


# -- what is printed --------------------------------------------------------------------------------------------------


def test_names_are_printed_escaped_and_short() -> None:
    assert (
        make_printable("a\x1b[31m\n\u202eb") == "a\\x1b[31m\\n\\u202eb"
        and make_printable("Prüfstand µ") == "Prüfstand µ"
    )
    assert make_printable(os.fsdecode(b"\xff")) == "\\udcff"
    assert show_value("\n") == "'\\\\n'" or show_value("\n") == "'\\n'"
    assert len(show_value("x" * 1000)) == 60 and show_value(16**6000) == "a number of thousands of digits"
    assert len(show_path("x" * 5000)) < 250 and join_names(["a\x07", "b" * 300]) == f"a\\x07, {'b' * 80}"


def test_a_header_and_a_name_with_escapes_do_not_reach_the_terminal(tmp_path: Path) -> None:
    path = tmp_path / "log\n\x1b[2J.csv"
    rows = "".join(f"{k / 1000},{k % 3},{k},0\n" for k in range(30))
    path.write_text("time,motor_current_1,joint_position_1,\x1b[31mEVIL\x07\n" + rows)
    log = read(path)
    assert all(note.isprintable() for note in log.notes) and "\\x1b[31mEVIL\\x07" in " ".join(log.notes)
    assert log.source.isprintable()
    path.write_text("zeit,\x1b[31mEVIL\x07\n" + "1,2\n" * 30)
    assert "\\x1b[31mEVIL\\x07" in sentence(read, path)


def test_of_very_many_problems_the_first_are_said() -> None:
    assert LogError(["a"] * 1000).problems[-1] == "900 more problems are not listed: mend these first."
    lines = str(PlantError("\n".join(["a\x1b"] * 1000))).split("\n")
    assert lines[0] == "a\\x1b" and len(lines) == MOST_ERROR_LINES + 1 and lines[-1].startswith("800 more")


# -- budgets ----------------------------------------------------------------------------------------------------------


def csv(folder: Path, header: str, *rows: str) -> Path:
    path = folder / "log.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


HEADER = "time,motor_current_1,joint_position_1"
ROWS = [f"{k / 1000},{k % 3},{math.sin(k)}" for k in range(40)]


def test_columns_are_counted_before_anything_is_read_and_thousands_are_read_at_once(tmp_path: Path) -> None:
    more = ",".join(f"c{k}" for k in range(100_000))
    begun = time.process_time()
    with pytest.raises(LogError, match="found 100003 columns, possible are 10000"):
        read(csv(tmp_path, f"{HEADER},{more}", *(f"{row}{',0' * 100_000}" for row in ROWS[:3])))
    more = ",".join(f"c{k}" for k in range(9990))
    assert len(read(csv(tmp_path, f"{HEADER},{more}", *(f"{row}{',0' * 9990}" for row in ROWS)))) == 40
    with pytest.raises(
        LogError, match=r"column motor_current_2 stands 9000 times in the header \(columns 4, 5, .* more"
    ):
        read(csv(tmp_path, HEADER + ",motor_current_2" * 9000, *(row + ",0" * 9000 for row in ROWS)))
    assert time.process_time() - begun < 10


@pytest.mark.parametrize(
    ("header", "rows", "words"),
    [
        (HEADER + "," + "x" * 1_100_000, ROWS, "no header ends in the first 1048576 bytes"),
        ("#\n" * 600_000 + HEADER, ROWS, "no header ends in the first 1048576 bytes"),
        (HEADER + "," + "x" * 140_000, [f"{row},0" for row in ROWS], "the name of a column is longer than 131072"),
        (HEADER, ["a" * 140_000 + ",1,2", *ROWS], "line 2: a cell is longer than 131072"),
        (HEADER, ["0," + "1" * 130_000 + "x,2", *ROWS], "line 2, column motor_current_1: '1111"),
        (HEADER, [*ROWS, "1" * 3_000_000], "line 42: there is no end of the line, in 1048576 characters"),
        (HEADER, [*ROWS, "\0" * 3_000_000 + "1"], "line 42: there is nothing but zeros, in 1048576 characters"),
        (HEADER, [*ROWS, "\0" * 10_000, "\0" * 5000], "the file ends in zero bytes"),
        (HEADER, ["x,x,x"] * 20_000, "there are more, and what follows line 33.. was not looked at"),
    ],
)
def test_the_true_cause_is_said_of_what_is_too_long(header: str, rows: list[str], words: str, tmp_path: Path) -> None:
    path = csv(tmp_path, header, *rows)
    if words.startswith("the file ends"):
        path.write_bytes(path.read_bytes()[:-1].replace(b"\0\n", b"\0\0"))
    begun = time.process_time()
    with pytest.raises(LogError, match=words):
        read(path)
    assert time.process_time() - begun < 10


def test_a_sparse_tail_costs_nothing(tmp_path: Path) -> None:
    path = csv(tmp_path, HEADER, *ROWS)
    os.truncate(path, 3 << 30)
    with pytest.raises(LogError, match="ends in zero bytes, as a crash leaves them"):
        read(path)
    (tmp_path / "zeros.csv").touch()
    os.truncate(tmp_path / "zeros.csv", 3 << 30)
    with pytest.raises(LogError, match="nothing but zero bytes"):
        read(tmp_path / "zeros.csv")
    os.truncate(path, 5 << 30)
    with pytest.raises(LogError, match="found 5368709120 bytes, possible are at most"):
        read(path)


def test_cells_are_counted_before_they_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = 40_000_000  # of zeros, in some kilobytes
    zeros = pa.array(np.zeros(rows))
    pq.write_table(
        pa.table({"time": zeros, "motor_current_1": zeros, "joint_position_1": zeros}), tmp_path / "a.parquet"
    )
    with pytest.raises(LogError, match="found 40000000 rows of 3 columns in use, possible are 100000000 cells; cut"):
        read(tmp_path / "a.parquet")
    monkeypatch.setattr("hdagen.log.data_table._MOST_UNPACKED_BYTES", 1000)
    write({"time": np.arange(60) / 1000, **LOG}, tmp_path / "b.parquet")
    with pytest.raises(LogError, match=r"unpacks to \d+ bytes, possible are 1000"):
        read(tmp_path / "b.parquet")
    monkeypatch.setattr("hdagen.log.data_table._MOST_FOOTER_BYTES", 100)
    with pytest.raises(LogError, match=r"its columns are described in \d+ bytes"):
        read(tmp_path / "b.parquet")
    monkeypatch.setattr("hdagen.log.csv_file.MOST_CELLS", 10)
    monkeypatch.setattr("hdagen.log.data_table.MOST_CELLS", 10)
    with pytest.raises(LogError, match="found 41 rows of 3 columns in use, possible are 10 cells"):
        read(csv(tmp_path, HEADER, *ROWS))
    path = tmp_path / "log.csv"
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r"))  # as an old program ends its lines
    with pytest.raises(LogError, match="found 41 rows"):
        read(path)


def test_memory_that_is_not_there_is_no_damaged_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise MemoryError

    write({"time": np.arange(60) / 1000, **LOG}, tmp_path / "a.parquet")
    monkeypatch.setattr(data_table, "convert_to_float", full)
    with pytest.raises(LogError, match="not enough memory to read it"):
        read(tmp_path / "a.parquet")


# -- gaps at the edges ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("empty", "words"),
    [
        ([0], r"row 1 \(line 2\): column motor_current_1 has no value in 1 row\(s\), up to 1 together"),
        ([0, 1, 2, 9], r"row 1 \(line 2\): .* in 4 row\(s\), up to 3 together"),
        ([5, 38, 39], r"row 6 \(line 7\): .* in 3 row\(s\), up to 2 together"),
        ([0, 39], r"row 1 \(line 2\): .* in 2 row\(s\), up to 1 together"),
        (list(range(40)), r'has no value in any row: leave it out with ignore = \["motor_current_1"\]'),
    ],
)
def test_a_gap_at_an_edge_is_a_gap(empty: list[int], words: str, tmp_path: Path) -> None:
    rows = [f"{k / 1000},{'' if k in empty else 1},{math.sin(k)}" for k in range(40)]
    path = csv(tmp_path, HEADER, *rows)
    with pytest.raises(LogError, match=words):
        read(path)
    assert np.flatnonzero(np.isnan(read(path, holes=True)["motor_current_1"])).tolist() == empty


def test_the_row_of_a_gap_is_the_file_s_where_repeated_rows_were_dropped(tmp_path: Path) -> None:
    (tmp_path / "columns.toml").write_text('[time]\nunit = "s"\nduplicates = "first"\n')
    rows = [f"{k / 1000},{k % 3},{math.sin(k)}" for k in (0, 1, 1, 1, 2, 3, 9, 10)]
    log = read(csv(tmp_path, HEADER, *rows), tmp_path / "columns.toml")
    assert any("is 0.006 s after row 6 (line 7)" in note for note in log.notes)


# -- inputs before work -----------------------------------------------------------------------------------------------


@pytest.fixture
def no_builds(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder to work in, where a build would be a fault."""

    def never(*_: object, **__: object) -> None:
        raise AssertionError("a model was asked for")

    monkeypatch.chdir(tmp_path)
    for module in ("arm.compiled_arm", "adoption.verdict", "adoption.robot_update", "diagnosis.data.models"):
        monkeypatch.setattr(f"hdagen.{module}.load", never)
    good(tmp_path)
    for name, text in {
        "bad.toml": "a = [",
        "bad.json": "{",
        "log.xls": "a",
        "robot.toml": "",
        "notes.csv": "x",
    }.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("replay paper gone.csv", "gone.csv: cannot be read (there is no such file)"),
        ("replay paper log.xls", "no log ends in '.xls'"),
        ("replay paper notes.csv", "notes.csv: the file has a header"),
        ("replay paper good.csv --columns bad.toml", "bad.toml: cannot be read as TOML"),
        ("replay paper good.csv --with bad.json", "bad.json: cannot be read as JSON"),
        ("replay paper good.csv --closed-loop bad.toml", "bad.toml: cannot be read as TOML"),
        ("replay paper good.csv --out gone/a.csv", "there is no folder"),
        ("diagnose paper good.csv --hold-out gone.csv", "gone.csv: cannot be read"),
        ("diagnose paper gone.csv", "gone.csv: cannot be read"),
        ("diagnose paper log.xls", "no log ends in '.xls'"),
        ("diagnose paper good.csv --columns bad.toml", "bad.toml: cannot be read as TOML"),
        ("diagnose --fleet fleet.toml", "machine 1: log = 'log.xls': log.xls: no log ends in '.xls'"),
        ("diagnose --fleet fleet.toml", "machine 1: columns = 'bad.toml': "),
        ("mpc explain gone.parquet", "gone.mpc.parquet: cannot be read"),
        ("mpc header --config bad.toml", "bad.toml: cannot be read as TOML"),
        ("mpc reference --config bad.toml", "bad.toml: cannot be read as TOML"),
        ("simulate paper --controller mpc --config bad.toml", "bad.toml: cannot be read as TOML"),
        ("simulate paper --config bad.toml", "--config is of the predictive controller"),
        ("simulate paper --gain stiffness_x=stiff", "NAME=VALUE with a number"),
        ("simulate paper --out gone/a.csv", "there is no folder"),
        ("simulate paper --out a.xls", "possible are .csv and .parquet"),
        ("excite paper --out gone/a.csv", "there is no folder"),
        ("excite paper --limits speed=fast", "with numbers"),
        ("adopt gone.json robot.toml --out a.toml", "gone.json: cannot be read"),
        ("adopt bad.json gone.toml --out a.toml", "gone.toml: cannot be read"),
    ],
)
def test_inputs_are_looked_at_before_a_model_is_built(
    arguments: str, words: str, no_builds: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (no_builds / "fleet.toml").write_text('[[machine]]\nrobot = "paper"\nlog = "log.xls"\ncolumns = "bad.toml"\n')
    assert command.main(arguments.split()) in (command.USAGE, command.UNUSABLE)
    said = capsys.readouterr().err
    assert words in said.replace(f"{no_builds}/", "")
    assert "a model was asked for" not in said


# -- the last handler -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (
            RuntimeError("all\nwrong\x1b"),
            command.UNFORESEEN_ERROR,
            "did not foresee (RuntimeError: all); HDAGEN_TRACEBACK=1",
        ),
        (ValueError("\x1b[2J"), command.UNFORESEEN_ERROR, "(ValueError: \\x1b[2J)"),
        (MemoryError(), command.UNUSABLE, "not enough memory"),
        (RecursionError("deep"), command.UNFORESEEN_ERROR, "RecursionError"),
        (
            OSError(errno.ENOSPC, "No space left on device"),
            command.USAGE,
            "standard output: cannot be written (No space",
        ),
        (
            OSError(errno.ENOSPC, "No space left", "a\n.csv"),
            command.USAGE,
            "a\\n.csv: cannot be written (No space left)",
        ),
        (OSError(errno.EMFILE, "Too many open files"), command.USAGE, "`ulimit -n`"),
        (OSError(errno.EAGAIN, "Try again"), command.USAGE, "no process or memory"),
        (
            PermissionError(errno.EACCES, "Permission denied", "x"),
            command.USAGE,
            "x: cannot be used (Permission denied)",
        ),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), command.OUTPUT_CLOSED, ""),
        (KeyboardInterrupt(), command.INTERRUPTED, "interrupted"),
    ],
)
def test_whatever_happens_ends_in_a_sentence_and_a_code(
    error: BaseException, code: int, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_: object) -> None:
        raise error

    monkeypatch.delenv(command.TRACEBACK_VARIABLE, raising=False)
    monkeypatch.setattr("hdagen.cli.paper.run", broken)
    assert command.main(["paper", "list"]) == code
    said = capsys.readouterr().err
    assert words in said and said.count("\n") == bool(words) and said.rstrip("\n").isprintable()
    if code == command.UNFORESEEN_ERROR:
        monkeypatch.setenv(command.TRACEBACK_VARIABLE, "1")
        with pytest.raises(type(error)):
            command.main(["paper", "list"])
    monkeypatch.delenv(command.TRACEBACK_VARIABLE, raising=False)
    monkeypatch.setattr("gen.__main__._describe_robot", broken)
    assert gen_command.main(["describe", "paper"]) == (code if code != command.UNUSABLE else command.UNFORESEEN_ERROR)
    said = capsys.readouterr().err
    assert said.count("\n") == bool(words) and said.rstrip("\n").isprintable()


def run(*arguments: str, **how: object) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own."""
    settings = {"env": {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT)}, "timeout": 60, "stderr": subprocess.PIPE}
    return subprocess.run([sys.executable, *arguments], text=True, check=False, **(settings | how))  # type: ignore[call-overload]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("arguments", ["-m hdagen paper list", "-m hdagen mpc keys", "-m gen describe paper"])
def test_a_full_device_is_told(arguments: str) -> None:
    with Path("/dev/full").open("w") as full:
        done = run(*arguments.split(), stdout=full)
    assert done.returncode == command.USAGE
    assert done.stderr.count("\n") == 1 and "standard output: cannot be" in done.stderr


@pytest.mark.parametrize("arguments", ["-m hdagen paper list", "-m gen describe paper"])
def test_a_pipe_that_nobody_reads_ends_the_command_silently(arguments: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = run(*arguments.split(), stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (command.OUTPUT_CLOSED, "")


INTERRUPTED = """
import runpy, sys
_, interrupted, package, *arguments = sys.argv
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == interrupted:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupt())
sys.argv = [package, *arguments]
runpy.run_module(package, run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("numpy", "hdagen replay paper a.csv"),
        ("hdagen.cli.replay", "hdagen paper list"),
        ("hdagen.log.measured_log", "hdagen replay paper a.csv"),
        ("gen.builder.build", "gen describe paper"),
    ],
)
def test_an_interrupt_during_imports_is_no_traceback(module: str, arguments: str) -> None:
    done = run("-c", INTERRUPTED, module, *arguments.split(), stdout=subprocess.PIPE)
    assert done.returncode == command.INTERRUPTED, done.stderr
    assert done.stderr.count("\n") == 1 and done.stderr.startswith("interrupted; ")


def test_the_public_names_are_there_without_being_loaded_first() -> None:
    assert {name for names in hdagen._HOMES.values() for name in names} == set(hdagen.__all__)
    assert all(getattr(hdagen, name).__name__ for name in hdagen.__all__) and set(hdagen.__all__) <= set(dir(hdagen))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        hdagen.nothing  # noqa: B018
    code = "import sys, hdagen.__main__; hdagen.__main__.build_parser(); sys.exit('numpy' in sys.modules)"
    assert run("-c", code, stdout=subprocess.PIPE).returncode == 0


def test_arguments_of_a_command_are_printed_escaped(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(["paper", "list", "--\x1b[31m"])
    assert "\x1b" not in capsys.readouterr().err


def test_too_few_open_files_are_no_missing_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    def exhausted(*_: object, **__: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("gen.builder.compiler.shutil.which", lambda name: f"/bin/{name}")
    monkeypatch.setattr("gen.builder.compiler.subprocess.run", exhausted)
    with pytest.raises(CompileError, match=r"`cc --version` cannot be started \(Too many open files\)"):
        find_compiler.__wrapped__()
