"""Commands that are killed, that find a full or read-only disk, or run as another user: nothing is half-written."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from arms import SMALL
from compiled import Compiled
from kill_campaign import BUILD, COMMANDS, PATHS, list_all_faults, list_faults, make_series, run_kills
from kill_commands import PREPARE, find_broken, find_parts
from replayed import FLEXIBLE

from hdagen.__main__ import main

NOBODY = 65534


@pytest.fixture
def environment(build: Callable[..., Compiled]) -> dict[str, str]:
    """That of a child, which builds where the tests' builds lie."""
    return os.environ | {
        "PYTHONPATH": PATHS,
        "HDAGEN_BUILD": str(build(FLEXIBLE).folder.parent),
        "OMP_NUM_THREADS": "1",
    }


# -- kills ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command, count", [("adopt", 3), ("fleet", 5)])
def test_a_kill_leaves_nothing_half_written(command: str, count: int, tmp_path: Path) -> None:
    """Nothing is ever half-written, the next run does all, and a second campaign keeps the first one's series."""
    tasks = make_series((command,), count)
    found = run_kills(tasks, tmp_path)
    assert list_all_faults(found) == [] and found[command].row["kills"] == count
    assert run_kills(tasks, tmp_path)[command].is_reused
    (row,) = pq.read_table(tmp_path / "results.parquet").to_pylist()
    assert (row["task"], row["kills"], row["faults"]) == (command, count, "[]")


@pytest.mark.campaign
def test_thirty_kills_of_each_command_and_of_builds_leave_nothing_half_written(tmp_path: Path) -> None:
    found = run_kills(make_series((*COMMANDS, BUILD), 30), tmp_path)
    assert list_all_faults(found) == [] and len(found) == len(PREPARE) + 1


def test_what_a_series_must_not_find_is_told() -> None:
    good = {"kills": 20, "broken": [], "parts": [], "orphans": 0, "code": 0, "files": ["a"], "left": 1}
    assert list(list_faults("adopt", good, 20)) == list(list_faults("blind", good | {"code": 1}, 20)) == []
    bad = {"kills": 19, "broken": ["a"], "parts": [".b"], "orphans": 2, "code": 1, "files": [], "left": 0}
    for name, value in bad.items():
        assert len(list(list_faults("adopt", good | {name: value}, 20))) == 1, name
    built = {"kills": 20, "broken": 0, "uncleaned": 0, "failed": 0, "leftovers": 3}
    assert list(list_faults(BUILD, built, 20)) == []
    for name, value in {"broken": 1, "uncleaned": 1, "failed": 1, "leftovers": 2}.items():
        assert len(list(list_faults(BUILD, built | {name: value}, 20))) == 1, name
    assert set(COMMANDS) == set(PREPARE)


# -- disks ------------------------------------------------------------------------------------------------------------


def run_prepared(command: str, folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """One run of a command as it is prepared for kills; it writes into ``folder``/out."""
    code = "import sys; from pathlib import Path; from kill_commands import PREPARE, __main__\n"
    code += "sys.exit(__main__.main(PREPARE[sys.argv[1]](Path(sys.argv[2]))))"
    program = [sys.executable, "-c", code, command, str(folder)]
    return subprocess.run(program, env=environment, capture_output=True, text=True, check=False)


SOME = ["fleet", *(pytest.param(command, marks=pytest.mark.campaign) for command in PREPARE if command != "fleet")]


@pytest.mark.parametrize("command", [one for one in SOME if "blind" not in str(one)])  # blind wants an empty folder
def test_a_full_disk_is_said_and_nothing_is_half_written(
    command: str, tmp_path: Path, mount: Callable[[str, Path], Path], environment: dict[str, str]
) -> None:
    disk = mount("size=16k", tmp_path / "out")
    (disk / "mine").write_bytes(b"x" * 16_384)
    done = run_prepared(command, tmp_path, environment)
    assert done.returncode == 2, done.stderr
    assert "No space left on device" in done.stderr.splitlines()[-1] and "Traceback" not in done.stderr
    assert (disk / "mine").read_bytes() == b"x" * 16_384
    assert find_parts(disk) == find_broken(disk) == []


@pytest.mark.parametrize("command", SOME)
def test_a_read_only_disk_is_said(
    command: str, tmp_path: Path, mount: Callable[[str, Path], Path], environment: dict[str, str]
) -> None:
    mount("size=16k,ro", tmp_path / "out")
    done = run_prepared(command, tmp_path, environment)
    assert done.returncode == 2, done.stderr
    assert "Read-only file system" in done.stderr.splitlines()[-1] and "Traceback" not in done.stderr


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_log_that_does_not_fit_is_said(
    suffix: str,
    tmp_path: Path,
    mount: Callable[[str, Path], Path],
    build: Callable[..., Compiled],
    capsys: pytest.CaptureFixture[str],
) -> None:
    disk = mount("size=16k", tmp_path / "disk")
    wanted = ["simulate", str(build("paper").folder), "--built", "--seconds", "1", "--controller", "position"]
    assert main([*wanted, "--out", str(disk / f"log{suffix}")]) == 3
    assert (
        capsys.readouterr()
        .err.splitlines()[-1]
        .startswith(f"{disk}/log{suffix}: cannot be written (No space left on device); nothing was left half-written")
    )
    assert list(disk.iterdir()) == []


# -- another user -----------------------------------------------------------------------------------------------------


@pytest.fixture
def shared() -> Iterator[Path]:
    """A folder that every user may look into."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


AS_ANOTHER = """
import os, sys, sysconfig
from pathlib import Path
from hdagen.arm.compiled_arm import Arm, PlantError
from hdagen.support.atomic_write import write_atomically
build, own, user = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
sysconfig.get_config_vars()  # the interpreter's own files may be out of another user's reach
os.setgroups([]), os.setgid(user), os.setuid(user), os.umask(0o002)
try:
    print(Arm(build).n)
except PlantError as error:
    print(error)
for folder in (own, build):
    try:
        write_atomically(folder / "file", b"mine")
    except OSError as error:
        print(error)
print((own / "file").read_bytes().decode(), [path.name for path in own.iterdir()])
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may act as another user")
def test_another_user_loads_what_root_built_but_nobody_else_s_and_writes_only_own_files(
    shared: Path, build: Callable[..., Compiled], environment: dict[str, str]
) -> None:
    own, source = shared / "own", build(SMALL).folder
    own.mkdir()
    os.chown(own, NOBODY, NOBODY)
    folder = Path(shutil.copytree(source, shared / "builds" / source.name))
    (shared / "builds").chmod(0o755)

    def run() -> list[str]:
        program = [sys.executable, "-c", AS_ANOTHER, str(folder), str(own), str(NOBODY)]
        done = subprocess.run(program, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    refused = f"[Errno 13] Permission denied: '{folder}/file'"
    assert run() == ["1", refused, "mine ['file']"]
    os.chown(folder, 1, 1)
    said, *rest = run()
    assert f"compiled code is not run from there, for {folder} belongs to the user " in said
    assert rest == [refused, "mine ['file']"]
