"""`hdagen export`: a robot with the verdict of a diagnosis, as a model of another simulator."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdagen.model_export.export_formats import FORMATS

if TYPE_CHECKING:
    from rich.console import Console

    from hdagen.model_export.export_formats import Exported
    from hdagen.model_export.mujoco_proof import Proof, ProofLog

EXPORT_EXAMPLE = """example:
  hdagen export mjcf robot.toml --with diagnosis.json --into model.xml --prove log.parquet --out new.xml
  hdagen export json robot.toml --with diagnosis.json --samples 100 --out joints.json

exit codes: 0 done, 1 the proof failed (MuJoCo comes no nearer to the log), 2 usage or configuration, 3 data unusable;
see docs/guides/take_the_result_home.md"""
FORMAT_OPTIONS = ("into", "samples", "fmi")  # options that not every format takes
DONE, PROOF_FAILED = 0, 1


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
    p.add_argument(
        "--into", type=Path, metavar="model.xml", help="of mjcf and urdf: correct this model and nothing else in it"
    )
    p.add_argument(
        "--joints", metavar="A,B,…", help="the joints' names in the other simulator, base first (default: robot file's)"
    )
    p.add_argument("--prove", type=Path, metavar="LOG", help="of mjcf: MuJoCo replays this log before and after")
    p.add_argument("--closed-loop", type=Path, metavar="controller.toml", help="of --prove: this controller drives")
    p.add_argument("--columns", type=Path, metavar="columns.toml", help="of --prove: names and units of a foreign log")
    p.add_argument("--samples", type=int, metavar="N", help="of json: so many draws of the numbers, for randomisation")
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
    from hdagen.arm.build_loader import PlantError
    from hdagen.model_export.corrected_robot import load_corrected_robot, read_joint_names
    from hdagen.model_export.export_formats import check_destination, find_format, write_export
    from hdagen.model_export.model_text import ModelText

    check_destination(options.format, options.out, options.force)
    own: dict[str, Any] = {name: getattr(options, name) for name in FORMAT_OPTIONS}
    if options.prove is None and (options.closed_loop or options.columns):
        raise PlantError("--closed-loop and --columns belong to --prove LOG; name the log, or leave them out.")
    if options.prove is not None:
        own["prove"] = _read_proof(options) if "prove" in find_format(options.format).options else options.prove
    if options.into is not None and "into" in find_format(options.format).options:
        ModelText(options.into)  # its faults are told before anything is built
    names = read_joint_names(options.joints)
    robot = load_corrected_robot(options.robot, options.with_, options.profile, names)
    written = write_export(options.format, robot, options.out, **own)
    if options.json:
        _print_json(options, written)
    else:
        _print_export(written)
    if written.proof and not written.proof.holds:
        return PROOF_FAILED
    return DONE


def _read_proof(options: argparse.Namespace) -> ProofLog:
    """The log of the proof, before anything is built."""
    from hdagen.adoption.diagnosis_file import read_content
    from hdagen.arm.joint_names import read_joint_names
    from hdagen.model_export.mujoco_proof import read_proof_log

    content = options.with_ and read_content(options.with_)
    return read_proof_log(options.prove, content, options.closed_loop, options.columns, read_joint_names(options.robot))


def _print_json(options: argparse.Namespace, written: Exported) -> None:
    said = {
        "format": options.format,
        "robot": str(options.robot),
        "diagnosis": options.with_ and str(options.with_),
        "files": [str(file) for file in written.files],
        "changes": [asdict(change) for change in written.changes],
        "left_out": dict(written.left_out),
        "notes": list(written.notes),
        "proof": written.proof and asdict(written.proof),
    }
    print(json.dumps(said, indent=1))


def _print_export(written: Exported) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False)
    if written.changes:
        table = Table("where", title="numbers that the verdict changes", title_justify="left")
        for name in ("before", "after"):
            table.add_column(name, justify="right")
        table.add_column("unit")
        for change in written.changes:
            before = "" if change.before is None else f"{change.before:.6g}"
            table.add_row(escape(change.where), before, f"{change.after:.6g}", change.unit)
        console.print(table)
    for sentence in dict.fromkeys(written.left_out.values()):
        places = ", ".join(place for place, reason in written.left_out.items() if reason == sentence)
        console.print(f"left out: {places}: {sentence}", markup=False)
    notes = [*written.notes]
    if written.proof:
        _print_proof(console, written.proof)
        notes += written.proof.notes
    for note in notes:
        console.print(f"note: {note}", markup=False)
    for file in written.files:
        console.print(f"written: {file}", markup=False)


def _print_proof(console: Console, proof: Proof) -> None:
    """The errors of MuJoCo beside ours, and what the export closes there."""
    from rich.markup import escape
    from rich.table import Table

    table = Table("rms error on held-out rows")
    for name in ("MuJoCo before", "after", "ours before", "after"):
        table.add_column(name, justify="right")
    for one in proof.channels:
        errors = (one.mujoco_before, one.mujoco_after, one.ours_before, one.ours_after)
        table.add_row(escape(f"{one.joint}: {one.channel}, {one.unit}"), *(f"{error:.3g}" for error in errors))
        table.add_row("  in multiples of noise", *(f"{error / one.noise:.3g}" for error in errors))
    table.add_row("gap, in multiples of noise", *(f"{gap:.4g}" for gap in proof.gaps))
    console.print(table)
    console.print(proof.sentence, markup=False)
