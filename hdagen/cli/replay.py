"""`hdagen replay`: a log simulated again from its commands and forces, and how far the model misses it."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdagen.adoption.verdict import Verdict
    from hdagen.arm.arrays import Array
    from hdagen.arm.compiled_arm import Arm
    from hdagen.log.measured_log import Log
    from hdagen.prediction.window_replay import Replay

REPLAY_EXAMPLE = """example:
  hdagen replay robot.toml log.parquet --out predicted.parquet
  hdagen replay emps DATA_EMPS.mat --columns docs/examples/emps/columns.toml --out predicted.csv
  hdagen replay robot.toml log.parquet --with diagnosis-log/diagnosis.json --out after.parquet

exit codes: 0 done, 2 usage or configuration, 3 data unusable; see docs/method/prediction.md"""
DONE, USAGE, UNUSABLE = 0, 2, 3


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "replay",
        help="simulate a log again and say how far the model misses it",
        description="Simulates a log again in short windows from what was commanded and pushed, and compares it with "
        "what was measured.",
        epilog=REPLAY_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("robot", help="a preset or a robot.toml")
    p.add_argument("--built", action="store_true", help="ROBOT is the folder of a build, whose compiled code is run")
    p.add_argument("log", type=Path, metavar="LOG", help=".csv, .parquet or .mat")
    p.add_argument("--columns", type=Path, metavar="columns.toml", help="names, units and signs of a foreign log")
    p.add_argument(
        "--with",
        type=Path,
        dest="with_",
        metavar="diagnosis.json",
        help="add the effects and parameters of its verdict",
    )
    p.add_argument(
        "--rows-of",
        type=Path,
        metavar="diagnosis.json",
        help="count the rows, channels and noise that its gap counts: LOG is one that it held out",
    )
    p.add_argument(
        "--window", type=float, metavar="S", help="length of a window (default: 0.25 s; in closed loop the whole log)"
    )
    p.add_argument(
        "--input",
        choices=("command", "measured"),
        default="command",
        help="the current or torque that drives the model",
    )
    p.add_argument("--closed-loop", type=Path, metavar="controller.toml", help="let this controller drive the model")
    p.add_argument(
        "--bandwidth", type=float, metavar="HZ", help="of the loop, for the force error of rigid robots (default: 20)"
    )
    p.add_argument("--profile", choices=("portable", "native"), default="portable")
    p.add_argument("--json", action="store_true", help="print the figures as JSON")
    p.add_argument(
        "--out", type=Path, metavar="predicted.parquet", help="where the prediction is written, .parquet or .csv"
    )


def run(options: argparse.Namespace) -> int:
    """Replay a log, write the prediction, print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    Raises:
        PlantError: An option is not possible, or a build fails.
        LogError: The log cannot be read.

    """
    from hdagen.adoption import verdict
    from hdagen.adoption.diagnosis_file import read_content
    from hdagen.arm.joint_names import read_joint_names
    from hdagen.diagnosis.data.held_out_rows import count_rows
    from hdagen.log.data_table import LogError
    from hdagen.log.measured_log import read, write
    from hdagen.prediction.closed_loop_replay import read_controller, replay_closed_loop
    from hdagen.prediction.window_replay import REPLAY_WINDOW, check_log_fits_arm, replay

    _check_options(options)
    stated = options.with_ and verdict.read_verdict(options.with_)
    counted = options.rows_of and read_content(options.rows_of)
    laws = options.closed_loop and read_controller(options.closed_loop)
    names = () if options.built else read_joint_names(options.robot)
    measured = read(  # before a model is compiled, which takes its time
        options.log, options.columns, holes=counted is not None, names=names
    )
    arm = _load_arm(options, stated)
    check_log_fits_arm(arm, measured)
    measured, notes, refusals = _repair_log(arm, measured, counted is not None)
    if refusals:
        print("\n".join(f"{options.log}: {sentence}" for sentence in refusals), file=sys.stderr)
        return UNUSABLE
    if laws is not None:
        if stated is not None:
            arm, said = verdict.apply_verdict(arm, stated)
            notes += said
        found = replay_closed_loop(arm, measured, laws, options.window or math.inf)
    else:
        found = replay(arm, measured, options.window or REPLAY_WINDOW, options.input, stated)
    if counted is not None:
        found = count_rows(found, measured, counted, str(options.rows_of))
    force, said = _measure_force_error(arm, measured, options)
    if options.out is not None:
        try:
            write(found.columns, options.out)
        except LogError as error:
            print(error, file=sys.stderr)
            return USAGE
    notes = [*measured.notes, *notes, *found.notes, *said]
    if options.json:
        _print_json(options, arm, measured, found, force, notes)
    else:
        _print_replay(options, arm, measured, found, force, notes)
    return DONE


def _repair_log(arm: Arm, log: Log, diagnosed: bool) -> tuple[Log, list[str], list[str]]:
    """The log with its repairs, notes and refusals; ``diagnosed``: as a diagnosis took it."""
    from hdagen.data_quality.log_repair import repair_for_replay, repair_log

    if diagnosed:
        log, _, seen = repair_log(log, arm)
        return log, list(seen.warnings), []
    log, mended, seen = repair_for_replay(log, arm)
    return log, [*seen.warnings, *(one.sentence for one in mended)], list(seen.refusals)


def _load_arm(options: argparse.Namespace, stated: Verdict | None) -> Arm:
    """The arm that is asked for: a build as it is, else a robot with the effects that a diagnosis has stated."""
    from hdagen.adoption import verdict
    from hdagen.arm.compiled_arm import Arm, load

    if options.built:
        return Arm(options.robot)
    if stated:
        return verdict.load_with_effects(options.robot, options.profile, stated)
    return load(options.robot, options.profile)


def _check_options(options: argparse.Namespace) -> None:
    """Refuse options that are not possible, before anything is built. Raises PlantError."""
    from hdagen.arm.build_loader import PlantError
    from hdagen.log.data_table import find_write_problems

    problems = []
    if options.built and options.with_ is not None:
        problems.append("--built and --with exclude each other: a verdict needs the robot file; leave one out.")
    if options.window is not None and not options.window > 0:
        problems.append(
            f"--window {options.window:g}: a window is longer than 0 s; 0.25 is usual, inf takes the log as one."
        )
    if options.bandwidth is not None and not (options.bandwidth > 0 and math.isfinite(options.bandwidth)):
        problems.append(f"--bandwidth {options.bandwidth:g}: possible is a frequency above 0 Hz; 20 is usual.")
    if options.closed_loop is not None and options.input == "measured":
        problems.append(
            "--closed-loop and --input measured exclude each other: the controller gives the input; leave one out."
        )
    if options.out is not None:
        problems += [f"--out {problem}" for problem in find_write_problems(options.out)]
        if os.path.exists(options.out) and os.path.exists(options.log) and options.out.samefile(options.log):
            problems.append(f"--out {options.out}: is the log itself, which would be lost; name another file.")
    if problems:
        raise PlantError("\n".join(problems))


def _measure_force_error(arm: Arm, log: Log, options: argparse.Namespace) -> tuple[Array | None, list[str]]:
    """Force error of the inverse dynamics of a rigid robot, a share a joint; None and why not."""
    from hdagen.log.data_table import LogError
    from hdagen.prediction.driving_inputs import read_driving_inputs
    from hdagen.prediction.inverse_dynamics import LOOP_BANDWIDTH, compute_force_error

    if arm.manifest["flexible"]:
        return None, []
    try:
        return compute_force_error(
            arm, log, read_driving_inputs(arm, log, options.input)[0], options.bandwidth or LOOP_BANDWIDTH
        ).relative, []
    except LogError as error:
        return None, [str(error)]


def _print_json(
    options: argparse.Namespace, arm: Arm, log: Log, found: Replay, force: Array | None, notes: list[str]
) -> None:
    gap, shares = None, None
    if math.isfinite(found.gap):
        gap = found.gap
    if force is not None:
        shares = [_finite_or_none(float(share)) for share in force]
    figures = {
        "log": str(options.log),
        "robot": arm.robot["name"],
        "rows": len(log),
        "windows": len(found.starts),
        "errors": found.errors,
        "noise": found.noise,
        "relative": found.relative,
        "inputs": found.driving_channels,
        "gap": gap,
        "force_error": shares,
        "rows_beyond_spring_law": found.beyond_law,
        "notes": notes,
        "out": options.out and str(options.out),
    }
    print(json.dumps(figures, indent=1))


def _finite_or_none(value: float) -> float | None:
    if math.isfinite(value):
        return value
    return None


def _print_replay(
    options: argparse.Namespace, arm: Arm, log: Log, found: Replay, force: Array | None, notes: list[str]
) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from hdagen.arm.channel_units import find_channel_unit

    windows = "one window"
    if len(found.starts) > 1:
        windows = f"{len(found.starts)} window(s)"
    title = (
        f"{options.log.name}: {len(log)} rows, {log.time[-1] - log.time[0]:.4g} s in {windows} on {arm.robot['name']}"
    )
    table = Table("channel", title=escape(title), title_justify="left")
    table.add_column("rms error", justify="right")
    table.add_column("unit")
    table.add_column("of its rms", justify="right")
    table.add_column("of its noise", justify="right")
    for name, error in found.errors.items():
        share = multiple = ""
        if name in found.driving_channels:
            multiple = "input"
        else:
            if name in found.relative:
                share = f"{100 * found.relative[name]:.3g} %"
            if name in found.counted_channels:
                multiple = f"{error / found.noise[name]:.3g} x"
        table.add_row(name, f"{error:.4g}", find_channel_unit(arm, name), share, multiple)
    console = Console(highlight=False)
    console.print(table)
    if math.isfinite(found.gap):
        channels = "channels"
        if found.driving_channels:
            channels = "channels that the model can err in"
        console.print(f"gap {found.gap:.4g}: geometric mean over the {channels}, in multiples of noise", markup=False)
    if force is not None:
        said = ", ".join(f"joint {j} {100 * share:.2f} %" for j, share in enumerate(force, 1))
        console.print(f"force error of the inverse dynamics: {said}", markup=False)
    for note in notes:
        console.print(f"note: {note}", markup=False)
    if options.out is not None:
        console.print(f"written: {options.out}", markup=False)
