"""Builds found or made, checked, and loaded: what keeps a foreign or damaged library out of the process."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from hdagen.names import printable

SCHEMA = 1
PROFILES = ("portable", "native")
LONGEST = 4096  # bytes of a path
MOST_LINES = 200  # of what is said


class PlantError(Exception):
    """A build that cannot be made, loaded or called; one printable line a problem, of very many the first."""

    def __init__(self, text: object) -> None:
        lines = str(text).split("\n")
        more = [f"{len(lines) - MOST_LINES} more are not listed: mend these first."] if len(lines) > MOST_LINES else []
        super().__init__("\n".join([*(printable(line.expandtabs()) for line in lines[:MOST_LINES]), *more]))


class Structured(Protocol):
    """What says how a predictive controller is compiled."""

    @property
    def structure(self) -> str:
        """As `python -m gen build --mpc` takes it."""

    def refusals(self, robot: Mapping[str, Any]) -> list[str]:
        """Why it cannot be used with a robot, as a build's manifest describes it; one sentence a problem."""


def folder_of(
    robot: str | Path, profile: str, effects: tuple[str, ...], out: str | Path | None, mpc: Structured | None = None
) -> Path:
    """The folder of a robot's build: the one named, or one made by a child process, after ``mpc`` has been found to
    fit the robot. Raises PlantError."""
    name = os.fspath(robot)
    if not name or "\0" in name or len(name) > LONGEST:
        raise PlantError(f"{name[:40]!r} names no robot; give a preset, a robot.toml, or the folder of a build.")
    if (Path(name) / "manifest.json").is_file():
        return Path(name)
    if profile not in PROFILES:
        raise PlantError(f"no profile named {profile}; there are {', '.join(PROFILES)}.")
    if isinstance(effects, str):
        raise PlantError(f"effects takes names in a tuple, such as ({effects!r},).")
    folder = Path(out or os.environ.get("HDAGEN_BUILD") or "build")
    if mpc and (problems := mpc.refusals(json.loads("\n".join(_gen("describe", "--", name))))):
        raise PlantError("\n".join(problems))
    wanted = [f"--effects={','.join(effects)}", f"--mpc={mpc.structure if mpc else ''}"]
    return Path(_gen("build", "--profile", profile, f"--out={folder}", *wanted, "--", name)[-1])


def mended(robot: Path) -> tuple[float, tuple[float, ...]]:
    """The step, s, and the widths of smooth friction by joint, rad/s, with which a robot.toml can be built: its own
    where those will do. Raises PlantError where anything else is wrong with the file."""
    said = json.loads("\n".join(_gen("mend", "--", os.fspath(robot))))
    return said["step"], tuple(said["friction_smoothing"])


def _gen(*arguments: str) -> list[str]:
    """What `python -m gen` prints, by a child process; what it says of a build goes on to people. Raises PlantError."""
    command = [sys.executable, "-P", "-m", "gen", *arguments]
    beside = os.pathsep.join(filter(None, (str(Path(__file__).parent.parent), os.environ.get("PYTHONPATH"))))
    # what it prints goes to a file: two pipes of which only one is read can each wait for the other
    with tempfile.TemporaryFile("w+") as printed:
        with subprocess.Popen(
            command, stdout=printed, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": beside}
        ) as child:
            assert child.stderr is not None
            said = []
            for line in child.stderr:
                said.append(line.rstrip())
                if line.startswith("building"):
                    print(line.rstrip(), file=sys.stderr, flush=True)
        printed.seek(0)
        lines = printed.read().splitlines()
    if child.returncode or not lines:
        raise PlantError("\n".join(said) or f"the build of {arguments[-1]} failed without a word.")
    return lines


def remedy(folder: Path) -> str:
    """What to do about a build that cannot be used."""
    return f"remove {folder} and build again with `python -m gen build`."


def opened(folder: Path) -> tuple[dict[str, Any], Any]:
    """The manifest and the module of a build, after every check that keeps a foreign or damaged library out of the
    process."""
    again = remedy(folder)
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise PlantError(f"{folder}: manifest.json cannot be read ({error}); {again}") from None
    if not isinstance(manifest, dict) or manifest.get("schema") != SCHEMA:
        raise PlantError(f"{folder}: the manifest's schema is not {SCHEMA}; {again}")
    rest = {key: value for key, value in manifest.items() if key != "seal"}
    if manifest.get("seal") != hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest():
        raise PlantError(f"{folder}: the manifest is not as it was written; {again}")
    build = folder.resolve().name.rpartition("-")[2]
    files = manifest.get("files")
    name = manifest.get("library")
    if manifest.get("build") != build or name != f"hda_{build}.so" or not isinstance(files, dict) or name not in files:
        raise PlantError(f"{folder}: the manifest does not belong to this folder; {again}")
    for file, digest in files.items():
        path = folder / file
        if Path(file).name != file or not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            raise PlantError(f"{folder}: {file} is missing or not what was built; {again}")
    missing = [flag for flag in manifest.get("cpu", ()) if flag not in _cpu_flags()]
    if missing:
        raise PlantError(
            f"{folder}: the library was built for a processor with {', '.join(missing)}, which this one lacks; {again}"
        )
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        raise PlantError("free-threaded Python has another binary interface than builds; start the ordinary one.")
    spec = importlib.util.spec_from_file_location("hda", folder / name)
    assert spec is not None and spec.loader is not None
    try:
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except ImportError as error:
        raise PlantError(f"{folder}: the library cannot be loaded ({error}); {again}") from None
    if module.build != build:
        raise PlantError(f"{folder}: the library is of another build than its manifest; {again}")
    return manifest, module


def _cpu_flags() -> set[str]:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return set()
    lines = (line for line in text.splitlines() if line.startswith(("flags", "Features")))
    return set(next(lines, ":").split(":", 1)[1].split())
