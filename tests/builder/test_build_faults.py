"""What goes wrong around a build: others at the same time, kills, disks that are full or read-only, bad compilers."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from arms import SMALL
from stub_compiler import stub_compiler

from gen.builder import compiler
from gen.builder.build import OBJECT_FOLDER, is_intact

ROOT = Path(__file__).parents[2]
GEN = [sys.executable, "-m", "gen"]


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(SMALL)
    return path


@pytest.fixture(scope="module", autouse=True)
def _source(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A copy of the generator that nobody edits while children run, for a change of it changes every build's name."""
    source = tmp_path_factory.mktemp("source")
    shutil.copytree(ROOT / "gen", source / "gen", ignore=shutil.ignore_patterns("__pycache__"))
    with pytest.MonkeyPatch.context() as m:
        m.setenv("PYTHONPATH", str(source))
        m.setenv("OPENBLAS_NUM_THREADS", "1")
        m.chdir(source)
        yield


def run(
    *arguments: object, preexec: Callable[[], object] | None = None, **changes: str
) -> subprocess.CompletedProcess[str]:
    """`python -m gen` with arguments and changes to the environment."""
    command = [*GEN, *map(str, arguments)]
    return subprocess.run(
        command,
        env=os.environ | changes,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        preexec_fn=preexec,
    )


def names(out: Path) -> list[str]:
    """What lies in the folder of builds, but for the objects that builds share."""
    return sorted(path.name for path in out.iterdir() if path.name != OBJECT_FOLDER)


# -- others at the same time ------------------------------------------------------------------------------------------


def test_builds_at_once_make_one(robot: Path, tmp_path: Path) -> None:
    stub, out = stub_compiler(tmp_path, sleep=0.3), tmp_path / "build"
    command = [*GEN, "build", str(robot), "--out", str(out)]
    many = [
        subprocess.Popen(
            command, env=os.environ | {"CC": str(stub)}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    printed = [child.communicate(timeout=120) for child in many]
    assert [child.returncode for child in many] == [0, 0, 0], printed
    (folder,) = {stdout.strip() for stdout, _ in printed}
    assert sorted(stderr.splitlines()[-1] for _, stderr in printed) == [
        "built (portable)",
        *["unchanged (portable)"] * 2,
    ]
    assert is_intact(Path(folder), folder.rpartition("-")[2])
    commands = (tmp_path / "commands").read_text().splitlines()
    sources = len(list(Path(folder).glob("hda_*.c")))  # headers are preprocessed, each is compiled, all are linked
    assert len(commands) == len(set(commands)) == 1 + sources + 1, "compiled more than once"
    assert names(out) == [".lock", Path(folder).name]


@pytest.mark.parametrize("kills", [24, pytest.param(400, marks=pytest.mark.campaign)])
def test_a_kill_leaves_nothing_or_a_whole_build(robot: Path, tmp_path: Path, kills: int) -> None:
    stub, out = stub_compiler(tmp_path), tmp_path / "build"
    command = [
        sys.executable,
        str(ROOT / "tests" / "support" / "kill_builds.py"),
        str(robot),
        str(out),
        str(kills),
        "1",
        "600",
    ]
    done = subprocess.run(
        command, env=os.environ | {"CC": str(stub)}, capture_output=True, text=True, timeout=720, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["kills"] == kills, found
    assert found["broken"] == found["uncleaned"] == found["failed"] == 0, found
    assert found["leftovers"] > kills / 10, f"too few kills came in mid-build to show anything: {found}"


@pytest.mark.parametrize("interrupt", [os.killpg, os.kill])  # as a terminal does; and where no compiler hears of it
def test_an_interrupted_build_leaves_nothing(
    robot: Path, tmp_path: Path, interrupt: Callable[[int, int], None]
) -> None:
    stub, out = stub_compiler(tmp_path, sleep=600), tmp_path / "build"
    command = [*GEN, "build", str(robot), "--out", str(out)]
    with subprocess.Popen(
        command, env=os.environ | {"CC": str(stub)}, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as child:
        try:
            until = time.monotonic() + 60
            while not (tmp_path / "commands").exists() and time.monotonic() < until:
                time.sleep(0.01)
            interrupt(child.pid, signal.SIGINT)
            _, said = child.communicate(timeout=60)
        finally:
            with contextlib.suppress(ProcessLookupError):  # what the compilers had started
                os.killpg(child.pid, signal.SIGKILL)
    assert child.returncode == 130
    assert said.splitlines()[-1] == "interrupted; nothing was left behind."
    assert names(out) == [".lock"]


def test_an_interrupt_is_not_raised_amid_the_work_but_after_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    over, reached = threading.Event(), []

    def interrupted(*_: object) -> None:  # by a worker, while the main thread waits
        os.kill(os.getpid(), signal.SIGINT)
        reached.append(over.wait(60))
        raise compiler.CompileError("ended before it was done")

    monkeypatch.setattr(compiler, "Event", lambda: over)
    monkeypatch.setattr(compiler, "_compile_object", interrupted)
    heard = signal.getsignal(signal.SIGINT)
    (tmp_path / "a.c").write_text("")
    with pytest.raises(KeyboardInterrupt):
        compiler.compile_library(tmp_path, ["a.c"], "portable", "a.so", tmp_path)
    assert reached == [True]
    assert signal.getsignal(signal.SIGINT) is heard


def test_a_compiler_without_an_end_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    endless = stub_compiler(tmp_path, sleep=600)
    monkeypatch.setattr(compiler, "find_compiler", lambda: compiler.Compiler((str(endless),), "stub"))
    monkeypatch.setattr(compiler, "COMPILER_TIMEOUT", 0.2)
    with pytest.raises(compiler.CompileError, match=r"did not finish within 0.2 s: \S*stubcc -O2"):
        compiler.plain_library(tmp_path, ["a.c"], "a.so")


# -- places that cannot be written ------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", ["64k", "200k"])
def test_a_full_disk_is_said_and_leaves_what_was_there(
    robot: Path, tmp_path: Path, mount: Callable[[str], Path], size: str
) -> None:
    stub = stub_compiler(tmp_path)
    disk = mount(f"size={size}")
    (disk / "mine").write_bytes(b"x" * 40_000)
    done = run("build", robot, "--out", disk / "build", CC=str(stub))
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == (
        f"{disk}/build: the build could not be written (No space left on device); nothing was changed. Free space, or "
        "name a writable folder with --out."
    )
    assert names(disk / "build") == [".lock"]
    assert (disk / "mine").read_bytes() == b"x" * 40_000


def test_a_disk_that_fills_while_compiling_is_said(robot: Path, mount: Callable[[str], Path]) -> None:
    disk = mount("size=260k")
    done = run("build", robot, "--out", disk / "build")
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert names(disk / "build") == [".lock"]


def test_a_limit_on_files_is_said_and_an_older_build_stays(robot: Path, tmp_path: Path) -> None:
    stub, out = stub_compiler(tmp_path), tmp_path / "build"
    folder = Path(run("build", robot, "--out", out, CC=str(stub)).stdout.strip())
    robot.write_text(SMALL + "#")

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))

    done = run("build", robot, "--out", out, preexec=limit, CC=str(stub))
    assert done.returncode == 2
    assert "the build could not be written (File too large); nothing was changed." in done.stderr
    assert names(out) == [".lock", folder.name]
    assert is_intact(folder, folder.name.rpartition("-")[2])


def test_a_read_only_folder_is_said(robot: Path, tmp_path: Path, mount: Callable[[str], Path]) -> None:
    disk = mount("size=1m,ro")
    done = run("build", robot, "--out", disk, CC=str(stub_compiler(tmp_path)))
    assert done.returncode == 2
    assert done.stderr.startswith(f"{disk}: the build could not be written (Read-only file system)")
    assert names(disk) == []


@pytest.mark.parametrize("inside", ["", "deeper"])
def test_a_file_in_the_place_of_the_folder_is_said(robot: Path, tmp_path: Path, inside: str) -> None:
    (tmp_path / "build").write_text("mine")
    done = run("build", robot, "--out", tmp_path / "build" / inside, CC=str(stub_compiler(tmp_path)))
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "the build could not be written" in done.stderr
    assert (tmp_path / "build").read_text() == "mine"


# -- compilers --------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(importlib.util.find_spec("ziglang") is not None, reason="the wheel with a compiler is installed")
def test_no_compiler_names_packages_and_the_extra(robot: Path, tmp_path: Path) -> None:
    done = run("build", robot, "--out", tmp_path / "build", PATH=str(tmp_path), CC="")
    assert done.returncode == 6
    assert done.stderr.count("\n") == 1
    for words in (
        "no C compiler: tried cc, gcc, clang",
        "apt install gcc",
        "xcode-select",
        "pip install 'hdagen[cc]'",
        "$CC",
    ):
        assert words in done.stderr
    assert not (tmp_path / "build").exists()


@pytest.mark.parametrize(
    "named, why",
    [
        ("false", "`false --version` ended with code 1"),
        ("/nowhere/cc", "there is no such program"),
        ("'unclosed", "No closing quotation"),
    ],
)
def test_a_compiler_in_the_environment_that_is_none_is_said(robot: Path, tmp_path: Path, named: str, why: str) -> None:
    done = run("build", robot, "--out", tmp_path / "build", CC=named)
    assert done.returncode == 6
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"$CC: found {named}, which is no ")
    assert why in done.stderr
    assert not (tmp_path / "build").exists()


FAILING = {
    "words": ('echo "hda_step.c:1: error: it is Monday" >&2; exit 3', "code 3", "error: it is Monday"),
    "silent": ("exit 1", "code 1", "it said nothing"),
    "nothing made": ("exit 0", "without an error and without a", "headers."),
    "killed": ("kill -9 $$", "code -9", "headers."),
    "not text": (r"printf '\377\376' >&2; exit 1", "code 1", "\ufffd"),
}


@pytest.mark.parametrize("script, code, words", FAILING.values(), ids=FAILING.keys())
def test_a_compiler_that_fails_is_quoted(robot: Path, tmp_path: Path, script: str, code: str, words: str) -> None:
    failing = tmp_path / "failing cc"
    failing.write_text(f'#!/bin/sh\ncase "$*" in *--version*) echo failing 1.0; exit 0;; esac\n{script}\n')
    failing.chmod(0o755)
    done = run("build", robot, "--out", tmp_path / "build", CC=f"'{failing}'")
    assert done.returncode == 2
    said = done.stderr.split("\n", 1)[1]  # the first line says what is built
    assert code in said
    assert words in said
    assert f"'{failing}' -std=c99" in said
    assert "-O2 -ffp-contract=off " in said
    assert "Traceback" not in said
    assert names(tmp_path / "build") == [".lock"]


def test_a_compiler_named_by_a_relative_path_works(robot: Path, tmp_path: Path) -> None:
    stub = os.path.relpath(stub_compiler(tmp_path))
    done = run("build", robot, "--out", tmp_path / "build", CC=stub)
    assert done.returncode == 0, done.stderr
