"""The machines of a fleet.toml, read and checked: every problem at once."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.log import column_map_file
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import check_log
from hdagen.support.input_file import InputFileError, read_toml
from hdagen.support.messages import shown, shown_path
from hdagen.support.version import __version__

_REQUIRED, _OPTIONAL = ("robot", "log"), ("hold_out", "columns", "name")
_NAME = re.compile(r"\w[\w -]{0,59}")  # it is a folder, too
_PRESET = re.compile(r"[a-z][a-z0-9_]{0,60}")
_LARGEST = 1_000_000  # bytes of a fleet.toml


@dataclass(frozen=True)
class Machine:
    """A log and the files that its diagnosis needs; ``robot`` is a preset or a path."""

    name: str
    robot: str
    log: Path
    hold_out: Path | None
    columns: Path | None

    def digest(self) -> str:
        """Hash the content of the files, wherever they lie, and this version.

        Returns:
            SHA-256 as hexadecimal digits.

        """
        parts: dict[str, str | None] = {"version": __version__, "robot": self.robot}
        robot = Path(self.robot)
        if (robot / "manifest.json").is_file():  # a folder that holds a build
            parts["robot"] = _digest(robot / "manifest.json")
        elif robot.exists():
            parts["robot"] = _digest(robot)
        for key, path in (("log", self.log), ("hold_out", self.hold_out), ("columns", self.columns)):
            parts[key] = None
            if path is not None:
                parts[key] = _digest(path)
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def arguments(self, out: Path) -> list[str]:
        """List the arguments of `hdagen diagnose`.

        Args:
            out: Folder of the diagnosis.

        Returns:
            The arguments.

        """
        stated = ["--out", str(out)]
        if self.hold_out:
            stated += ["--hold-out", str(self.hold_out)]
        if self.columns:
            stated += ["--columns", str(self.columns)]
        return [*stated, "--", self.robot, str(self.log)]


def read(path: Path) -> tuple[Machine, ...]:
    """Read a fleet.toml.

    Args:
        path: The file; paths in it are taken from its folder.

    Returns:
        The machines.

    Raises:
        PlantError: The file cannot be read, or says something that is not possible; the message has every problem.

    """
    try:
        content = read_toml(path, _LARGEST, "give a fleet.toml as docs/diagnosis.md describes it")
    except InputFileError as error:
        raise PlantError(error) from None
    place = shown_path(path)
    problems = [
        f"{place}: unknown key {key[:40]!r}; possible is [[machine]], one a log." for key in content if key != "machine"
    ]
    entries = content.get("machine")
    if not isinstance(entries, list) or not entries or not all(isinstance(entry, dict) for entry in entries):
        problems.append(f"{place}: there is no [[machine]]; write one with robot and log for each log.")
        raise PlantError("\n".join(problems))
    machines = [_machine(f"{place}: machine {k}", path.parent, entry, problems) for k, entry in enumerate(entries, 1)]
    names = Counter(machine.name.casefold() for machine in machines if machine)
    problems += [
        f'{place}: {count} machines are named {name!r}; tell them apart with name = "…".'
        for name, count in names.items()
        if count > 1
    ]
    if problems:
        raise PlantError("\n".join(problems))
    return tuple(machine for machine in machines if machine)


def _machine(where: str, folder: Path, entry: Mapping[str, Any], problems: list[str]) -> Machine | None:
    """One [[machine]], or None with what is wrong appended to ``problems``."""
    known = _REQUIRED + _OPTIONAL
    wrong = [
        f"{where}: unknown key {key[:40]!r}; possible are {', '.join(known)}." for key in entry if key not in known
    ]
    wrong += [f"{where}: {key} is missing; state it." for key in _REQUIRED if key not in entry]
    text = {key: value for key, value in entry.items() if isinstance(value, str) and value and "\0" not in value}
    wrong += [
        f"{where}: {key} = {shown(value)}; it must be text in quotes."
        for key, value in entry.items()
        if key in known and key not in text
    ]
    paths = {key: (folder / text[key]).absolute() for key in ("log", "hold_out", "columns") if key in text}
    for key, path in paths.items():
        try:
            if key == "columns":
                column_map_file.load(path)
            else:
                check_log(path)
        except LogError as error:
            wrong += [f"{where}: {key} = {shown(text[key])}: {problem}" for problem in error.problems]
    robot = text.get("robot", "")
    if robot and any(os.path.isfile(folder / robot / name) for name in ("", "manifest.json")):
        robot = str((folder / robot).absolute())
    elif robot and not _PRESET.fullmatch(robot):
        wrong.append(f"{where}: robot = {shown(robot)}: there is no such file, and it is no preset's name.")
    name = ""
    if "log" in paths:
        name = re.sub(r"[^\w -]", "_", paths["log"].stem)[:60]
    name = text.get("name", name)
    if name and not _NAME.fullmatch(name):
        wrong.append(f"{where}: name = {shown(name)}; possible are up to 60 letters, digits, spaces, _ and -.")
    problems += wrong
    if wrong:
        return None
    return Machine(name, robot, paths["log"], paths.get("hold_out"), paths.get("columns"))


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
