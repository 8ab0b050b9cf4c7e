"""What another user may write is neither run nor copied into a build; where builds lie that are made on first use."""

from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from arms import SMALL, arm
from compiled import Compiled
from stub_compiler import stub_compiler

import hdagen
from gen.builder import compiler
from gen.builder.build import OBJECT_FOLDER, BuildError
from gen.builder.build import build_robot as make
from hdagen.__main__ import main
from hdagen.arm.build_loader import PlantError, find_build_folder
from hdagen.arm.compiled_arm import Arm
from hdagen.support.ownership import find_other_writer

ROOT = Path(__file__).parents[2]
NOBODY = 65534
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root may give a file to another user or group")


@pytest.fixture
def folder(build: Callable[..., Compiled], tmp_path: Path) -> Path:
    """A copy of a build in a folder of its own."""
    source = build(SMALL).folder
    return Path(shutil.copytree(source, tmp_path / "builds" / source.name))


def refused(folder: Path) -> str:
    """Why the build is not loaded, one sentence."""
    with pytest.raises(PlantError, match="compiled code is not run from there, for ") as caught:
        Arm(folder)
    (said,) = str(caught.value).splitlines()
    assert "chmod go-w" in said and "$HDAGEN_BUILD" in said
    return said


# -- the rule ---------------------------------------------------------------------------------------------------------


def test_both_halves_have_the_same_rule() -> None:
    assert (ROOT / "gen/builder/ownership.py").read_bytes() == (ROOT / "hdagen/support/ownership.py").read_bytes()


@pytest.mark.parametrize(
    "mode, who",
    [(0o700, ""), (0o755, ""), (0o1777, ""), (0o3777, ""), (0o777, "everyone"), (0o702, "everyone")],
)
def test_a_folder_counts_by_who_may_write_it(tmp_path: Path, mode: int, who: str) -> None:
    place = tmp_path / "place"
    (place / "inside").mkdir(parents=True)
    (place / "inside" / "file").write_text("")
    place.chmod(mode)
    said = find_other_writer(place / "inside" / "file")
    assert said == (f"{place} may be written by {who}" if who else "")
    assert find_other_writer(place / "inside" / "not" / "there" / "yet") == said


@needs_root
@pytest.mark.parametrize("sticky", [False, True])
def test_a_group_of_others_counts_unless_the_folder_is_sticky(tmp_path: Path, sticky: bool) -> None:
    place = tmp_path / "place"
    place.mkdir()
    os.chown(place, 0, NOBODY)
    place.chmod(0o1775 if sticky else 0o775)
    said = find_other_writer(place / "file")
    assert not said if sticky else said.startswith(f"{place} may be written by the group ")


