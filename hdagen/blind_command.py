"""`hdagen blind`: how often `hdagen diagnose` is right on realities whose effects it cannot know."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

EXAMPLE = """example:
  hdagen blind --kind single --cases 200
  hdagen blind --kind background --cases 48 --write made-here

exit codes: 0 done, 2 usage or configuration; docs/blind.md says what is simulated, sealed and scored"""
DONE, USAGE = 0, 2


def add_parser(commands: Any) -> None:
    """The command's arguments."""
    from hdagen.blind import KINDS

    p = commands.add_parser(
        "blind",
        help="check the diagnosis on data whose effect is withheld",
        description="Makes realities by another simulator, seals their labels, diagnoses, opens the seal, scores.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("--kind", choices=KINDS, required=True, help="what the realities have that the robot files lack")
    p.add_argument("--cases", type=int, default=48, metavar="N", help="how many (default: 48)")
    p.add_argument("--seed", metavar="S", help="any text (default: drawn by the system, told after scoring)")
    p.add_argument("--jobs", type=int, default=2, metavar="J", help="cases at the same time (default: 2)")
    p.add_argument("--write", type=Path, metavar="DIR", help="write the cases, labels beside them, and check nothing")


def run(options: argparse.Namespace) -> int:
    """Write."""
    from hdagen.blind import write

    write.write(options.write, options.kind, options.cases, options.seed, options.jobs, lambda s: print(s, flush=True))
    return DONE
