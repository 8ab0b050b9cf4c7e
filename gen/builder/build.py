"""Builds: a robot file becomes a folder named by the hash of everything that goes into it, whole or not at all."""

from __future__ import annotations

import fcntl
import hashlib
import importlib.metadata
import json
import os
import platform
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gen.builder import compiler, object_cache
from gen.builder.build_progress import StageListener, ignore_stage
from gen.builder.ownership import find_other_writer
from gen.mpc.problem_structure import Structure, StructureError, check_memory
from gen.presets import find_presets
from gen.robot.consistency_checks import make_slug
from gen.robot.description import Robot, RobotError
from gen.robot.load_robot import label_source, load
from gen.robot.robot_text import parse_robot, read_robot
from gen.robot.value_reader import quote_key, suggest_nearest

if TYPE_CHECKING:
    from gen.builder.step_stability import StepExamination
    from gen.effects.effect import Effect
    from gen.model.function_library import Library

PACKAGE_FOLDER = Path(__file__).parents[1]
OBJECT_FOLDER = ".objects"  # beside the builds: compiled objects that robots of the same structure share
PARTIAL_BUILD_PREFIX = ".part-"  # begins the names of folders that are being made or thrown away
MANIFEST_ERRORS = (
    OSError,
    ValueError,
    KeyError,
    AttributeError,
    TypeError,
    RecursionError,
)  # of a manifest that is not ours


class BuildError(Exception):
    """A build that cannot be made or kept; one sentence."""


def hash_build(robot: bytes, profile: str, extra: tuple[str, ...], mpc: Structure | None = None) -> str:
    """Name a build by everything that decides its content.

    Args:
        robot: The robot file as read.
        profile: ``portable`` or ``native``.
        extra: Names of the effects to add, sorted.
        mpc: Structure of the predictive controller; None leaves it out.

    Returns:
        A hash of these and of gen's files, versions, compiler, flags and processor.

    Raises:
        BuildError: A package that a build needs is missing.
        CompileError: There is no compiler.

    """
    digest = hashlib.sha256()
    parts = [robot, profile.encode(), " ".join(extra).encode(), " ".join(compiler.compiler_flags(profile)).encode()]
    parts += [compiler.find_compiler().version.encode(), sys.platform.encode(), platform.machine().encode()]
    parts += [_find_version("casadi").encode(), _find_version("numpy").encode()]
    processor = b""
    if profile == "native":
        processor = " ".join(compiler.cpu_flags()).encode()
    parts.append(processor)
    if mpc:
        parts += [mpc.text.encode(), _find_version("osqp").encode()]
    for part in (*parts, *_read_own_files(PACKAGE_FOLDER)):
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()[:16]


@cache
def _read_own_files(folder: Path) -> tuple[bytes, ...]:
    """Names and contents of gen's own files; read once, for the process goes on with the code that it began with."""
    parts = []
    for path in sorted(folder.rglob("*")):
        own = path.relative_to(folder)
        if path.suffix in (".py", ".c", ".h", ".txt") and "presets" not in own.parts:
            parts += [own.as_posix().encode(), path.read_bytes()]
    return tuple(parts)


def _find_version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        raise BuildError(
            f"{package} is not installed, and a robot cannot be built without it; pip install {package}."
        ) from None


def locate_build(
    source: str, profile: str, out: Path, extra: tuple[str, ...] = (), mpc: Structure | None = None
) -> tuple[Path, str, bytes]:
    """Find the place of a build.

    Args:
        source: A preset's name or the path of a robot.toml.
        profile: ``portable`` or ``native``.
        out: The folder of all builds.
        extra: Names of the effects to add, sorted.
        mpc: Structure of the predictive controller; None leaves it out.

    Returns:
        The folder of the build, its hash, and the robot file as read.

    Raises:
        RobotError: The robot file cannot be read.
        CompileError: There is no compiler.
        BuildError: A package that a build needs is missing.

    """
    label = label_source(source)
    content = read_robot(find_presets().get(source, Path(source)), label)
    stated = parse_robot(content, label).get("name")
    if not isinstance(stated, str):
        stated = "arm"
    name = hash_build(content, profile, extra, mpc)
    return out / f"{make_slug(stated)}-{name}", name, content


