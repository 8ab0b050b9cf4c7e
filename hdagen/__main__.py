"""Command line of hdagen: one module a command, which parses, calls and prints."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

COMMANDS = ("demo", "simulate", "replay", "diagnose", "adopt", "excite", "mpc", "bench", "blind", "paper")
DONE, BAR_MISSED, USAGE, UNUSABLE, INTERRUPTED = 0, 1, 2, 3, 130


def parser() -> argparse.ArgumentParser:
    """The parser with every command's own."""
    top = argparse.ArgumentParser(
        prog="hdagen",
        description="Robot arms with harmonic drives: a compiled model that simulates, controls and replays logs.",
        epilog="exit codes: 0 done, 1 a stated bar failed, 2 usage or configuration, 3 data unusable",
    )
    commands = top.add_subparsers(dest="command", required=True, metavar=" | ".join(COMMANDS))
    for name in COMMANDS:
        importlib.import_module(f"hdagen.{name}_command").add_parser(commands)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns its exit code."""
    options = parser().parse_args(arguments)
    from hdagen.log import LogError
    from hdagen.plant import PlantError

    try:
        return int(importlib.import_module(f"hdagen.{options.command}_command").run(options))
    except PlantError as error:
        print(error, file=sys.stderr)
        return USAGE
    except LogError as error:
        print(error, file=sys.stderr)
        return UNUSABLE
    except KeyboardInterrupt:
        print("interrupted; what was finished is whole, nothing is half-written.", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
