"""`hdagen excite`: the safe motion that separates effects best, as a reference to follow."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdagen.excitation.optimal_motion import Excitation, TriedMotion

EXCITE_EXAMPLE = """example:
  hdagen excite robot.toml --separate stribeck_friction,presliding_friction --joint 1
  hdagen excite robot.toml --limits position_1=-0.5:0.5 speed=1.0 tip_y=0.05:0.4 --out reference.csv

writes time and joint_position_reference_j; docs/guides/excite.md says what is tried and what is predicted"""
PRINTED_PAIRS = 3  # pairs of a motion that are printed where all are looked at


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "excite",
        help="design a safe motion that tells effects apart",
        description="Tries motions on the compiled arm, keeps the limits, predicts by how much the log evidence of a "
        "diagnosis tells the effects apart, and writes the best motion's reference.",
        epilog=EXCITE_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("robot", help="a preset or a robot.toml")
    p.add_argument(
        "--separate", default="", metavar="A,B", help="effects, or effect@joint (default: every pair of the joint's)"
    )
    p.add_argument("--joint", default="1", help="number or name of the joint whose effects they are (default: 1)")
    p.add_argument("--duration", type=float, default=10.0, help="s (default: 10)")
    p.add_argument("--period", type=float, default=1e-3, help="from row to row, s (default: 0.001)")
    p.add_argument(
        "--limits",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME=VALUE",
        help="narrower than the robot file's: position=LOW:HIGH, speed=, torque=, current=, each also with _1 for one "
        "joint; the tip's workspace tip_x=LOW:HIGH, tip_y=, and in space tip_z=, where tip_z=0.1:inf is a floor",
    )
    p.add_argument("--out", type=Path, default=Path("reference.csv"), help=".csv or .parquet (default: reference.csv)")
    p.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(options: argparse.Namespace) -> int:
    """Design a motion, write it, print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    Raises:
        PlantError: An option is not possible, or no motion keeps the limits.

    """
    from hdagen.arm.build_loader import PlantError
    from hdagen.arm.compiled_arm import load
    from hdagen.excitation.optimal_motion import excite
    from hdagen.log.data_table import find_write_problems, write_table

    if problems := find_write_problems(options.out):
        raise PlantError("\n".join(f"--out {problem}" for problem in problems))
    limits = _parse_limits(options.limits)
    separate: tuple[str, ...] = ()
    if options.separate:
        separate = tuple(name.strip() for name in options.separate.split(","))
    arm = load(options.robot, "native", ("all",))
    begun = time.monotonic()
    found = excite(
        arm,
        separate,
        options.joint,
        options.duration,
        options.period,
        limits,
        lambda stage: print(f"{time.monotonic() - begun:5.1f} s  {stage}", file=sys.stderr),
    )
    write_table(found.log_columns(), options.out)
    if options.json:
        print(json.dumps(summarize_excitation(found) | {"reference": str(options.out)}, indent=1, allow_nan=False))
    else:
        _print_excitation(found, options.out)
    return 0


def _parse_limits(given: list[str]) -> dict[str, tuple[float, ...]]:
    """NAME=VALUE and NAME=LOW:HIGH as numbers. Raises PlantError."""
    from hdagen.arm.build_loader import PlantError

    limits, problems = {}, []
    for text in given:
        name, _, value = text.partition("=")
        try:
            limits[name] = tuple(float(part) for part in value.split(":"))
        except ValueError:
            problems.append(f"--limits {text}: give NAME=VALUE or NAME=LOW:HIGH with numbers, such as speed=0.5.")
    if problems:
        raise PlantError("\n".join(problems))
    return limits


def summarize_excitation(found: Excitation) -> dict[str, Any]:
    """Sum an excitation up in figures: of each motion the nats by pair and the shares of limits, or why it is dropped.

    Args:
        found: The motions.

    Returns:
        Figures by name, as JSON takes them.

    """
    return {
        "effects": list(found.effects),
        "motion": found.best_motion.name,
        "nats": found.best_motion.smallest_separation,
        "separates": found.is_separating,
        "tried": [_motion_figures(tried) for tried in found.tried_motions],
        "assumed": list(found.limits.notes),
    }


def _motion_figures(tried: TriedMotion) -> dict[str, Any]:
    nats = [{"pair": list(pair), "nats": nats} for pair, nats in _sort_pairs(tried)]
    if tried.safe_run is None:
        kept: dict[str, Any] = {"limits": {}, "scale": None}
    else:
        kept = {"limits": dict(tried.safe_run.limit_shares), "scale": tried.safe_run.scale}
    return {"motion": tried.name, "nats": nats, **kept, "dropped": tried.drop_reason or None}


def _sort_pairs(tried: TriedMotion) -> list[tuple[tuple[str, str], float]]:
    return sorted(tried.separations.items(), key=lambda item: item[1])


def _print_excitation(found: Excitation, out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from hdagen.excitation.optimal_motion import LEAST_SEPARATION, PREDICTION_FACTOR

    pairs = len(found.best_motion.separations)
    headings = ["nats"]
    if pairs > 1:
        headings = ["worst pair, nats", f"told apart of {pairs}"]
    table = Table("motion", box=None, header_style="bold")
    for heading in headings:
        table.add_column(heading, justify="right")
    table.add_column("limits reached")
    for t in found.tried_motions:
        if t.safe_run is None:
            table.add_row(t.name, *["–"] * len(headings), f"dropped: {t.drop_reason}")
            continue
        largest = sorted(t.safe_run.limit_shares.items(), key=lambda item: -item[1])[:3]
        told_apart = sum(nats >= LEAST_SEPARATION * PREDICTION_FACTOR for nats in t.separations.values())
        numbers = [f"{t.smallest_separation:.0f}", str(told_apart)][: len(headings)]
        table.add_row(t.name, *numbers, ", ".join(f"{name} {100 * x:.0f} %" for name, x in largest))
    Console(width=120).print(table)
    for note in found.limits.notes:
        print(note)
    answer = "no"
    if found.is_separating:
        answer = "yes"
    if pairs > 1:
        for (a, b), nats in _sort_pairs(found.best_motion)[:PRINTED_PAIRS]:
            print(f"hardest to tell: {a} and {b}, {nats:.0f} nats")
        print(f"expected to separate every pair: {answer}")
    else:
        print(f"expected to separate: {answer} ({found.best_motion.smallest_separation:.0f} nats)")
    print(f"{out}: {found.best_motion.name}, {len(found.reference.position)} rows of {found.reference.period:g} s")
