"""Child processes: one that makes a log, and the commands of hdagen in an environment that says nothing."""

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

_PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "HDAGEN_BUILD", "CC", "LD_LIBRARY_PATH")
_PACKAGE = Path(__file__).parents[2]


class ChildError(Exception):
    """A child that failed; its last words."""


@dataclass(frozen=True)
class Ended:
    """A command's exit ``code``, last ``words`` and ``seconds``."""

    code: int
    words: str
    seconds: float


def clean_environment() -> dict[str, str]:
    """What a child may know of this process: where programs and builds are, nothing else."""
    known = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    if "HDAGEN_BUILD" in known:
        known["HDAGEN_BUILD"] = str(Path(known["HDAGEN_BUILD"]).absolute())
    return {**known, "PYTHONPATH": str(_PACKAGE)}


def ask(request: Mapping[str, Any]) -> dict[str, Any]:
    """The answer of `hdagen.blind.make`; seed and truth go through pipes only. Raises ChildError."""
    done = subprocess.run(
        [sys.executable, "-P", "-m", "hdagen.blind.make"],
        input=json.dumps(request),
        capture_output=True,
        text=True,
        env=clean_environment(),
        check=False,
    )
    if done.returncode:
        raise ChildError(f"a case could not be simulated: {_last(done.stderr)}")
    return dict(json.loads(done.stdout))


def run(command: Sequence[str], folder: Path, most_seconds: float) -> Ended:
    """Run ``command`` in ``folder``; raises ChildError where it takes longer than ``most_seconds``."""
    start = time.monotonic()
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            env=clean_environment(),
            timeout=most_seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ChildError(f"{command[3]} was stopped after {most_seconds:g} s") from None
    return Ended(done.returncode, _last(done.stderr), time.monotonic() - start)


def _last(words: str) -> str:
    lines = [line for line in words.strip().splitlines() if line.strip()]
    return lines[-1][:300] if lines else "without a word"
