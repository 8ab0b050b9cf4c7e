"""Builds: a robot file becomes a folder named by the hash of everything that goes into it, whole or not at all."""

from __future__ import annotations

import fcntl
import hashlib
import importlib.metadata
import json
import os
import shutil
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gen import compile as compiler
from gen.presets import presets
from gen.robot import LARGEST, Robot, load
from gen.rules import slug

HERE = Path(__file__).parent


class BuildError(Exception):
    """A build that cannot be made or kept; one sentence."""


def key(robot: bytes, profile: str, extra: tuple[str, ...]) -> str:
    """Hash of everything that decides the outcome: robot file, added effects, gen's own files, versions, compiler, flags, processor."""
    digest = hashlib.sha256()
    parts = [robot, profile.encode(), " ".join(extra).encode(), " ".join(compiler.flags(profile)).encode()]
    parts += [compiler.find().version.encode(), importlib.metadata.version("casadi").encode(), sys.platform.encode()]
    parts += [" ".join(compiler.cpu_flags()).encode() if profile == "native" else b""]
    for path in sorted(HERE.rglob("*")):
        if path.suffix in (".py", ".c", ".h", ".txt") and "presets" not in path.parts:
            parts += [str(path.relative_to(HERE)).encode(), path.read_bytes()]
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()[:16]


def build(source: str, profile: str, out: Path, extra: tuple[str, ...] = ()) -> tuple[Path, bool]:
    """Build the robot (preset or path) with ``extra`` effects added; returns the folder and whether anything was made.

    Raises RobotError, CompileError, BuildError. An intact build is used as it is; a damaged one is put aside and made again.
    """
    path = presets().get(source, Path(source))
    if not path.is_file() or path.stat().st_size > LARGEST:
        load(source)  # says what is wrong
    content = path.read_bytes()
    name = key(content, profile, extra)
    label = slug(_name(content))
    folder = out / f"{label}-{name}"
    if intact(folder, name):
        return folder, False
    try:
        out.mkdir(parents=True, exist_ok=True)
        with _lock(out / f".{label}-{name}.lock"):
            if intact(folder, name):  # another process made it meanwhile
                return folder, False
            robot = load(source)
            if path.read_bytes() != content:
                raise BuildError(f"{source}: the file changed while it was read; build again.")
            _make(robot, profile, extra, folder, name)
    except OSError as error:
        raise BuildError(f"{out}: the build could not be written ({error.strerror or error}); nothing was changed. Free space or name a writable folder with --out.") from error
    return folder, True


def _name(content: bytes) -> str:
    try:
        name = tomllib.loads(content.decode()).get("name", "arm")
    except (tomllib.TOMLDecodeError, UnicodeDecodeError):
        return "arm"  # the full check of the file says what is wrong
    return name if isinstance(name, str) else "arm"


def _make(robot: Robot, profile: str, extra: tuple[str, ...], folder: Path, name: str) -> None:
    from gen import sources  # noqa: PLC0415 - casadi, which an intact build does not need
    from gen.effects import ALL, NOMINAL  # noqa: PLC0415
    from gen.library import library as everything  # noqa: PLC0415
    from gen.model import Model  # noqa: PLC0415

    out = folder.parent
    wanted = {stated.name for stated in robot.effects} | set(extra)
    unknown = set(extra) - {effect.name for effect in ALL}
    if unknown:
        raise BuildError(f"--effects: no effect named {', '.join(sorted(unknown))}; there are {', '.join(e.name for e in ALL)}.")
    effects = tuple(e for e in ALL if e in NOMINAL or e.name in wanted)
    made = everything(Model(robot, effects))
    library = f"hda_{name}.so"
    how = {
        "profile": profile,
        "compiler": compiler.find().version,
        "flags": compiler.flags(profile),
        "cpu": compiler.cpu_flags() if profile == "native" else (),
        "library": library,
    }
    print(f"building {robot.name} ({profile}) into {folder}", file=sys.stderr, flush=True)
    files = sources.texts(made, effects, name, how, profile == "native")
    for stale in out.glob(f".{folder.name}.part-*"):  # left by a build that was killed; the lock is ours
        shutil.rmtree(stale, ignore_errors=True)
    part = out / f".{folder.name}.part-{os.getpid()}"
    try:
        part.mkdir()
        for file, text in files.items():
            (part / file).write_text(text)
        compiler.library(part, sorted(f for f in files if f.endswith(".c") and f != "example.c"), profile, library)
        manifest = json.loads(files["manifest.json"])
        manifest["files"] = {f.name: _hash(f) for f in sorted(part.iterdir()) if f.name != "manifest.json"}
        (part / "manifest.json").write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n")
        for path in [*part.iterdir(), part]:
            _sync(path)
        if folder.exists():
            aside = out / f".{folder.name}.part-damaged-{os.getpid()}"
            folder.rename(aside)  # a library that is loaded from it stays mapped and whole
        part.rename(folder)
        _sync(out)
        shutil.rmtree(out / f".{folder.name}.part-damaged-{os.getpid()}", ignore_errors=True)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def intact(folder: Path, name: str) -> bool:
    """Whether the folder is a complete build of that name with every file as it was written."""
    try:
        manifest = json.loads((folder / "manifest.json").read_text())
        return manifest["build"] == name and all(_hash(folder / file) == digest for file, digest in manifest["files"].items())
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        return False


def listing(out: Path) -> Iterator[tuple[str, str, bool]]:
    """(folder, what it is, intact) of every build."""
    for folder in sorted(out.iterdir()) if out.is_dir() else []:
        if folder.is_dir() and not folder.name.startswith("."):
            name = folder.name.rpartition("-")[2]
            whole = intact(folder, name)
            what = "not a complete build"
            if whole:
                m = json.loads((folder / "manifest.json").read_text())
                what = f"{m['robot']['name']}: {len(m['robot']['joints'])} joints, {len(m['state'])} states, {m['profile']}"
            yield folder.name, what, whole


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def _lock(path: Path) -> Iterator[None]:
    with path.open("w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
