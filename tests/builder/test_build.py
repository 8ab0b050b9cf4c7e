"""Builds named by their content: what changes the name, what is made, what is found again, what is made anew."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from arms import SMALL, arm
from compiled import load
from stub_compiler import stub_compiler

from gen.__main__ import main
from gen.builder import build as builds
from gen.builder import compiler
from gen.builder.build import build_robot, hash_build, hash_manifest, is_intact, list_builds, locate_build
from gen.presets import find_presets
from gen.robot.description import RobotError
from gen.robot.load_robot import load as read

ROOT = Path(__file__).parents[2]


@pytest.fixture
def stub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Builds without compiling, from here on."""
    folder = tmp_path / "compiler"
    folder.mkdir()
    monkeypatch.setenv("CC", str(stub_compiler(folder)))
    compiler.find_compiler.cache_clear()
    yield folder
    compiler.find_compiler.cache_clear()


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(SMALL)
    return path


def snapshot(folder: Path) -> dict[str, tuple[int, int, bytes]]:
    """Inode, time and content of every file below a folder."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(p.relative_to(folder)): (p.stat().st_ino, p.stat().st_mtime_ns, p.read_bytes()) for p in files}


# -- what decides the name --------------------------------------------------------------------------------------------


def test_unchanged_robot_is_not_built_again(stub: Path, robot: Path, tmp_path: Path) -> None:
    out = tmp_path / "build"
    folder, made = build_robot(str(robot), "portable", out)
    assert made
    before, commands = snapshot(out), (stub / "commands").read_text()
    assert build_robot(str(robot), "portable", out) == (folder, False)
    assert snapshot(out) == before
    assert (stub / "commands").read_text() == commands


def test_unchanged_build_starts_no_symbolic_library(stub: Path, robot: Path, tmp_path: Path) -> None:
    out = tmp_path / "build"
    build_robot(str(robot), "portable", out)
    code = (
        "import sys; from gen.__main__ import main; code = main(sys.argv[1:])\n"
        "print([name for name in ('casadi', 'sympy', 'hdagen') if name in sys.modules]); sys.exit(code)"
    )
    command = [sys.executable, "-c", code, "build", str(robot), "--out", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)
    assert done.stderr == "unchanged (portable)\n"
    assert done.stdout.splitlines()[1] == "[]"


def test_everything_that_decides_the_outcome_is_in_the_name(stub: Path, robot: Path, tmp_path: Path) -> None:
    keys = {
        "as it is": hash_build(robot.read_bytes(), "portable", ()),
        "robot": hash_build(robot.read_bytes() + b"#", "portable", ()),
        "profile": hash_build(robot.read_bytes(), "native", ()),
        "effects": hash_build(robot.read_bytes(), "portable", ("rotor_coupling",)),
    }
    stub_compiler(stub, version="stub 2.0")
    compiler.find_compiler.cache_clear()
    keys["compiler"] = hash_build(robot.read_bytes(), "portable", ())
    assert len(set(keys.values())) == len(keys), keys
    stub_compiler(stub, sleep=0.001)
    compiler.find_compiler.cache_clear()
    assert hash_build(robot.read_bytes(), "portable", ()) == keys["as it is"]


def test_flags_processor_and_versions_are_in_the_name(stub: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    portable, native = hash_build(b"", "portable", ()), hash_build(b"", "native", ())
    with monkeypatch.context() as m:
        m.setattr(compiler, "cpu_flags", lambda: ("sve",))
        assert hash_build(b"", "native", ()) != native
        assert hash_build(b"", "portable", ()) == portable
    with monkeypatch.context() as m:
        m.setitem(compiler.PROFILES, "portable", ("-O1",))
        assert hash_build(b"", "portable", ()) != portable
    version = importlib.metadata.version
    for package in ("casadi", "numpy"):
        with monkeypatch.context() as m:
            m.setattr(importlib.metadata, "version", lambda p, changed=package: "0" if p == changed else version(p))
            assert hash_build(b"", "portable", ()) != portable


def test_every_source_of_the_generator_is_in_the_name(
    stub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = tmp_path / "presets" / "gen"  # a folder above that is called presets must not matter
    shutil.copytree(ROOT / "gen", copy, ignore=shutil.ignore_patterns("__pycache__"))
    before = hash_build(b"", "portable", ())
    monkeypatch.setattr(builds, "PACKAGE_FOLDER", copy)
    assert hash_build(b"", "portable", ()) == before
    changed = {before}
    sources = [
        p for p in sorted(copy.rglob("*")) if p.suffix in (".py", ".c", ".h", ".txt") and p.parent.name != "presets"
    ]
    assert {"harmonic_drive.py", "payload.py", "hda_step.c", "hda_guard.h", "CMakeLists.txt"} <= {
        p.name for p in sources
    }
    for path in sources:
        content = path.read_bytes()
        path.write_bytes(content + b" ")
        builds._read_own_files.cache_clear()  # no process does that: the code that it began with names its builds
        changed.add(hash_build(b"", "portable", ()))
        path.write_bytes(content)
    assert len(changed) == len(sources) + 1
    (copy / "model" / "harmonic_drive.py").rename(copy / "model" / "harmonic_drives.py")
    builds._read_own_files.cache_clear()
    assert hash_build(b"", "portable", ()) not in changed


def test_order_and_repetition_of_added_effects_do_not_matter(stub: Path, robot: Path, tmp_path: Path) -> None:
    first = build_robot(str(robot), "portable", tmp_path, ("rotor_coupling", "presliding_friction"))
    assert first[1]
    again = ("presliding_friction", "rotor_coupling", "presliding_friction")
    assert build_robot(str(robot), "portable", tmp_path, again) == (first[0], False)


# -- names ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("label", ["Arm (v2.0), left+right", "a" * 80, "LABELLED", "x_1.-,()+"])
def test_a_label_reaches_paths_and_c_as_its_slug_only(stub: Path, tmp_path: Path, label: str) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text(arm("R", name=label, rigid="r", drive="friction_smoothing = 1.0"))
    folder, _ = build_robot(str(robot), "portable", tmp_path / "build")
    assert re.fullmatch(r"[a-z][a-z0-9_]{0,47}-[0-9a-f]{16}", folder.name)
    assert folder.name.startswith(f"{read(str(robot)).slug}-")
    for path in folder.glob("*.[ch]"):
        assert label not in path.read_text(), path.name
    assert json.loads((folder / "manifest.json").read_text())["robot"]["name"] == label


HOSTILE = {
    "quote": 'arm\\"; system(\\"x\\"); \\"',
    "comment": "arm */ int x; /*",
    "newline": "arm\\n#include </etc/passwd>",
    "path": "../../outside",
    "absolute": "/etc/passwd",
    "C keyword": "register",
    "Python keyword": "lambda",
    "long": "a" * 2000,
    "empty": "",
    "dots": "..",
    "digits": "123",
    "null": "arm\\u0000",
    "shell": "$(touch hostile)",
    "unicode": "аrm",
}


@pytest.mark.parametrize("label", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_names_reach_neither_path_nor_compiler(
    stub: Path, tmp_path: Path, label: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    work = tmp_path / "a" / "b" / "work"
    work.mkdir(parents=True)
    monkeypatch.chdir(work)
    (work / "robot.toml").write_text(arm("R", name=label, rigid="r"))
    before = sorted(tmp_path.rglob("*"))
    assert main(["build", "robot.toml"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert re.fullmatch(r"robot\.toml, name: found .*, possible is .*; .*\.\n", said.err), said.err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("source", ["", "nothing.toml", "a\0b", "x" * 5000, "/", ".", "~/robot.toml"])
def test_what_is_no_robot_file_is_said_in_a_sentence(
    stub: Path, tmp_path: Path, source: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["build", source]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "possible is a robot.toml or one of" in said
    assert not (tmp_path / "build").exists()


def test_deeply_nested_and_marked_files_are_read_alike(stub: Path, tmp_path: Path) -> None:
    nested = tmp_path / "nested.toml"
    nested.write_text("x = " + "[" * 5000 + "]" * 5000)
    with pytest.raises(RobotError, match="too deeply nested"):
        build_robot(str(nested), "portable", tmp_path)
    marked = tmp_path / "marked.toml"
    marked.write_text("\N{BYTE ORDER MARK}" + SMALL, encoding="utf-8")
    assert build_robot(str(marked), "portable", tmp_path)[0].name.startswith("test_arm-")


def test_unknown_effects_are_named(stub: Path, robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "build"
    assert main(["build", str(robot), "--effects", "sticktion, wobble, rotor_coupling", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    found = r"found sticktion \(did you mean stribeck_friction\?\), wobble, possible are .*rotor_coupling.*; choose"
    assert re.search(found, said)
    assert not out.exists()


# -- damage -----------------------------------------------------------------------------------------------------------


def _edit(folder: Path, change: Callable[[dict], object], sealed: bool = False) -> None:
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    change(manifest)
    if sealed:
        manifest["seal"] = hash_manifest(manifest)
    path.write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n")


def _append(folder: Path, pattern: str) -> None:
    (path,) = folder.glob(pattern)
    path.write_bytes(path.read_bytes() + b" ")


DAMAGE: dict[str, Callable[[Path], object]] = {
    "library changed": lambda f: _append(f, "*.so"),
    "header changed": lambda f: _append(f, "hda_sizes.h"),
    "library gone": lambda f: next(f.glob("*.so")).unlink(),
    "source gone": lambda f: (f / "hda_step.c").unlink(),
    "source a folder": lambda f: ((f / "hda_step.c").unlink(), (f / "hda_step.c").mkdir()),
    "manifest gone": lambda f: (f / "manifest.json").unlink(),
    "manifest cut short": lambda f: os.truncate(f / "manifest.json", 1000),
    "manifest empty": lambda f: (f / "manifest.json").write_text(""),
    "manifest a list": lambda f: (f / "manifest.json").write_text("[]"),
    "manifest nested": lambda f: (f / "manifest.json").write_text("[" * 100000),
    "manifest not text": lambda f: (f / "manifest.json").write_bytes(b"\xff\xfe\x00"),
    "number changed": lambda f: _edit(f, lambda m: m["state"][0].update(bound=1e9)),
    "seal gone": lambda f: _edit(f, lambda m: m.pop("seal")),
    "of another build": lambda f: _edit(f, lambda m: m.update(build="0" * 16), sealed=True),
    "no files": lambda f: _edit(f, lambda m: m.update(files={}), sealed=True),
    "files a list": lambda f: _edit(f, lambda m: m.update(files=[*m["files"]]), sealed=True),
    "file elsewhere": lambda f: _edit(f, lambda m: m["files"].update({"/etc/hostname": "0"}), sealed=True),
    "another library": lambda f: _edit(f, lambda m: m.update(library="../evil.so"), sealed=True),
    "emptied": lambda f: (shutil.rmtree(f), f.mkdir()),
    "a file": lambda f: (shutil.rmtree(f), f.write_text("")),
    "a dead link": lambda f: (shutil.rmtree(f), f.symlink_to("nowhere")),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_damaged_forged_and_stale_builds_are_made_again(
    stub: Path, tmp_path: Path, damage: Callable[[Path], object]
) -> None:
    (tmp_path / "robot.toml").write_text(SMALL)
    out = tmp_path / "build"
    folder, _ = build_robot(str(tmp_path / "robot.toml"), "portable", out)
    name = folder.name.rpartition("-")[2]
    whole = {file: content for file, (_, _, content) in snapshot(folder).items()}
    assert is_intact(folder, name)
    damage(folder)
    assert not is_intact(folder, name)
    assert build_robot(str(tmp_path / "robot.toml"), "portable", out) == (folder, True)
    assert is_intact(folder, name)
    assert {file: content for file, (_, _, content) in snapshot(folder).items()} == whole
    assert sorted(p.name for p in out.iterdir()) == [".lock", ".objects", folder.name]


def test_a_build_renamed_to_another_hash_is_not_taken_for_it(stub: Path, robot: Path, tmp_path: Path) -> None:
    folder, _ = build_robot(str(robot), "portable", tmp_path)
    robot.write_text(SMALL + "#")
    stale, name, _ = locate_build(str(robot), "portable", tmp_path)
    shutil.copytree(folder, stale)
    assert not is_intact(stale, name)
    assert build_robot(str(robot), "portable", tmp_path) == (stale, True)


def test_a_loaded_library_outlives_damage_and_a_new_build(robot: Path, tmp_path: Path) -> None:
    out = tmp_path / "build"
    folder, _ = build_robot(str(robot), "portable", out)
    loaded = load(folder)
    c = loaded.prepare()
    before = loaded("mass_matrix", [0.3], c)[0]
    inode = next(folder.glob("*.so")).stat().st_ino
    _append(folder, "hda_step.c")
    assert build_robot(str(robot), "portable", out) == (folder, True)
    assert next(folder.glob("*.so")).stat().st_ino != inode, "the loaded file was written to"
    assert (loaded("mass_matrix", [0.3], c)[0] == before).all()
    assert (load(folder)("mass_matrix", [0.3], c)[0] == before).all()


# -- list -------------------------------------------------------------------------------------------------------------


def test_list_says_what_is_built(stub: Path, robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "build"
    assert main(["list", "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"nothing is built in {out}; `python -m gen build` builds the preset `paper`.\n"
    folder, _ = build_robot(str(robot), "portable", out)
    native, _ = build_robot(str(robot), "native", out)
    (native / "hda.h").write_text("")
    (out / "other").mkdir()
    (out / "note.txt").write_text("")
    found = {name: (what, whole) for name, what, whole in list_builds(out)}
    assert found == {
        folder.name: ("test arm: 1 joint, 2 states, portable", True),
        native.name: ("not a complete build", False),
        "other": ("not a complete build", False),
    }
    assert main(["list", "--out", str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(found)
    assert next(line for line in lines if line.startswith(folder.name)).endswith(
        "test arm: 1 joint, 2 states, portable"
    )
    assert next(line for line in lines if line.startswith(native.name)).endswith("`python -m gen build` makes it again")


def test_presets_build_under_their_own_names(stub: Path, tmp_path: Path) -> None:
    for name, path in find_presets().items():
        folder, _, content = locate_build(name, "portable", tmp_path)
        assert content == path.read_bytes()
        assert folder.name.startswith(f"{read(name).slug}-")
