"""The commands that repeat a diagnosis and use it, as its page shows them."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path


def format_commands(
    robot: str | Path, logs: Sequence[str], holdout: Sequence[str], columns: str | Path | None, identity: str
) -> str:
    """Format the commands that repeat a diagnosis and use it, as a shell takes them.

    Args:
        robot: a preset or a robot.toml.
        logs: paths of the logs.
        holdout: paths of the hold-out logs.
        columns: path of the columns.toml, if there is one.
        identity: identity of the robot, of its numbers alone.

    Returns:
        The text below the report.

    """
    shown, mapped, held = shlex.quote(str(robot)), "", ""
    if columns:
        mapped = f" --columns {shlex.quote(str(columns))}"
    if holdout:
        held = f" --hold-out {shlex.join(holdout)}"
    motion = shlex.quote((holdout or logs)[0])
    return (
        f"    hdagen diagnose {shown} {shlex.join(logs)}{held}{mapped}\n"
        f"    hdagen replay {shown} {motion}{mapped} --with diagnosis.json --out predicted.parquet\n"
        f"    hdagen adopt diagnosis.json {shown} --out robot.new.toml\n\n"
        f"The robot's identity, of its numbers alone, is {identity}. The same input gives the same diagnosis."
    )
