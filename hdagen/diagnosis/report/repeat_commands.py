"""The commands that repeat a diagnosis, and those that follow from it, as its page shows them."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.diagnosis.report.gap_words import list_named_effects
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.pages.first_screen import NextCommand


@dataclass(frozen=True)
class DiagnosedFiles:
    """The files of a diagnosis, as the caller named them.

    Attributes:
        robot: a preset or a robot.toml.
        logs: paths of the logs.
        holdout: paths of the hold-out logs.
        folder: where diagnosis.json and the page are written.
        columns: path of the columns.toml that the logs were read with, if there is one.

    """

    robot: str | Path
    logs: tuple[str, ...]
    holdout: tuple[str, ...]
    folder: str | Path
    columns: str | Path | None = None

    @property
    def shell_robot(self) -> str:
        """The robot as a shell takes it."""
        return shlex.quote(str(self.robot))

    @property
    def shell_diagnosis(self) -> str:
        """The path of diagnosis.json as a shell takes it."""
        return shlex.quote(str(Path(self.folder) / "diagnosis.json"))


def format_commands(files: DiagnosedFiles, identity: str, *, is_complete: bool = True) -> str:
    """Format the commands that repeat a diagnosis and its replay, as a shell takes them.

    Args:
        files: of the diagnosis.
        identity: identity of the robot, of its numbers alone.
        is_complete: whether everything was tried, whatever time it took.

    Returns:
        The text below the report.

    """
    mapped, held = "", ""
    if files.columns:
        mapped = f" --columns {shlex.quote(str(files.columns))}"
    if files.holdout:
        held = f" --hold-out {shlex.join(files.holdout)}"
    motion = shlex.quote((files.holdout or files.logs)[0])
    predicted = f"--with {files.shell_diagnosis} --out predicted.parquet"
    repeats = "The same input gives the same diagnosis."
    if not is_complete:
        repeats = "How much was tried before the time was up depends on the machine; this command has no limit of time."
    return (
        f"    hdagen diagnose {files.shell_robot} {shlex.join(files.logs)}{held}{mapped}\n"
        f"    hdagen replay {files.shell_robot} {motion}{mapped} {predicted}\n\n"
        f"The robot's identity, of its numbers alone, is {identity}. {repeats}"
    )


def list_next_commands(content: Mapping[str, Any], files: DiagnosedFiles) -> list[NextCommand]:
    """List the commands that follow from a diagnosis, the first one first.

    Args:
        content: of diagnosis.json.
        files: of the diagnosis.

    Returns:
        The commands, each with its purpose.

    """
    take, what = [], "it"
    if not list_named_effects(content):
        what = "the refitted numbers"
    if (list_named_effects(content) or content["parameters"]) and not content["contradicted"]:
        robot, found = files.shell_robot, files.shell_diagnosis
        take = [
            NextCommand(f"Take {what} into the robot file:", f"hdagen adopt {found} {robot} --out robot.new.toml"),
            NextCommand(f"Take {what} into MuJoCo:", f"hdagen export mjcf {robot} --with {found} --out robot.xml"),
        ]
    record = [_suggest_motion(content, files)]
    if content["sure"] and list_named_effects(content):
        return [*take, *record]
    return [*record, *take]


def _suggest_motion(content: Mapping[str, Any], files: DiagnosedFiles) -> NextCommand:
    """The command that designs the motion which would decide what this log leaves open."""
    causes = {f"{cause['effect']}@{cause['joint']}": cause for cause in content["causes"]}
    command = f"hdagen excite {files.shell_robot}"
    if still := content.get("data", {}).get("still", ()):
        return NextCommand("Design a motion of the joint that stood still:", f"{command} --joint {still[0]}")
    named = [name for name in list_named_effects(content) if name in causes]
    rivals = [other for name in named for other in causes[name]["confounded_with"]]
    rivals = [name for name in dict.fromkeys(rivals) if name not in named]
    if named and rivals:
        pair = ",".join([named[0], *rivals[: REPORT.most_separated - 1]])
        return NextCommand("Design a motion that tells the rivals apart:", f"{command} --separate {pair}")
    likely = [name for name in causes if name not in content["undetectable"]][: REPORT.most_separated]
    if not named and len(likely) > 1:
        return NextCommand("Design a motion that shows more:", f"{command} --separate {','.join(likely)}")
    joint = max((int(entry.partition("@")[2]) for entry in content["verdict"]), default=1)
    return NextCommand("Design the next motion:", f"{command} --joint {max(joint, 1)}")
