"""`hdagen adopt`: a robot file with the verdict of a diagnosis in it, comments and layout kept."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdagen.adopt import Adopted

EXAMPLE = """example:
  hdagen adopt diagnosis-log/diagnosis.json robot.toml --out robot.new.toml
  hdagen replay robot.new.toml log.parquet
  python -m gen build robot.new.toml

exit codes: 0 done, 2 usage or configuration; docs/adopt.md says what is written and what is refused"""
DONE = 0


def add_parser(commands: Any) -> None:
    """The command's arguments."""
    p = commands.add_parser(
        "adopt",
        help="write the verdict of a diagnosis into the robot file",
        description="Writes the robot file anew with the verdict of a diagnosis in it: base parameters within their "
        "tolerance, effects as [[effect]] tables, comments and layout as they are.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("diagnosis", type=Path, metavar="diagnosis.json", help="what hdagen diagnose wrote")
    p.add_argument("robot", type=Path, metavar="robot.toml", help="the robot file that was diagnosed")
    p.add_argument("--out", type=Path, required=True, metavar="robot.new.toml", help="where the new one is written")
    p.add_argument("--force", action="store_true", help="write over a file that is there, be it robot.toml itself")
    p.add_argument("--profile", choices=("portable", "native"), default="portable", help="of the builds that are made")


def run(options: argparse.Namespace) -> int:
    """Adopt and print."""
    from hdagen.adopt import adopt

    _print(options, adopt(options.diagnosis, options.robot, options.out, options.force, options.profile))
    return DONE


def _print(options: argparse.Namespace, adopted: Adopted) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False)
    if adopted.changes:
        table = Table(title=escape(f"{options.robot} with {options.diagnosis}"), title_justify="left")
        for heading in ("where", "before", "after", "unit"):
            table.add_column(heading, justify="right" if heading in ("before", "after") else "left")
        for change in adopted.changes:
            before = "" if change.before is None else f"{change.before:.6g}"
            table.add_row(escape(change.where), before, f"{change.after:.6g}", change.unit)
        console.print(table)
    for note in adopted.notes:
        console.print(f"note: {note}", markup=False)
    console.print(f"written: {options.out}", markup=False)
