"""Builds that another machine made for this one, which has no compiler; each is found by what was asked for."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.support.atomic_write import write_atomically
from hdagen.support.version import __version__

RECEIVED_FOLDER = ".received"  # beside the builds: a note for each request, which names the folder of its build


@dataclass(frozen=True)
class BuildRequest:
    """A build by all that is asked of it: preset or path of the robot, profile, effects, structure of a predictive
    controller."""

    robot: str
    profile: str
    effects: tuple[str, ...]
    structure: str

    def make_key(self) -> str:
        """Make a name of the request that is the same on every machine.

        Returns:
            SHA-256, hexadecimal.

        Raises:
            OSError: The robot file cannot be read.

        """
        robot = hashlib.sha256(self.robot.encode()).hexdigest()
        if Path(self.robot).is_file():
            robot = hashlib.sha256(Path(self.robot).read_bytes()).hexdigest()
        parts = (__version__, robot, self.profile, *sorted(self.effects), self.structure)
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def describe_robot(self) -> dict[str, Any]:
        """Describe the build for a machine that can make it.

        Returns:
            Name and content of the robot file or the preset's name, profile, effects, structure of a predictive
            controller, and the key under which `keep_received_build` notes it.

        Raises:
            OSError: The robot file cannot be read.

        """
        preset, content, path = self.robot, b"", Path(self.robot)
        if path.is_file():
            preset, content = "", path.read_bytes()
        return {
            "preset": preset,
            "name": path.name,
            "content": content,
            "profile": self.profile,
            "effects": list(self.effects),
            "mpc": self.structure,
            "key": self.make_key(),
        }


def keep_received_build(builds: Path, key: str, folder: str) -> None:
    """Note that a build of another machine lies in the folder of builds; it is used where no compiler works.

    Args:
        builds: The folder of builds.
        key: What `BuildRequest.make_key` gives on both machines.
        folder: Name of the build's folder.

    Raises:
        OSError: The note cannot be written.

    """
    notes = builds / RECEIVED_FOLDER
    notes.mkdir(mode=0o755, exist_ok=True)
    write_atomically(notes / key, folder.encode())


def find_received_build(builds: Path, request: BuildRequest) -> Path | None:
    """Find the build that another machine sent for a request; loading it examines it like any other.

    Args:
        builds: The folder of builds.
        request: What is asked for.

    Returns:
        The folder of the build, or None.

    """
    try:
        name = (builds / RECEIVED_FOLDER / request.make_key()).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None
    if Path(name).name != name or not (builds / name / "manifest.json").is_file():
        return None
    return builds / name
