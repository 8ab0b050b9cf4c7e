"""Files that appear whole or not at all, and the one way in which hdagen writes them."""

from __future__ import annotations

import ast
import errno
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hdagen.support.atomic_write import open_atomically, write_atomically

ROOT = Path(__file__).parents[2]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_takes_the_place_of_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "a.json", b"one")
        write_atomically(tmp_path / "a.json", b"two")
        monkeypatch.chdir(tmp_path)
        write_atomically(Path("b"), b"three")
    finally:
        os.umask(before)
    assert names(tmp_path) == ["a.json", "b"]
    assert (tmp_path / "a.json").read_bytes() == b"two"
    assert (tmp_path / "a.json").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("name", ["ä" * 120 + ".toml", "a" * 250 + ".json", "a." + "b" * 250, ".hidden"])
def test_any_name_that_the_disk_takes_is_written(tmp_path: Path, name: str) -> None:
    write_atomically(tmp_path / name, b"x")
    assert names(tmp_path) == [name]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, OSError(errno.ENOSPC, "full")])
def test_an_error_leaves_what_stood_there_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    write_atomically(tmp_path / "a.toml", b"one")
    with pytest.raises(BaseException) as caught, open_atomically(tmp_path / "a.toml") as file:  # noqa: PT011, PT012
        file.write(b"two")
        file.flush()
        assert file.name.endswith(".toml") and Path(file.name).read_bytes() == b"two"
        raise error
    assert caught.type in (error, OSError)
    assert caught.type is not OSError or caught.value.filename == str(tmp_path / "a.toml")  # type: ignore[attr-defined]
    assert names(tmp_path) == ["a.toml"]
    assert (tmp_path / "a.toml").read_bytes() == b"one"


KILLED = """
import os, signal, sys
from pathlib import Path
from hdagen.support.atomic_write import open_atomically
with open_atomically(Path(sys.argv[1])) as file:
    file.write(b"half")
    file.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_kill_left_is_removed_by_the_next_that_writes_there(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path / "killed.toml")]
    subprocess.run(command, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=False)
    (left,) = names(tmp_path)
    assert re.fullmatch(r"\.killed\.part-[0-9a-f]{16}\.toml", left)
    (tmp_path / ".mine.part-1").write_text("not of this form")
    with open_atomically(tmp_path / "one.toml") as one:
        assert not (tmp_path / left).exists()
        write_atomically(tmp_path / "one.toml", b"by another, in the meantime")  # which leaves what is being written
        write_atomically(tmp_path / "two.json", b"two")
        one.write(b"one")
    assert names(tmp_path) == [".mine.part-1", "one.toml", "two.json"]
    assert (tmp_path / "one.toml").read_bytes() == b"one"


@pytest.mark.parametrize("kind", ["folder", "pipe", "device"])
def test_what_is_no_file_is_not_replaced(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "place"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(os.devnull)
    before = path.lstat()
    with pytest.raises(OSError, match="Is a directory" if kind == "folder" else "it is no regular file"):
        write_atomically(path, b"x")
    assert path.lstat() == before and names(tmp_path) == ["place"]


ELSEWHERE = {  # what does not stay: folders that are temporary, and a build that is renamed when it is whole
    "hdagen/adoption/robot_update.py": ["write_bytes", "write_bytes"],
    "hdagen/bench/benchmark.py": ["write_text"],
    "hdagen/bench/simulator_race.py": ["write_text"],
    "hdagen/blind/ablation_task.py": ["write_text"],
    "hdagen/blind/sealed_check.py": ["write_text"],
    "hdagen/campaign/build_transport.py": ["write_bytes", "rename", "write_bytes"],
    "hdagen/campaign/file_transport.py": ["write_bytes"],
    "hdagen/campaign/task_execution.py": ["write_bytes"],
    "hdagen/log/mat_file.py": ["open"],
    "hdagen/model_export/c_writer.py": ["write_text", "write_text"],
    "hdagen/model_export/fmu_writer.py": ["write_text"],
    "hdagen/model_export/mjcf_writer.py": ["write_bytes"],
    "hdagen/mpc/benchmark/growth_in_space.py": ["write_text"],
    "hdagen/mpc/benchmark/scaling.py": ["write_text"],
    "hdagen/paper/prototype/virtual_prototype.py": ["write_bytes"],
}


def writes(node: ast.AST) -> str:
    """The call by which a node writes a file, if it does."""
    if not isinstance(node, ast.Call):
        return ""
    called = node.func.attr if isinstance(node.func, ast.Attribute) else ast.unparse(node.func)
    modes = [a.value for a in (*node.args, *(k.value for k in node.keywords)) if isinstance(a, ast.Constant)]
    opened = called in ("open", "fdopen") and any(
        isinstance(m, str) and re.fullmatch(r"[rbt+]*[wxa+].*", m) for m in modes
    )
    renamed = ast.unparse(node.func) in ("os.replace", "os.rename")
    made = called in ("write_text", "write_bytes", "mkstemp", "NamedTemporaryFile")
    return called if opened or renamed or made else ""


def test_there_is_one_way_to_write_a_file() -> None:
    found = {}
    for path in sorted((ROOT / "hdagen").rglob("*.py")):
        calls = [call for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if (call := writes(node))]
        if calls:
            found[path.relative_to(ROOT).as_posix()] = calls
    assert found.pop("hdagen/support/atomic_write.py") == ["open", "replace"]
    assert found == ELSEWHERE