def build_robot(
    source: str,
    profile: str,
    out: Path,
    extra: tuple[str, ...] = (),
    mpc: Structure | None = None,
    on_stage: StageListener = ignore_stage,
) -> tuple[Path, bool]:
    """Build a robot.

    An intact build is used as it is; a damaged one, or one that another user may write, is put aside and made again.

    Args:
        source: A preset's name or the path of a robot.toml.
        profile: ``portable`` or ``native``.
        out: The folder of all builds.
        extra: Names of the effects to add.
        mpc: Structure of the predictive controller; None leaves it out.
        on_stage: Is told each stage as it begins.

    Returns:
        The folder of the build, and whether it was made just now.

    Raises:
        RobotError: The robot file cannot be used.
        CompileError: There is no compiler, or it failed.
        BuildError: The build cannot be made or kept.

    """
    extra = tuple(sorted(set(extra)))
    folder, name, content = locate_build(source, profile, out, extra, mpc)
    if is_intact(folder, name):
        return folder, False
    on_stage("writing the equations")
    library, effects, examined = assemble_library(source, load(source), extra)
    if refused := examined.refusals(source):
        raise RobotError(refused)
    _check_memory(mpc, library)
    if locate_build(source, profile, out, extra, mpc)[2] != content:
        raise BuildError(f"{source}: the file changed while it was read; build again.")
    try:
        out.mkdir(mode=0o755, parents=True, exist_ok=True)
        with lock_folder(out / ".lock"):
            if is_intact(folder, name):  # another process made it meanwhile
                return folder, False
            print(f"building {library.graphs.model.robot.name} ({profile}) into {folder}", file=sys.stderr, flush=True)
            for stale in out.glob(f".*{PARTIAL_BUILD_PREFIX}*"):  # left by a build that was killed; the lock is ours
                _remove_tree(stale)
            object_cache.discard_parts(out / OBJECT_FOLDER)
            _write_build(library, effects, profile, folder, name, mpc, on_stage)
    except OSError as error:
        why = error.strerror or error
        raise BuildError(
            f"{out}: the build could not be written ({why}); nothing was changed. Free space, or name a "
            "writable folder with --out."
        ) from error
    return folder, True


def _check_memory(mpc: Structure | None, made: Library) -> None:
    """Raise BuildError where the predictive controller is too large."""
    n, flexible = made.graphs.model.n, len(made.graphs.model.flexible)
    try:
        if mpc:
            check_memory(mpc, n, 2 * n + 2 * flexible)
    except StructureError as error:
        raise BuildError(str(error)) from None


def assemble_library(
    source: str, robot: Robot, extra: tuple[str, ...]
) -> tuple[Library, tuple[Effect, ...], StepExamination]:
    """Assemble everything that a build emits.

    Args:
        source: The robot's name in errors.
        robot: The robot description.
        extra: Names of the effects to add; ``missing_compliance@2`` gives joint 2 a spring, ``missing_compliance``
            every rigid drive.

    Returns:
        The functions to emit, the effects in them, and the examination of the robot's step.

    Raises:
        BuildError: There is no such effect.
        RobotError: The parameters give no model.

    """
    from gen.builder import step_stability  # casadi, which an intact build does not need
    from gen.effects import ALL, NOMINAL
    from gen.model.arm_model import Model
    from gen.model.function_library import make_library
    from gen.robot.flexible_drive import add_springs, split_spring_effects

    sprung, extra = split_spring_effects(extra, len(robot.joints))
    unknown = set(extra) - {effect.name for effect in ALL}
    if unknown:
        names = [effect.name for effect in ALL]
        found = ", ".join(f"{quote_key(name)}{suggest_nearest(name, names)}" for name in sorted(unknown))
        raise BuildError(f"--effects: found {found}, possible are {', '.join(names)}; choose of these.")
    wanted = {stated.name for stated in robot.effects} | set(extra)
    robot = add_springs(robot, sprung)
    try:
        applies = Model(robot, NOMINAL).joints_of_effect
        added = {e.name for e in ALL if e.name in wanted and applies(e.choose_form(robot.in_space))}
        model = Model(robot, tuple(e for e in ALL if e in NOMINAL or e.name in added))
        effects, library = model.effects, make_library(model)
        examined = step_stability.examine_step(library.graphs)
    except ValueError as error:
        raise RobotError([f"{source}, joint: {error}."]) from None
    return library, effects, examined


