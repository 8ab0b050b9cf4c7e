"""Builds for workers without a compiler: packed where they were made, unpacked whole, found by what was asked for."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError, find_build_folder, find_or_build
from hdagen.arm.received_builds import keep_received_build


def pack_build(wanted: Mapping[str, Any]) -> dict[str, Any]:
    """Make the build that a worker asks for, on this machine, and pack it.

    Args:
        wanted: What `BuildRequest.describe_robot` says of it.

    Returns:
        The request, name of the build's folder, and content of its files by name.

    Raises:
        PlantError: The build cannot be made here, either.

    """
    if wanted["mpc"]:
        raise PlantError("a worker without a compiler cannot run a predictive controller; install gcc or clang there.")
    with tempfile.TemporaryDirectory(prefix="hdagen-robot-") as place:
        robot = wanted["preset"]
        if not robot:
            robot = str(Path(place) / wanted["name"])
            Path(robot).write_bytes(wanted["content"])
        folder = find_or_build(robot, wanted["profile"], tuple(wanted["effects"]), None)
    files = {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}
    return {"key": wanted["key"], "folder": folder.name, "files": files}


def unpack_build(packed: Mapping[str, Any]) -> None:
    """Put a packed build among the builds of this machine, whole or not at all.

    Args:
        packed: What `pack_build` made.

    Raises:
        PlantError: A name in it is no file name.
        OSError: It cannot be written.

    """
    names = [packed["folder"], packed["key"], *packed["files"]]
    if any(Path(name).name != name or name.startswith(".") for name in names):
        raise PlantError("a build was sent whose files would lie elsewhere; send it again with one version of hdagen.")
    builds = find_build_folder()
    builds.mkdir(mode=0o755, parents=True, exist_ok=True)
    if not (builds / packed["folder"]).exists():
        part = Path(tempfile.mkdtemp(prefix=f".{packed['folder']}.part-", dir=builds))
        try:
            part.chmod(0o755)
            for name, content in packed["files"].items():
                (part / name).write_bytes(content)
                (part / name).chmod(0o755 if name.endswith(".so") else 0o644)
            os.rename(part, builds / packed["folder"])
        finally:
            shutil.rmtree(part, ignore_errors=True)
    keep_received_build(builds, packed["key"], packed["folder"])