@needs_root
def test_what_another_user_owns_counts(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("")
    assert not find_other_writer(path)
    os.chown(path, NOBODY, 0)
    assert find_other_writer(path).startswith(f"{path} belongs to the user ")


AS_ANOTHER = """
import os, sys, tempfile
sys.path.insert(0, sys.argv[1])
from hdagen.support import ownership
from pathlib import Path
from types import SimpleNamespace
os.setgroups([]); os.setgid({user}); os.setuid({user}); os.umask(0o002)
known = SimpleNamespace(pw_gid={user}, pw_name="someone"), SimpleNamespace(gr_gid={user}, gr_name="{group}", gr_mem=[])
ownership.pwd = SimpleNamespace(getpwuid=lambda number: known[0])
ownership.grp = SimpleNamespace(getgrgid=lambda number: known[1])
folder = Path(tempfile.mkdtemp()) / "mine"
folder.mkdir()
assert folder.stat().st_mode & 0o777 == 0o775
print(ownership.find_other_writer(folder))
os.rmdir(folder); os.rmdir(folder.parent)
"""


@needs_root
@pytest.mark.parametrize("group, private", [("someone", True), ("staff", False)])
def test_a_umask_of_002_is_fine_with_a_group_of_one_s_own(group: str, private: bool) -> None:
    code = AS_ANOTHER.format(user=NOBODY, group=group)
    command = [sys.executable, "-c", code, str(ROOT)]
    environment = {k: v for k, v in os.environ.items() if k != "TMPDIR"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().endswith("" if private else "may be written by the group staff")
    assert bool(done.stdout.strip()) is not private


# -- loading ----------------------------------------------------------------------------------------------------------


def test_a_build_that_others_may_write_is_not_loaded(folder: Path) -> None:
    library = folder / json.loads((folder / "manifest.json").read_text())["library"]
    for place, mode in ((folder.parent, 0o755), (folder, 0o755), (library, 0o755), (folder / "manifest.json", 0o644)):
        place.chmod(mode | stat.S_IWOTH)
        assert f"for {place} may be written by everyone" in refused(folder)
        place.chmod(mode)
    assert Arm(folder).n == 1


@needs_root
def test_a_build_of_another_user_is_not_loaded(folder: Path, tmp_path: Path) -> None:
    for place in (folder.parent, folder, folder / "manifest.json"):
        os.chown(place, NOBODY, NOBODY)
        assert f"for {place} belongs to the user " in refused(folder)
        os.chown(place, 0, 0)
    link = tmp_path / folder.name
    link.symlink_to(folder)
    assert Arm(link).n == 1
    os.chown(folder, NOBODY, NOBODY)
    refused(link)


def test_nothing_is_built_where_it_could_not_be_loaded(tmp_path: Path) -> None:
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o777)
    with pytest.raises(PlantError, match="may be written by everyone"):
        hdagen.load_robot("emps", out=tmp_path / "shared" / "builds")
    assert list((tmp_path / "shared").iterdir()) == []


def test_a_folder_in_the_place_of_a_robot_is_loaded_only_where_that_is_asked_for(
    build: Callable[..., Compiled], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = build("paper").folder
    with pytest.raises(PlantError, match=r"found the folder of a build, possible are a preset or a robot\.toml"):
        hdagen.load_robot(folder)
    log = tmp_path / "log.csv"
    wanted = ["simulate", str(folder), "--seconds", "1", "--controller", "position", "--out", str(log), "--json"]
    assert main(wanted) == 2
    assert "--built" in capsys.readouterr().err
    assert main([*wanted, "--built"]) == 0
    assert main(["replay", str(folder), str(log), "--json"]) == 2
    assert main(["replay", str(folder), str(log), "--built", "--json"]) == 0
    assert main(["replay", str(folder), str(log), "--built", "--with", "diagnosis.json"]) == 2


# -- building ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def stub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The stub compiler; its commands are listed beside it."""
    monkeypatch.setenv("CC", str(stub_compiler(tmp_path)))
    compiler.find_compiler.cache_clear()
    yield tmp_path
    compiler.find_compiler.cache_clear()


@pytest.fixture
def robot(stub: Path) -> Path:
    path = stub / "robot.toml"
    path.write_text(arm("R", rigid="r", drive="friction_smoothing = 1.0"))
    return path


def compiled(folder: Path) -> bool:
    """Whether something was compiled since this was asked last."""
    lines = (folder / "commands").read_text().splitlines()
    (folder / "commands").write_text("")
    return any(" -c " in line for line in lines)


def test_where_others_may_write_nothing_is_taken_and_no_object_is_kept(stub: Path, robot: Path) -> None:
    out = stub / "build"
    out.mkdir()
    out.chmod(0o777)
    first, _ = make(str(robot), "portable", out)
    assert sorted(path.name for path in out.iterdir()) == [".lock", first.name]
    assert compiled(stub)
    assert make(str(robot), "portable", out) == (first, True), "taken as it was, though others could have written it"
    out.chmod(0o755)
    assert make(str(robot), "portable", out) == (first, False)


@pytest.mark.parametrize("how", ["folder", "file"])
def test_an_object_that_others_may_write_is_not_taken(stub: Path, robot: Path, how: str) -> None:
    out = stub / "build"
    make(str(robot), "portable", out)
    assert (out / OBJECT_FOLDER).stat().st_mode & 0o777 == 0o700
    assert compiled(stub)
    for path in [out / OBJECT_FOLDER] if how == "folder" else (out / OBJECT_FOLDER).iterdir():
        path.chmod(0o777)
    robot.write_text(robot.read_text().replace("mass = ", "mass = 1", 1))
    make(str(robot), "portable", out)
    assert compiled(stub)


def test_what_a_killed_build_left_among_the_objects_is_removed(stub: Path, robot: Path) -> None:
    left = stub / "build" / OBJECT_FOLDER / ".part-0123456789abcdef"
    left.parent.mkdir(parents=True, mode=0o700)
    left.write_text("half")
    make(str(robot), "portable", stub / "build")
    assert not left.exists() and list(left.parent.glob("*.o"))


def test_a_build_is_nobody_else_s_whatever_the_umask(stub: Path, robot: Path) -> None:
    before = os.umask(0)
    try:
        folder, _ = make(str(robot), "portable", stub / "build")
    finally:
        os.umask(before)
    assert [path for path in (folder.parent, folder, *folder.iterdir()) if path.stat().st_mode & 0o022] == []


def test_a_lock_that_is_a_link_is_not_followed(stub: Path, robot: Path) -> None:
    (stub / "build").mkdir()
    (stub / "mine").write_text("mine")
    (stub / "build" / ".lock").symlink_to(stub / "mine")
    with pytest.raises(BuildError, match="could not be written"):
        make(str(robot), "portable", stub / "build")
    assert (stub / "mine").read_text() == "mine"


# -- where builds lie -------------------------------------------------------------------------------------------------


def test_builds_of_first_use_lie_in_the_user_s_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HDAGEN_BUILD", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # which does not count
    assert find_build_folder() == tmp_path / "home" / ".cache" / "hdagen"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    assert find_build_folder() == tmp_path / "caches" / "hdagen"
    assert find_build_folder().stat().st_mode & 0o777 == 0o700
    assert sorted(path.name for path in tmp_path.iterdir()) == ["caches", "home"], "something in the working folder"
    (tmp_path / "build").mkdir()
    assert find_build_folder() == Path("build")
    monkeypatch.setenv("HDAGEN_BUILD", str(tmp_path / "elsewhere"))
    assert find_build_folder() == tmp_path / "elsewhere"
    assert find_build_folder(tmp_path / "asked") == tmp_path / "asked"


def test_a_cache_that_cannot_be_made_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HDAGEN_BUILD", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(PlantError, match=r"cannot be made \(.*\); name a folder in \$HDAGEN_BUILD\."):
        find_build_folder()
