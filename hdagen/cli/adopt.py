"""`hdagen adopt`: a robot file with the verdict of a diagnosis in it, comments and layout kept."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdagen.adoption.robot_update import AdoptedRobot, Change

ADOPT_EXAMPLE = """example:
  hdagen adopt diagnosis-log/diagnosis.json robot.toml --dry-run
  hdagen adopt diagnosis-log/diagnosis.json robot.toml --out robot.new.toml
  hdagen replay robot.new.toml log.parquet
  python -m gen build robot.new.toml

exit codes: 0 done, 2 usage or configuration; see docs/guides/take_the_result_home.md"""
DONE = 0


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "adopt",
        help="write the verdict of a diagnosis into the robot file",
        description="Writes the robot file anew with the verdict of a diagnosis in it: base parameters within their "
        "tolerance, effects as [[effect]] tables, comments and layout as they are.",
        epilog=ADOPT_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("diagnosis", type=Path, metavar="diagnosis.json", help="what hdagen diagnose wrote")
    p.add_argument("robot", type=Path, help="the preset or the robot.toml that was diagnosed")
    where = p.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", type=Path, metavar="robot.new.toml", help="where the new one is written")
    where.add_argument("--dry-run", action="store_true", help="write nothing; show the table and the lines")
    p.add_argument("--force", action="store_true", help="write over a file that is there, be it robot.toml itself")
    p.add_argument("--profile", choices=("portable", "native"), default="portable", help="of the builds that are made")
    p.add_argument("--json", action="store_true", help="print what changed as JSON")


def run(options: argparse.Namespace) -> int:
    """Adopt and print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    """
    from hdagen.adoption.robot_update import adopt

    adopted = adopt(options.diagnosis, options.robot, options.out, options.force, options.profile)
    if options.json:
        _print_json(options, adopted)
    else:
        _print_changes(options, adopted)
    return DONE


def _print_json(options: argparse.Namespace, adopted: AdoptedRobot) -> None:
    said = {
        "robot": str(options.robot),
        "diagnosis": str(options.diagnosis),
        "changes": [asdict(change) for change in adopted.changes],
        "notes": list(adopted.notes),
        "difference": list(adopted.difference),
        "out": options.out and str(options.out),
    }
    print(json.dumps(said, indent=1))


def _print_changes(options: argparse.Namespace, adopted: AdoptedRobot) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False)
    if adopted.changes:
        title = escape(f"{options.robot} with {options.diagnosis}")
        table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
        table.add_column("where", overflow="fold")
        for name in ("file", "adopted", "±", "change"):
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("unit", no_wrap=True)
        above = ""
        for change in adopted.changes:
            owner, _, key = change.where.rpartition(".")
            if owner and owner != above:
                table.add_row(escape(owner))
            above = owner
            table.add_row(escape(f"  {key}" if owner else key), *_format_change(change), change.unit)
        console.print(table)
    for note in adopted.notes:
        console.print(f"note: {note}", markup=False)
    if options.dry_run:
        console.print("\n".join([*adopted.difference, "nothing is written"]), markup=False, soft_wrap=True)
    else:
        console.print(f"written: {options.out}", markup=False)


def _format_change(change: Change) -> tuple[str, str, str, str]:
    """The cells of a number before and after, of its standard deviation, and of what changed."""
    from hdagen.adoption.robot_update import describe_change

    before, std = "", ""
    if change.before is not None:
        before = f"{change.before:.6g}"
    if change.std is not None:
        std = f"{change.std:.2g}"
    return before, f"{change.after:.6g}", std, describe_change(change.before, change.after)
