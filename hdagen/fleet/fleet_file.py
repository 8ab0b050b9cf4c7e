"""The machines of a fleet.toml, read and checked: every problem at once."""

from __future__ import annotations

import datetime
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
from hdagen.log.measured_log import check_log_file
from hdagen.support.input_file import InputFileError, read_toml
from hdagen.support.messages import show_path, show_value

_REQUIRED_KEYS, _OPTIONAL_KEYS = ("robot", "log"), ("hold_out", "columns", "name", "date")
_NAME_PATTERN = re.compile(r"\w[\w -]{0,59}")  # it is a folder, too
_PRESET_PATTERN = re.compile(r"[a-z][a-z0-9_]{0,60}")
_MOST_FLEET_BYTES = 20_000_000  # bytes of a fleet.toml


@dataclass(frozen=True)
class FleetMachine:
    """A log and the files that its diagnosis needs; ``robot`` is a preset or a path, ``date`` the log's in ISO 8601."""

    name: str
    robot: str
    log: Path
    hold_out: Path | None
    columns: Path | None
    date: str | None = None


def read_fleet(path: Path) -> tuple[FleetMachine, ...]:
    """Read a fleet.toml.

    Args:
        path: The file; paths in it are taken from its folder.

    Returns:
        The machines.

    Raises:
        PlantError: The file cannot be read, or says something that is not possible; the message has every problem.

    """
    try:
        content = read_toml(path, _MOST_FLEET_BYTES, "give a fleet.toml as docs/guides/fleet.md describes it")
    except InputFileError as error:
        raise PlantError(error) from None
    place = show_path(path)
    problems = [
        f"{place}: unknown key {key[:40]!r}; possible is [[machine]], one a log." for key in content if key != "machine"
    ]
    entries = content.get("machine")
    if not isinstance(entries, list) or not entries or not all(isinstance(entry, dict) for entry in entries):
        problems.append(f"{place}: there is no [[machine]]; write one with robot and log for each log.")
        raise PlantError("\n".join(problems))
    machines = [
        _read_machine(f"{place}: machine {k}", path.parent, entry, problems) for k, entry in enumerate(entries, 1)
    ]
    names = Counter(machine.name.casefold() for machine in machines if machine)
    problems += [
        f'{place}: {count} machines are named {name!r}; tell them apart with name = "…".'
        for name, count in names.items()
        if count > 1
    ]
    if problems:
        raise PlantError("\n".join(problems))
    return tuple(machine for machine in machines if machine)


def _read_machine(where: str, folder: Path, entry: Mapping[str, Any], problems: list[str]) -> FleetMachine | None:
    """One [[machine]], or None with what is wrong appended to ``problems``."""
    known = _REQUIRED_KEYS + _OPTIONAL_KEYS
    wrong = [
        f"{where}: unknown key {key[:40]!r}; possible are {', '.join(known)}." for key in entry if key not in known
    ]
    wrong += [f"{where}: {key} is missing; state it." for key in _REQUIRED_KEYS if key not in entry]
    date = _read_date(where, entry.get("date"), wrong)
    text = {key: value for key, value in entry.items() if isinstance(value, str) and value and "\0" not in value}
    wrong += [
        f"{where}: {key} = {show_value(value)}; it must be text in quotes."
        for key, value in entry.items()
        if key in known and key not in text and key != "date"
    ]
    paths = {key: (folder / text[key]).absolute() for key in ("log", "hold_out", "columns") if key in text}
    for key, path in paths.items():
        try:
            if key == "columns":
                column_map_file.read_column_map(path)
            else:
                check_log_file(path)
        except LogError as error:
            wrong += [f"{where}: {key} = {show_value(text[key])}: {problem}" for problem in error.problems]
    robot = text.get("robot", "")
    if robot and os.path.isfile(folder / robot):
        robot = str((folder / robot).absolute())
    elif robot and os.path.isfile(folder / robot / "manifest.json"):
        wrong.append(f"{where}: robot = {show_value(robot)} is the folder of a build; give its robot.toml.")
    elif robot and not _PRESET_PATTERN.fullmatch(robot):
        wrong.append(f"{where}: robot = {show_value(robot)}: there is no such file, and it is no preset's name.")
    name = ""
    if "log" in paths:
        name = re.sub(r"[^\w -]", "_", paths["log"].stem)[:60]
    name = text.get("name", name)
    if name and not _NAME_PATTERN.fullmatch(name):
        wrong.append(f"{where}: name = {show_value(name)}; possible are up to 60 letters, digits, spaces, _ and -.")
    problems += wrong
    if wrong:
        return None
    return FleetMachine(name, robot, paths["log"], paths.get("hold_out"), paths.get("columns"), date)


def _read_date(where: str, given: Any, wrong: list[str]) -> str | None:
    """The date of a log in ISO 8601, or None; a TOML date is one, too."""
    if given is None:
        return None
    if isinstance(given, datetime.date):
        return given.isoformat()
    if isinstance(given, str):
        try:
            return datetime.datetime.fromisoformat(given).isoformat()
        except ValueError:
            pass
    wrong.append(f"{where}: date = {show_value(given)}; possible is ISO 8601, such as 2026-03-31 or 2026-03-31T14:05.")
    return None
