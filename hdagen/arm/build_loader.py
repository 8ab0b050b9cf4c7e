"""Finding, making, checking and loading builds, so that no foreign or damaged library enters the process."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import sys
import sysconfig
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from hdagen.arm.generator import run_generator
from hdagen.arm.received_builds import BuildRequest, find_received_build
from hdagen.model_import.model_file import ModelError, is_model_file
from hdagen.support.atomic_write import write_atomically
from hdagen.support.messages import make_printable, show_path
from hdagen.support.ownership import find_other_writer

IMPORTED_FOLDER = ".models"  # beside the builds: robot files made of URDF and MJCF models
MANIFEST_SCHEMA = 1
INTERFACE = 2  # of the manifest and the library, by the number that gen writes into both; others are called wrongly
BUILD_PROFILES = ("portable", "native")
MOST_PATH_BYTES = 4096  # bytes of a path
MOST_ERROR_LINES = 200  # lines of an error
_NO_COMPILER_CODE = 6  # exit code of gen


class PlantError(Exception):
    """A build that cannot be made, loaded or called; one printable line a problem, of very many the first."""

    def __init__(self, text: object) -> None:
        lines = str(text).split("\n")
        listed = [make_printable(line.expandtabs()) for line in lines[:MOST_ERROR_LINES]]
        if len(lines) > MOST_ERROR_LINES:
            listed.append(f"{len(lines) - MOST_ERROR_LINES} more are not listed: mend these first.")
        super().__init__("\n".join(listed))


class _NoCompilerError(PlantError):
    """What gen says where there is no C compiler."""


class MissingCompilerError(PlantError):
    """A build that this machine cannot make, for it has no C compiler."""

    def __init__(self, text: object, wanted: BuildRequest) -> None:
        super().__init__(text)
        self.wanted = wanted


class StructuredController(Protocol):
    """A predictive controller's configuration, as far as its compilation depends on it."""

    @property
    def structure(self) -> str:
        """The structure, as `python -m gen build --mpc` takes it."""

    def find_incompatibilities(self, robot: Mapping[str, Any]) -> list[str]:
        """Find the reasons why the configuration cannot be used with a robot.

        Args:
            robot: The robot, as a build's manifest describes it.

        Returns:
            One sentence for each problem.

        """


def find_or_build(
    robot: str | Path,
    profile: str,
    effects: tuple[str, ...],
    out: str | Path | None,
    mpc: StructuredController | None = None,
) -> Path:
    """Find the folder of a robot's build; a child process builds it where it does not exist yet.

    Args:
        robot: A preset or the path of a robot.toml.
        profile: "portable" or "native".
        effects: Effects that are added to the model.
        out: The folder where builds lie; None: as `find_build_folder` finds it.
        mpc: The predictive controller to be compiled, checked against the robot first.

    Returns:
        The folder of the build.

    Raises:
        PlantError: An argument will not do, or the build fails.

    """
    name = os.fspath(robot)
    if not name or "\0" in name or len(name) > MOST_PATH_BYTES:
        raise PlantError(f"{name[:40]!r} names no robot; give a preset, a robot.toml, or the folder of a build.")
    if (Path(name) / "manifest.json").is_file():
        raise PlantError(
            f"{name}: found the folder of a build, possible are a preset or a robot.toml; a build's compiled code is "
            "run only where that is asked for: hdagen.Arm(folder) in Python, --built in `hdagen simulate` and "
            "`hdagen replay`."
        )
    if profile not in BUILD_PROFILES:
        raise PlantError(f"no profile named {profile}; there are {', '.join(BUILD_PROFILES)}.")
    if isinstance(effects, str):
        raise PlantError(f"effects takes names in a tuple, such as ({effects!r},).")
    folder = find_build_folder(out)
    refuse_other_writers(folder)
    name = find_robot_file(name, folder)
    if mpc and (problems := mpc.find_incompatibilities(json.loads("\n".join(_run_gen("describe", "--", name))))):
        raise PlantError("\n".join(problems))
    structure = ""
    if mpc:
        structure = mpc.structure
    wanted = [f"--effects={','.join(effects)}", f"--mpc={structure}"]
    try:
        return Path(_run_gen("build", "--progress", "--profile", profile, f"--out={folder}", *wanted, "--", name)[-1])
    except _NoCompilerError as error:
        request = BuildRequest(name, profile, effects, structure)
        if (received := find_received_build(folder, request)) is not None:
            return received
        raise MissingCompilerError(error, request) from None


