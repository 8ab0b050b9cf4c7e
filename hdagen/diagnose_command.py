"""`hdagen diagnose`: which unmodelled effect makes model and log differ, and how far the gap shrinks with it."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

EXAMPLE = """example:
  hdagen diagnose robot.toml log.parquet
  hdagen diagnose robot.toml log.parquet --hold-out other.parquet --out diagnosis-log

writes diagnosis.json and report.html; `hdagen replay --with` and `hdagen adopt` take the former.
exit codes: 0 done, 2 usage or configuration, 3 data unusable; docs/diagnosis.md says how it decides"""


def add_parser(commands: Any) -> None:
    """The command's arguments."""
    p = commands.add_parser(
        "diagnose",
        help="say which unmodelled effect makes model and log differ",
        description="Fits every effect on every joint to a log and says which is missing in the model, how probable "
        "that is, and how far the gap shrinks on motion that the fit did not see.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("robot", help="a preset or a robot.toml")
    p.add_argument("log", type=Path, metavar="LOG", help=".csv, .parquet or .mat")
    p.add_argument("--columns", type=Path, metavar="columns.toml", help="names, units and signs of a foreign log")
    p.add_argument("--hold-out", type=Path, metavar="LOG", help="another motion of the same machine")
    p.add_argument("--out", type=Path, metavar="DIR", help="default: ./diagnosis-<log>")


def run(options: argparse.Namespace) -> int:
    """Diagnose, write, print."""
    from hdagen.diagnosis import report
    from hdagen.diagnosis.diagnose import diagnose
    from hdagen.log import LogError, read
    from hdagen.plant import PlantError

    out = options.out or Path(f"diagnosis-{options.log.stem}")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PlantError(f"--out {out}: cannot be made ({error.strerror}); name another folder.") from None
    try:
        log = read(options.log, columns=options.columns, holes=True)
        held = read(options.hold_out, columns=options.columns, holes=True) if options.hold_out else None
    except OSError as error:
        raise LogError([f"{error.filename}: cannot be read ({error.strerror})."]) from None
    begun = time.monotonic()
    found = diagnose(
        options.robot, log, held, lambda stage: print(f"{time.monotonic() - begun:5.1f} s  {stage}", file=sys.stderr)
    )
    _write(out / "diagnosis.json", json.dumps(found.content, indent=1, allow_nan=False) + "\n")
    report.write(found, out / "report.html")
    print(report.sentence(found.content))
    print(out / "report.html")
    return 0


def _write(path: Path, text: str) -> None:
    """Whole or not at all."""
    beside = path.with_name(f".{path.name}.new")
    beside.write_text(text, encoding="utf-8")
    os.replace(beside, path)
