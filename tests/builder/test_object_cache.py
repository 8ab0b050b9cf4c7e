"""Compiled objects that builds share: taken where the C is the same, made again where they are damaged."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from arms import arm
from stub_compiler import stub_compiler

from gen.builder import compiler, object_cache
from gen.builder.build import OBJECT_FOLDER, build_robot


@pytest.fixture
def stub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The stub compiler; its commands are listed beside it."""
    monkeypatch.setenv("CC", str(stub_compiler(tmp_path)))
    compiler.find_compiler.cache_clear()
    yield tmp_path
    compiler.find_compiler.cache_clear()


def compiled(folder: Path) -> list[str]:
    """The sources that were compiled, not only preprocessed or linked."""
    lines = (folder / "commands").read_text().splitlines()
    (folder / "commands").write_text("")
    return sorted(word for line in lines if " -c " in line for word in line.split() if word.endswith(".c"))


def test_a_robot_of_the_same_structure_takes_what_was_compiled(stub: Path) -> None:
    robot, out = stub / "robot.toml", stub / "build"
    robot.write_text(arm("RR"))
    first, _ = build_robot(str(robot), "portable", out)
    every = sorted(path.name for path in first.glob("hda_*.c"))
    assert compiled(stub) == every
    robot.write_text(arm("RR").replace("mass = ", "mass = 1", 1))
    second, made = build_robot(str(robot), "portable", out)
    assert made and second != first
    assert compiled(stub) == []  # the stub gives the same text for the same command
    for path in (out / OBJECT_FOLDER).glob("*.o"):
        path.write_text("damaged")
    robot.write_text(arm("RR").replace("mass = ", "mass = 2", 1))
    build_robot(str(robot), "portable", out)
    assert compiled(stub) == every


def test_what_is_kept_is_whole_and_no_more_than_the_newest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(object_cache, "MOST_OBJECTS", 3)
    keys = [object_cache.hash_object(bytes([k]), ("cc",), "1") for k in range(5)]
    assert len(set(keys)) == 5
    assert (
        object_cache.hash_object(b"x", ("cc", "-O2"), "1")
        != object_cache.hash_object(b"x", ("cc",), "1")
        != object_cache.hash_object(b"x", ("cc",), "2")
    )
    for k, name in enumerate(keys):
        object_cache.store_object(tmp_path, name, bytes([k]) * 10)
    assert len(list(tmp_path.iterdir())) == 3
    assert object_cache.fetch_object(tmp_path, keys[4]) == bytes([4]) * 10
    (path,) = tmp_path.glob(f"{keys[4]}-*.o")
    path.write_bytes(b"other")
    assert object_cache.fetch_object(tmp_path, keys[4]) is None and not path.exists()