def find_robot_file(robot: str, folder: Path) -> str:
    """Find the robot file of a robot; a URDF or MJCF model is imported first, and what was assumed is reported.

    Args:
        robot: A preset, a robot.toml, or a model.
        folder: The folder where builds lie, in which the imported robot file is kept.

    Returns:
        The preset, or the robot file's path.

    Raises:
        PlantError: The model cannot be imported.

    """
    if not is_model_file(robot):
        return robot
    from hdagen.model_import.robot_writing import import_model

    try:
        made = import_model(robot)
    except ModelError as error:
        raise PlantError(str(error)) from None
    content = made.text.encode()
    kept = folder / IMPORTED_FOLDER / f"{hashlib.sha256(content).hexdigest()[:16]}.toml"
    if not kept.is_file() or kept.read_bytes() != content:
        kept.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
        write_atomically(kept, content)
        told = "; ".join(made.notes)
        print(f"{show_path(robot)}: imported; {told}; `hdagen robot import` writes the file", file=sys.stderr)
    return str(kept)


def find_build_folder(out: str | Path | None = None) -> Path:
    """Find the folder where builds lie.

    Args:
        out: The folder that the caller names, if any.

    Returns:
        ``out``, else $HDAGEN_BUILD, else ./build where it exists, else ``hdagen`` in the user's cache
        ($XDG_CACHE_HOME or ~/.cache), which is made with mode 0700.

    Raises:
        PlantError: The cache cannot be found or made.

    """
    if named := out or os.environ.get("HDAGEN_BUILD"):
        return Path(named)
    if os.path.lexists("build"):
        return Path("build")
    try:
        caches = Path(os.environ.get("XDG_CACHE_HOME", ""))
        if not caches.is_absolute():
            caches = Path.home() / ".cache"
        folder = caches / "hdagen"
        _make_private_folder(folder)
    except (OSError, RuntimeError) as error:
        why = getattr(error, "strerror", None) or error
        raise PlantError(
            f"~/.cache/hdagen: the folder for builds cannot be made ({why}); name a folder in $HDAGEN_BUILD."
        ) from None
    return folder


def _make_private_folder(folder: Path) -> None:
    """Make a folder, and those above it that are missing, for this user alone."""
    if not folder.is_dir():
        _make_private_folder(folder.parent)
        folder.mkdir(mode=0o700, exist_ok=True)


def refuse_other_writers(path: Path) -> None:
    """Refuse to run code from a place that another user could have written.

    Args:
        path: A file or folder.

    Raises:
        PlantError: Another user may write there, or the place cannot be looked at.

    """
    try:
        why = find_other_writer(path)
    except (OSError, RuntimeError) as error:
        why = f"it cannot be looked at ({getattr(error, 'strerror', None) or error})"
    if why:
        raise PlantError(
            f"{path}: compiled code is not run from there, for {why}; possible is what only you and root may write, "
            "all the way up: take the right from others (chmod go-w), or name a folder of your own in $HDAGEN_BUILD."
        )


def find_stable_settings(robot: Path) -> tuple[float, tuple[float, ...]]:
    """Find a step and widths of smooth friction with which a robot.toml can be built.

    Args:
        robot: The robot.toml.

    Returns:
        The step, s, and the width of each joint's smooth friction, rad/s: the file's own where those will do.

    Raises:
        PlantError: Anything else is wrong with the file.

    """
    said = json.loads("\n".join(_run_gen("mend", "--", os.fspath(robot))))
    return said["step"], tuple(said["friction_smoothing"])


