"""`hdagen robot import`: a URDF or MJCF model becomes a robot file, with the source of every number."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

ROBOT_EXAMPLE = """example:
  hdagen robot import panda.urdf --tip panda_hand_tcp --out panda.toml
  hdagen robot import ur5e.xml --joints shoulder_lift_joint,elbow_joint --at wrist_1_joint=0.3

MuJoCo reads the model: pip install 'hdagen[mujoco]'. A model may also stand wherever a command takes ROBOT.
exit codes: 0 done, 2 the model cannot be imported, or no place to write"""
DONE = 0


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "robot",
        help="import a URDF or MJCF model",
        description="Makes a robot file of a URDF or MJCF model: one chain, the rest welded to it.",
        epilog=ROBOT_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    actions = p.add_subparsers(dest="action", required=True, metavar="import")
    one = actions.add_parser("import", help="write a robot file with the source of every number")
    one.add_argument("model", help="a .urdf, or an MJCF .xml")
    one.add_argument("--base", metavar="LINK", help="where the chain begins (default: the world, or what floats in it)")
    one.add_argument("--tip", metavar="LINK|SITE", help="where it ends (default: before the tree branches)")
    one.add_argument("--joints", metavar="A,B,C", help="its joints (default: all between base and tip)")
    one.add_argument(
        "--at", action="append", default=[], metavar="JOINT=RAD", help="where a joint is held; may be repeated"
    )
    one.add_argument("--out", type=Path, help="the robot file (default: standard output)")
    one.add_argument("--json", action="store_true", help="print the file's text or place, and the notes, as JSON")


def run(options: argparse.Namespace) -> int:
    """Import and write.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    Raises:
        PlantError: The model cannot be imported, or there is a file of that name.

    """
    from hdagen.arm.build_loader import PlantError
    from hdagen.model_import.chain_reduction import ChainRequest
    from hdagen.model_import.model_file import ModelError
    from hdagen.model_import.robot_writing import import_model
    from hdagen.support.atomic_write import write_atomically

    joints = None
    if options.joints is not None:
        joints = tuple(filter(None, (name.strip() for name in options.joints.split(","))))
    request = ChainRequest(options.base, options.tip, joints, _parse_positions(options.at))
    try:
        made = import_model(options.model, request)
    except ModelError as error:
        raise PlantError(str(error)) from None
    for note in made.notes:
        print(note, file=sys.stderr)
    if options.out is not None:
        write_atomically(options.out, made.text.encode())
    if options.json:
        written = None if options.out is None else str(options.out)
        print(json.dumps({"written": written, "notes": list(made.notes), "text": made.text}))
    elif options.out is None:
        print(made.text, end="")
    else:
        print(options.out)
    return DONE


def _parse_positions(stated: list[str]) -> tuple[tuple[str, float], ...]:
    """Joints and where they are held. Raises PlantError where an entry is no JOINT=RAD."""
    import math

    from hdagen.arm.build_loader import PlantError

    found = []
    for entry in stated:
        name, _, value = entry.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not name or not math.isfinite(number):
            raise PlantError(f"--at takes JOINT=RAD, for instance elbow_joint=0.3, not {entry!r}.")
        found.append((name.strip(), number))
    return tuple(found)
