"""`hdagen list`: the robots that ship with the project."""

from __future__ import annotations

import argparse
import json
from typing import Any

LIST_EXAMPLE = """example:
  hdagen list
  hdagen describe paper

a preset's name stands wherever a command takes ROBOT"""
DONE = 0


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "list",
        help="list the presets",
        description="Lists the robots that ship with the project, with the number of their joints.",
        epilog=LIST_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("--json", action="store_true", help="print the list as JSON")


def run(options: argparse.Namespace) -> int:
    """List the presets.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    """
    presets = _read_presets()
    if options.json:
        print(json.dumps(presets, indent=1))
        return DONE
    from rich.console import Console
    from rich.table import Table

    table = Table("preset", "joints", "robot", box=None, pad_edge=False)
    for preset in presets:
        table.add_row(preset["preset"], str(preset["joints"]), preset["robot"])
    Console(highlight=False).print(table)
    return DONE


def _read_presets() -> list[dict[str, Any]]:
    import tomllib

    from hdagen.arm.preset_files import find_preset_files

    found = []
    for name, path in find_preset_files().items():
        robot = tomllib.loads(path.read_text(encoding="utf-8"))
        found.append({"preset": name, "robot": robot["name"], "joints": len(robot["joint"]), "file": str(path)})
    return found