def _write_build(
    made: Library,
    effects: tuple[Effect, ...],
    profile: str,
    folder: Path,
    name: str,
    mpc: Structure | None,
    on_stage: StageListener,
) -> None:
    """Make the folder beside its place and move it there; the lock is held."""
    from gen.builder import build_files

    library = f"hda_{name}.so"
    how: dict[str, Any] = {
        "profile": profile,
        "compiler": compiler.find_compiler().version,
        "flags": compiler.compiler_flags(profile),
        "cpu": (),
        "library": library,
    }
    if profile == "native":
        how["cpu"] = compiler.cpu_flags()
    on_stage("printing the C")
    files = build_files.make_files(made, effects, name, how, profile == "native", mpc)
    part = folder.with_name(f".{folder.name}{PARTIAL_BUILD_PREFIX}{os.getpid()}")
    aside = part.with_name(f"{part.name}-old")
    try:
        part.mkdir(mode=0o755)
        for file, text in files.items():
            (part / file).write_text(text, encoding="utf-8", newline="\n")
        compiled = sorted(f for f in files if f.endswith(".c") and not f.startswith("example"))
        kept: Path | None = folder.parent / OBJECT_FOLDER
        if find_other_writer(folder.parent / OBJECT_FOLDER):
            kept = None
        compiler.compile_library(part, compiled, profile, library, kept, on_stage)
        manifest = json.loads(files["manifest.json"])
        manifest["files"] = {f.name: _hash_file(f) for f in sorted(part.iterdir()) if f.name != "manifest.json"}
        manifest["seal"] = hash_manifest(manifest)
        (part / "manifest.json").write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n")
        for path in part.iterdir():
            path.chmod(path.stat().st_mode & ~0o022)  # whatever the umask: files that others may write are not loaded
            _sync_to_disk(path)
        _sync_to_disk(part)
        if os.path.lexists(folder):
            folder.rename(aside)  # a library that is loaded from it stays mapped and whole
        part.rename(folder)
        _sync_to_disk(folder.parent)
    finally:
        _remove_tree(part)
        _remove_tree(aside)


def hash_manifest(manifest: dict[str, Any]) -> str:
    """Hash a manifest: against damage, not against someone who may write in the folder.

    Args:
        manifest: The manifest.

    Returns:
        The hash of everything but its seal.

    """
    rest = {name: value for name, value in manifest.items() if name != "seal"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def is_intact(folder: Path, name: str) -> bool:
    """Tell whether a folder is a complete build with every file as it was written, by nobody else.

    Args:
        folder: The folder.
        name: The hash of the build (`hash_build`).

    Returns:
        True where it is; a folder that cannot be read counts as damaged.

    """
    try:
        manifest = json.loads((folder / "manifest.json").read_text())
        files, library = manifest["files"], manifest["library"]
        ours = manifest["build"] == name and library == f"hda_{name}.so" and library in files
        plain = all(Path(file).name == file for file in files)
        shared = any(find_other_writer(folder / file) for file in (*files, "manifest.json"))
        return bool(
            ours
            and plain
            and not shared
            and manifest["seal"] == hash_manifest(manifest)
            and all(_hash_file(folder / f) == h for f, h in files.items())
        )
    except MANIFEST_ERRORS:
        return False


def list_builds(out: Path) -> Iterator[tuple[str, str, bool]]:
    """List the builds in a folder.

    Args:
        out: The folder of all builds.

    Yields:
        The build's folder, a description of its content, and whether it is intact.

    """
    if not out.is_dir():
        return
    for folder in sorted(out.iterdir()):
        if folder.is_dir() and not folder.name.startswith("."):
            whole = is_intact(folder, folder.name.rpartition("-")[2])
            content = "not a complete build"
            if whole:
                m = json.loads((folder / "manifest.json").read_text())
                joints, states = len(m["robot"]["joints"]), len(m["state"])
                content = f"{m['robot']['name']}: {joints} joint{'s' * (joints > 1)}, {states} states, {m['profile']}"
            yield folder.name, content, whole


def _hash_file(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _remove_tree(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    elif os.path.lexists(path):
        path.unlink()


def _sync_to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def lock_folder(path: Path) -> Iterator[None]:
    """Let one process at a time write in a folder of builds; the lock ends with the process that holds it.

    Args:
        path: The lock's file.

    Yields:
        Nothing, while the lock is held.

    """
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
