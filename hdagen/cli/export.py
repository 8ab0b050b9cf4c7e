"""`hdagen export`: a robot with the verdict of a diagnosis, as a model of another simulator."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdagen.model_export.export_formats import FORMATS

if TYPE_CHECKING:
    from hdagen.model_export.export_formats import Exported

EXPORT_EXAMPLE = """example:
  hdagen export json robot.toml --with diagnosis-log/diagnosis.json --out joints.json

exit codes: 0 done, 2 usage or configuration, 3 data unusable; see docs/guides/take_the_result_home.md"""
FORMAT_OPTIONS: tuple[str, ...] = ("fmi",)  # options that not every format takes
DONE = 0


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    formats = "; ".join(f"{name}: {entry.meaning}" for name, entry in FORMATS.items())
    p = commands.add_parser(
        "export",
        help="write the robot as a model of another simulator, with the verdict of a diagnosis",
        description="Writes a robot, with the verdict of a diagnosis in it, as a model of another simulator.",
        epilog=EXPORT_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("format", choices=tuple(FORMATS), help=formats)
    p.add_argument("robot", metavar="ROBOT", help="a preset or a robot.toml")
    p.add_argument(
        "--with", dest="with_", type=Path, metavar="diagnosis.json", help="what hdagen diagnose wrote of this robot"
    )
    p.add_argument("--out", type=Path, required=True, metavar="FILE", help="where the model is written")
    p.add_argument("--force", action="store_true", help="write over a file that is there")
    p.add_argument("--fmi", choices=("3.0", "2.0"), help="version of the FMU's interface (default: 3.0)")
    p.add_argument("--profile", choices=("portable", "native"), default="portable", help="of the build of the model")
    p.add_argument("--json", action="store_true", help="print what was written as JSON")


def run(options: argparse.Namespace) -> int:
    """Export and print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    """
    from hdagen.model_export.corrected_robot import load_corrected_robot
    from hdagen.model_export.export_formats import check_destination, write_export

    check_destination(options.format, options.out, options.force)
    robot = load_corrected_robot(options.robot, options.with_, options.profile)
    own = {name: getattr(options, name) for name in FORMAT_OPTIONS}
    written = write_export(options.format, robot, options.out, **own)
    if options.json:
        _print_json(options, written)
    else:
        _print_export(written)
    return DONE


def _print_json(options: argparse.Namespace, written: Exported) -> None:
    said = {
        "format": options.format,
        "robot": str(options.robot),
        "diagnosis": options.with_ and str(options.with_),
        "files": [str(file) for file in written.files],
        "changes": [asdict(change) for change in written.changes],
        "left_out": dict(written.left_out),
        "notes": list(written.notes),
    }
    print(json.dumps(said, indent=1))


def _print_export(written: Exported) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    for effect, sentence in written.left_out.items():
        console.print(f"left out: {effect}: {sentence}", markup=False)
    for note in written.notes:
        console.print(f"note: {note}", markup=False)
    for file in written.files:
        console.print(f"written: {file}", markup=False)
