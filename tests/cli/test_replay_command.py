"""`hdagen replay`: what it writes and prints, and how it refuses."""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from compiled import Compiled
from replayed import FLEXIBLE, RIGID, diagnosis, simulated, smooth

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.cli import replay as replay_command
from hdagen.log.column_map import ColumnsError
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log, read, write
from hdagen.prediction.window_replay import replay


@pytest.fixture(scope="module")
def made(build: Callable[..., Compiled]) -> Callable[..., Arm]:
    """made(text, effects=()) -> a fresh Arm."""
    return lambda robot, effects=(): Arm(build(robot, "portable", effects).folder)


@pytest.fixture
def command(build: Callable[..., Compiled], monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """command(*arguments) -> exit code of `hdagen replay`, with the builds of this session."""
    monkeypatch.setenv("HDAGEN_BUILD", str(build(FLEXIBLE).folder.parent))

    def run(*arguments: str | Path) -> int:
        parser = argparse.ArgumentParser()
        replay_command.add_parser(parser.add_subparsers())
        try:
            return replay_command.run(parser.parse_args(["replay", *map(str, arguments)]))
        except PlantError as error:
            print(error)
            return 2
        except LogError as error:
            print(error)
            return 2 if isinstance(error, ColumnsError) else 3

    return run


@pytest.fixture
def files(tmp_path: Path, made: Callable[..., Arm]) -> Path:
    """A folder with robot.toml, rigid.toml and a log of each."""
    (tmp_path / "robot.toml").write_text(FLEXIBLE)
    (tmp_path / "rigid.toml").write_text(RIGID)
    write(simulated(made(FLEXIBLE)), tmp_path / "log.parquet")
    write(smooth(made(RIGID)), tmp_path / "rigid.csv")
    return tmp_path


def test_the_command_writes_what_replay_predicts(
    command: Callable[..., int], files: Path, made: Callable[..., Arm], capsys: pytest.CaptureFixture[str]
) -> None:
    out = files / "predicted.parquet"
    assert command(files / "robot.toml", files / "log.parquet", "--out", out) == 0
    shown = capsys.readouterr().out
    log = read(files / "log.parquet")
    found = replay(made(FLEXIBLE), log)
    written = read(out)
    for name, values in found.columns.items():
        assert written[name].tobytes() == values.tobytes()
    assert all(name in shown for name in found.errors) and f"written: {out}" in shown.replace("\n", "")
    assert command(files / "robot.toml", files / "log.parquet", "--json", "--window", "0.5") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["windows"] == 3 and figures["out"] is None and figures["force_error"] is None
    assert figures["errors"] == pytest.approx(replay(made(FLEXIBLE), log, 0.5).errors)


def test_the_command_prints_the_force_error_of_rigid_robots(
    command: Callable[..., int], files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(files / "rigid.toml", files / "rigid.csv", "--json") == 0
    assert max(json.loads(capsys.readouterr().out)["force_error"]) < 0.02


def test_the_command_adds_a_verdict(
    command: Callable[..., int], files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (files / "diagnosis.json").write_text(json.dumps(diagnosis()))
    robot, log = files / "robot.toml", files / "log.parquet"
    assert command(robot, log, "--with", files / "diagnosis.json", "--json") == 0
    gap = json.loads(capsys.readouterr().out)["gap"]
    assert command(robot, log, "--json") == 0
    assert gap != json.loads(capsys.readouterr().out)["gap"]
    (files / "diagnosis.json").write_text(json.dumps(diagnosis(verdict=["no_such@1"], causes=[no_such()])))
    assert command(robot, log, "--with", files / "diagnosis.json") == 2
    assert "no model can be built with no_such" in capsys.readouterr().out


def test_the_command_refuses_a_diagnosis_of_another_robot(
    command: Callable[..., int], files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, log, said = files / "robot.toml", files / "log.parquet", files / "diagnosis.json"
    name, digest = tomllib.loads(robot.read_text())["name"], hashlib.sha256(robot.read_bytes()).hexdigest()
    said.write_text(json.dumps(diagnosis(robot={"name": name, "sha256": digest})))
    assert command(robot, log, "--with", said, "--out", files / "other.csv") == 0
    (files / "other.csv").unlink()
    capsys.readouterr()
    for stated, words in (
        ({"name": "elbow", "sha256": digest}, "of the robot 'elbow'"),
        ({"name": name, "sha256": "0" * 64}, "knows its robot file by its bytes alone"),
        ({"name": name, "identity": "0" * 64, "sha256": "0" * 64}, "has changed since"),
    ):
        said.write_text(json.dumps(diagnosis(robot=stated)))
        assert command(robot, log, "--with", said, "--out", files / "other.csv") == 2
        assert words in capsys.readouterr().out.replace("\n", " ")
    said.write_text(json.dumps(diagnosis(gap={"before": math.nan})))
    assert command(robot, log, "--with", said, "--out", files / "other.csv") == 2
    assert "gap, before: found nan, possible is a finite number" in capsys.readouterr().out.replace("\n", " ")
    assert not (files / "other.csv").exists()


def no_such() -> dict[str, object]:
    """A cause that no version knows."""
    return {"effect": "no_such", "joint": 1, "parameters": {"size": {"value": 1.0}}}


def test_the_command_refuses_in_sentences(
    command: Callable[..., int], files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, log = files / "robot.toml", files / "log.parquet"
    before = (files / "log.parquet").read_bytes()
    for arguments, words in (
        (("--window", "0"), "a window is longer than 0 s"),
        (("--bandwidth", "-2"), "--bandwidth -2"),
        (("--closed-loop", "c.toml", "--input", "measured"), "exclude each other"),
        (("--out", files / "x.txt"), "possible are .csv and .parquet"),
        (("--out", files / "nowhere" / "x.csv"), "there is no folder"),
        (("--out", log), "is the log itself"),
        (("--with", files / "absent.json"), "absent.json"),
        (("--columns", files / "absent.toml"), "absent.toml"),
    ):
        assert command(robot, log, *arguments) == 2, arguments
        said = capsys.readouterr()
        assert words in said.out + said.err
    assert command(robot, files / "absent.parquet") == 3
    assert command(files / "absent.toml", log) == 2
    assert (files / "log.parquet").read_bytes() == before
    assert not list(files.glob("*x.*"))


def test_a_log_that_triage_refuses_is_refused(
    command: Callable[..., int], files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = read(files / "log.parquet")
    wrong = {
        **log.columns,
        "motor_position_1": log["motor_position_1"] / 100,
        "motor_position_2": log["motor_position_2"] / 100,
    }
    write(Log(log.time, wrong, 2, "joint scale"), files / "wrong.parquet")
    assert command(files / "robot.toml", files / "wrong.parquet", "--out", files / "out.parquet") == 3
    assert "motor_position_1" in capsys.readouterr().err
    assert not (files / "out.parquet").exists()
