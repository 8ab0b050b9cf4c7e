"""`hdagen build`: a robot file becomes a folder of C with a compiled library."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

BUILD_EXAMPLE = """example:
  hdagen build robot.toml
  hdagen build paper --profile native --effects backlash,payload

prints the folder of the build, which is used again until robot file, effects, compiler or hdagen change.
exit codes: 0 done, 2 usage, configuration, no compiler or no place to write"""
DONE = 0


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "build",
        help="generate and compile a robot",
        description="Generates the C of a robot, compiles it, and prints the folder.",
        epilog=BUILD_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("robot", nargs="?", default="paper", help="a preset or a robot.toml (default: paper)")
    add_build_options(p)
    p.add_argument("--json", action="store_true", help="print folder, build and profile as JSON")


def add_build_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that decide which build of a robot is meant.

    Args:
        parser: The parser of a command.

    """
    parser.add_argument("--profile", choices=("portable", "native"), default="portable", help="how the arm is compiled")
    parser.add_argument("--effects", default="", metavar="NAMES", help="effects to add, with commas, or all")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of the builds (default: $HDAGEN_BUILD, ./build or the cache)"
    )


def read_effect_names(options: argparse.Namespace) -> tuple[str, ...]:
    """Read the names of the effects to add.

    Args:
        options: The parsed arguments.

    Returns:
        The names, in the order in which they were given.

    """
    return tuple(filter(None, (name.strip() for name in options.effects.split(","))))


def run(options: argparse.Namespace) -> int:
    """Build and print the folder.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    """
    from hdagen.arm.build_loader import find_or_build
    from hdagen.arm.running_builds import show_builds

    with show_builds():
        folder = find_or_build(options.robot, options.profile, read_effect_names(options), options.out)
    if options.json:
        print(json.dumps({"folder": str(folder), "profile": options.profile, "effects": read_effect_names(options)}))
    else:
        print(folder)
    return DONE
