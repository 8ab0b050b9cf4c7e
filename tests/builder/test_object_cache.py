"""Compiled objects that builds share: taken where the C is the same, made again where they are damaged."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from arms import arm
from compilers import compiler as find_command
from stub_compiler import stub_compiler

from gen.builder import compiler, object_cache
from gen.builder.build import OBJECT_FOLDER, build_robot
from gen.builder.build_files import TEMPLATES
from gen.builder.deciding_text import MACRO, MACRO_HEADERS, collect_deciding_text
from gen.mpc.problem_structure import Structure


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
    assert compiled(stub) == ["hda_python.c", "hda_rodas.c"]  # which name the build, and widths of differences
    for path in (out / OBJECT_FOLDER).glob("*.o"):
        path.write_text("damaged")
    robot.write_text(arm("RR").replace("mass = ", "mass = 2", 1))
    build_robot(str(robot), "portable", out)
    assert compiled(stub) == every


def test_what_is_kept_is_whole_and_no_more_than_the_newest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(object_cache, "MOST_OBJECTS", 3)
    keys = [object_cache.hash_object(bytes([k]), b"", ("cc",), "1") for k in range(5)]
    assert len(set(keys)) == 5
    others = [
        object_cache.hash_object(b"x", b"", ("cc", "-O2"), "1"),
        object_cache.hash_object(b"x", b"", ("cc",), "1"),
        object_cache.hash_object(b"x", b"", ("cc",), "2"),
        object_cache.hash_object(b"x", b"y", ("cc",), "1"),
    ]
    assert len(set(others)) == 4
    for k, name in enumerate(keys):
        object_cache.store_object(tmp_path, name, bytes([k]) * 10)
    assert len(list(tmp_path.iterdir())) == 3
    assert object_cache.fetch_object(tmp_path, keys[4]) == bytes([4]) * 10
    (path,) = tmp_path.glob(f"{keys[4]}-*.o")
    path.write_bytes(b"other")
    assert object_cache.fetch_object(tmp_path, keys[4]) is None and not path.exists()


@pytest.mark.parametrize(("profile", "mpc"), [("portable", Structure(nodes=3)), ("native", None)])
def test_macros_that_do_not_count_change_nothing_that_is_compiled(
    stub: Path, profile: str, mpc: Structure | None
) -> None:
    """As the preprocessor of a real compiler has it; other macros count."""
    robot = stub / "robot.toml"
    robot.write_text(arm("RR"))
    folder, _ = build_robot(str(robot), profile, stub / "build", mpc=mpc)
    headers = {name: (folder / name).read_bytes() for name in MACRO_HEADERS if (folder / name).exists()}
    counted, passed_over = set[str](), set[str]()
    for source in sorted(path.name for path in folder.glob("hda_*.c")):
        text, plain = collect_deciding_text(folder, source), preprocess(folder, source, profile)
        for name, header in headers.items():
            macros = {line[1].decode(): line[0] for line in MACRO.finditer(header)}
            unnamed = {macro for macro, line in macros.items() if line not in text}
            counted |= macros.keys() - unnamed
            passed_over |= unnamed
            lines = [f"#define {m} other\n".encode() if m in unnamed else line for m, line in macros.items()]
            (folder / name).write_bytes(replace_all(header, dict(zip(macros.values(), lines, strict=True))))
        assert collect_deciding_text(folder, source) == text
        assert preprocess(folder, source, profile) == plain, source
        for name, header in headers.items():
            (folder / name).write_bytes(header)
    assert {"HDA_N", "HDA_NX", "HDA_NP", "HDA_BUILD", "HDA_WIDTH"} <= counted
    assert {"HDA_NOMINAL", "HDA_NX", "HDA_NP", "HDA_BUILD", "HDA_WIDTH"} <= passed_over


@pytest.mark.parametrize("header", ["hda_model.h", "hda_limit.h", "hda_parts.h"])
def test_every_header_that_is_included_counts(tmp_path: Path, header: str) -> None:
    shutil.copytree(str(TEMPLATES), tmp_path / "c")
    (tmp_path / "c" / "hda_model.h").write_text('#include "hda_limit.h"\n')
    (tmp_path / "c" / "hda_sizes.h").write_text("")
    before = collect_deciding_text(tmp_path / "c", "hda_step.c")
    with (tmp_path / "c" / header).open("a") as file:
        file.write("int more;\n")
    assert collect_deciding_text(tmp_path / "c", "hda_step.c") != before


def test_an_arm_with_a_predictive_controller_shares_its_model_with_the_arm_without(stub: Path) -> None:
    """The controller's path is a longer reference, which only the guard and what calls it know."""
    robot = stub / "robot.toml"
    robot.write_text(arm("RR"))
    plain, planned = (
        build_robot(str(robot), "portable", stub / "build", mpc=mpc)[0] for mpc in (None, Structure(nodes=20))
    )
    shared = {
        source
        for source in sorted(path.name for path in plain.glob("hda_*.c"))
        if collect_deciding_text(plain, source) == collect_deciding_text(planned, source)
    }
    assert {"hda_filters.c", "hda_laws.c", "hda_model.c", "hda_prepare.c", "hda_step.c", "hda_windows.c"} <= shared
    assert "hda_guard.c" not in shared


def replace_all(text: bytes, changes: dict[bytes, bytes]) -> bytes:
    for old, new in changes.items():
        text = text.replace(old, new)
    return text


def preprocess(folder: Path, source: str, profile: str) -> str:
    command = [*find_command("gcc"), *compiler.compiler_flags(profile), "-E", "-P", source]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout
