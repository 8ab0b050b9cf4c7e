"""What a build shows of itself: its stages and objects, one line on a terminal and nothing in a pipe."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from arms import SMALL
from stub_compiler import stub_compiler

from gen.builder import build_progress, compiler
from gen.builder.build import build_robot
from hdagen.arm import running_builds
from hdagen.arm.build_loader import find_or_build
from hdagen.arm.running_builds import listen_to_builds, tell_build_stage
from hdagen.diagnosis.stages.stage import Stage

ROOT = Path(__file__).parents[2]
COMPILING = re.compile(r"compiling, (\d+) of (\d+) objects")
DIAGNOSING = """
from hdagen.arm.running_builds import tell_build_stage
from hdagen.cli.diagnosis_progress import show_progress
from hdagen.diagnosis.stages.stage import Stage
with show_progress(False) as progress:
    progress(Stage.MODELS)
    tell_build_stage(1, "linking")
"""
COMMANDS = {"generator": ("-m", "gen", "build"), "command": ("-m", "hdagen", "build")}


@pytest.fixture(autouse=True)
def _stub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A compiler that takes a moment and no processor."""
    monkeypatch.setenv("CC", str(stub_compiler(tmp_path, sleep=0.05)))
    compiler.find_compiler.cache_clear()
    yield
    compiler.find_compiler.cache_clear()


@pytest.fixture
def robot(tmp_path: Path) -> str:
    path = tmp_path / "robot.toml"
    path.write_text(SMALL)
    return str(path)


def check_stages(told: list[str]) -> None:
    """Equations, C, objects from none to all, link."""
    counts = [tuple(map(int, found.groups())) for one in told if (found := COMPILING.fullmatch(one))]
    assert told == [
        *("writing the equations", "printing the C"),
        *(f"compiling, {done} of {total} objects" for done, total in counts),
        "linking",
    ]
    done = [count for count, _ in counts]
    assert done == sorted(set(done)) and len(done) > 3
    assert done[0] == 0 and {total for _, total in counts} == {done[-1]}


def test_a_build_tells_its_stages_and_every_object(robot: str, tmp_path: Path) -> None:
    told: list[str] = []
    build_robot(robot, "portable", tmp_path / "build", on_stage=told.append)
    check_stages(told)
    told.clear()
    build_robot(robot, "portable", tmp_path / "build", on_stage=told.append)
    assert told == [], "what is there already is not built"


def test_a_build_in_a_child_process_is_heard(robot: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    told: list[str] = []
    with listen_to_builds(told.append):
        find_or_build(robot, "portable", (), tmp_path / "build")
    assert told.pop() == ""
    check_stages(told)
    assert [line.split()[0] for line in capfd.readouterr().err.splitlines()] == ["building"]


def test_the_stages_of_two_builds_are_told_together() -> None:
    told: list[str] = []
    with listen_to_builds(told.append):
        for build, stage in ((1, "linking"), (2, "printing the C"), (1, ""), (2, "linking"), (2, ""), (2, "")):
            tell_build_stage(build, stage)
    tell_build_stage(3, "linking")
    tell_build_stage(3, "")
    assert told == ["linking", "linking; printing the C", "printing the C", "linking", ""]


def show_on_terminal(*words: str) -> str:
    """What a Python program writes to a terminal that is its standard error."""
    ours, theirs = pty.openpty()
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, stderr=theirs, cwd=ROOT) as process:
        os.close(theirs)
        shown = b""
        with suppress(OSError):  # how Linux says that nobody writes any more
            while part := os.read(ours, 4096):
                shown += part
        assert process.wait(60) == 0
    os.close(ours)
    return shown.decode()


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_a_terminal_shows_one_line_that_is_overwritten(command: tuple[str, ...], robot: str, tmp_path: Path) -> None:
    text = show_on_terminal(*command, robot, "--out", str(tmp_path / "build"))
    assert "linking" in text and len(COMPILING.findall(text)) > 3
    left = [line.split("\r")[-1].replace("\x1b[K", "").split(" ")[0] for line in text.split("\r\n")]
    assert left in (["building", ""], ["building", "built", ""]), "what is overwritten does not remain"
    assert all("\n" not in part for part in re.findall(r"compiling[^\r]*", text))


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_a_pipe_gets_the_line_that_a_build_begins(command: tuple[str, ...], robot: str, tmp_path: Path) -> None:
    words = [sys.executable, *command, robot, "--out", str(tmp_path / "build")]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, timeout=60, check=True)
    assert [line.split()[0] for line in done.stderr.splitlines()][:1] == ["building"]
    assert not re.search("compiling|linking|\r|\x1b", done.stderr)


def test_the_line_of_a_diagnosis_shows_its_builds() -> None:
    assert f"{Stage.MODELS.value}: linking" in show_on_terminal("-c", DIAGNOSING)


def test_both_halves_mark_and_clear_lines_alike() -> None:
    assert running_builds.PROGRESS_MARK == build_progress.PROGRESS_MARK
    assert running_builds.CLEAR_LINE == build_progress.CLEAR_LINE