def _run_gen(*arguments: str) -> tuple[str, ...]:
    """Run `python -m gen` in a child process and return the lines that it prints. Raises PlantError."""
    done = run_generator(*arguments)
    if done.code == _NO_COMPILER_CODE:
        raise _NoCompilerError("\n".join(done.messages))
    if done.code or not done.lines:
        raise PlantError("\n".join(done.messages) or f"the build of {arguments[-1]} failed without a word.")
    return done.lines


def advise_rebuild(folder: Path) -> str:
    """Say how to replace a build that cannot be used.

    Args:
        folder: The folder of the build.

    Returns:
        The end of a sentence.

    """
    return f"remove {folder} and build again with `hdagen build ROBOT`."


def open_build(folder: Path) -> tuple[dict[str, Any], Any]:
    """Check and load a build.

    Args:
        folder: The folder of the build.

    Returns:
        The manifest and the compiled module.

    Raises:
        PlantError: The build is damaged, of another user, of another version or for another processor.

    """
    again = advise_rebuild(folder)
    refuse_other_writers(folder / "manifest.json")
    own = folder.resolve()  # the checked folder, even if a symbolic link changes afterwards
    try:
        manifest = json.loads((own / "manifest.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise PlantError(f"{folder}: manifest.json cannot be read ({error}); {again}") from None
    if not isinstance(manifest, dict) or manifest.get("schema") != MANIFEST_SCHEMA:
        raise PlantError(f"{folder}: the manifest's schema is not {MANIFEST_SCHEMA}; {again}")
    rest = {key: value for key, value in manifest.items() if key != "seal"}
    if manifest.get("seal") != hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest():
        raise PlantError(f"{folder}: the manifest is not as it was written; {again}")
    _check_interface(folder, "manifest", manifest.get("interface"))
    build = own.name.rpartition("-")[2]
    files = manifest.get("files")
    name = manifest.get("library")
    if manifest.get("build") != build or name != f"hda_{build}.so" or not isinstance(files, dict) or name not in files:
        raise PlantError(f"{folder}: the manifest does not belong to this folder; {again}")
    for file, digest in files.items():
        path = own / file
        if Path(file).name != file or not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            raise PlantError(f"{folder}: {file} is missing or not what was built; {again}")
    refuse_other_writers(own / name)
    missing = [flag for flag in manifest.get("cpu", ()) if flag not in _read_cpu_flags()]
    if missing:
        raise PlantError(
            f"{folder}: the library was built for a processor with {', '.join(missing)}, which this one lacks; {again}"
        )
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        raise PlantError("free-threaded Python has another binary interface than builds; start the ordinary one.")
    spec = importlib.util.spec_from_file_location("hda", own / name)
    assert spec is not None and spec.loader is not None
    try:
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except ImportError as error:
        raise PlantError(f"{folder}: the library cannot be loaded ({error}); {again}") from None
    _check_interface(folder, "library", getattr(module, "interface", None))
    if module.build != build:
        raise PlantError(f"{folder}: the library is of another build than its manifest; {again}")
    return manifest, module


def _check_interface(folder: Path, part: str, found: object) -> None:
    """Refuse a build whose manifest or library another version's generator made. Raises PlantError."""
    if found != INTERFACE or isinstance(found, bool):
        number = "none, as of an older version of hdagen" if found is None else f"{found!r:.40}"
        raise PlantError(
            f"{folder}: the {part} has the interface {number}, possible is {INTERFACE}, that of this version;"
            f" {advise_rebuild(folder)}"
        )


def _read_cpu_flags() -> set[str]:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return set()
    lines = (line for line in text.splitlines() if line.startswith(("flags", "Features")))
    return set(next(lines, ":").split(":", 1)[1].split())
