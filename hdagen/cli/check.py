"""`hdagen check`: whether a robot file is right, and what a build of it would be."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from hdagen.cli.build import add_build_options

CHECK_EXAMPLE = """example:
  hdagen check robot.toml
  hdagen check robot.toml --effects all

lists all problems of the file at once, one sentence each; writes nothing.
exit codes: 0 the file is right, 2 it is not"""


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "check",
        help="validate a robot file and say what a build would contain",
        description="Validates a robot file, says what a build of it would contain, and whether its step carries it.",
        epilog=CHECK_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("robot", help="a preset or a robot.toml")
    add_build_options(p)
    p.add_argument("--json", action="store_true", help="print the lines and the problems as JSON")


def run(options: argparse.Namespace) -> int:
    """Check and print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code of the generator: 2 where the robot would not be built.

    """
    from hdagen.arm.build_loader import find_build_folder, find_robot_file
    from hdagen.arm.generator import run_generator

    folder = find_build_folder(options.out)
    robot = find_robot_file(options.robot, folder)
    given = ("--profile", options.profile, f"--effects={options.effects}", f"--out={folder}", "--", robot)
    done = run_generator("check", *given)
    if options.json:
        is_right = done.code == 0
        print(json.dumps({"is_right": is_right, "lines": done.lines, "problems": done.messages}, indent=1))
        return done.code
    for line in done.lines:
        print(line)
    for message in done.messages:
        print(message, file=sys.stderr)
    return done.code
