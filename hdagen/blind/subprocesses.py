"""Child processes of a check: one that makes a log, and hdagen's commands in an environment that reveals nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import find_build_folder
from hdagen.support.child_processes import start_child_process

_PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "CC", "LD_LIBRARY_PATH")
_PACKAGE = Path(__file__).parents[2]
HDAGEN_COMMAND = (sys.executable, "-P", "-m", "hdagen")
MAKE_COMMAND = (sys.executable, "-P", "-m", "hdagen.blind.realities.log_maker")


class ChildError(Exception):
    """A child process failed or took too long; the message is its last line."""


@dataclass(frozen=True)
class CommandResult:
    """A command's exit ``code``, its standard output ``printed``, the last ``words`` on standard error, and its
    duration in ``seconds``."""

    code: int
    printed: str
    words: str
    seconds: float


def clean_environment() -> dict[str, str]:
    """Make the environment of a child, which tells where programs and builds are and nothing else.

    Returns:
        Environment variables by name.

    """
    known = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    return {**known, "PYTHONPATH": str(_PACKAGE), "HDAGEN_BUILD": str(find_build_folder().absolute())}


def request_log(request: Mapping[str, Any]) -> dict[str, Any]:
    """Have `hdagen.blind.realities.log_maker` write a log; seed and truth pass through pipes and memory only.

    Args:
        request: the request that `hdagen.blind.realities.log_maker` describes.

    Returns:
        The answer of `hdagen.blind.realities.log_maker`: the truth about the log.

    Raises:
        ChildError: the log could not be made.

    """
    ended = run_command(MAKE_COMMAND, Path.cwd(), told=json.dumps(request))
    if ended.code:
        raise ChildError(f"the case could not be simulated: {ended.words}")
    return dict(json.loads(ended.printed))


def run_command(command: Sequence[str], folder: Path, most_seconds: float = 3600.0, told: str = "") -> CommandResult:
    """Run a command, which ends with this process, however it ends.

    Args:
        command: program and arguments.
        folder: working folder of the command.
        most_seconds: duration after which the command is stopped, s.
        told: text on the command's standard input.

    Returns:
        Exit code, output and duration.

    Raises:
        ChildError: the command took longer than ``most_seconds``.

    """
    start, pipe = time.monotonic(), subprocess.PIPE
    how = {"cwd": folder, "env": clean_environment(), "stdin": pipe, "stdout": pipe, "stderr": pipe, "text": True}
    with start_child_process(command, **how) as child:
        try:
            printed, complained = child.communicate(told, timeout=most_seconds)
        except subprocess.TimeoutExpired:
            raise ChildError(f"it was stopped after {most_seconds:g} s") from None
    return CommandResult(child.returncode, printed, _last_line(complained), time.monotonic() - start)


def _last_line(words: str) -> str:
    lines = [line.strip() for line in words.splitlines() if line.strip()]
    if not lines:
        return "without a word"
    return lines[-1][:300]
