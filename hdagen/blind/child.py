"""Child processes: one that makes a log, and the commands of hdagen in an environment that says nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.children import start_together

_PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "CC", "LD_LIBRARY_PATH")
_PACKAGE = Path(__file__).parents[2]
_LOOK = 0.05  # s between looks at whether to stop
MAKER = (sys.executable, "-P", "-m", "hdagen.blind.make")


class ChildError(Exception):
    """A child that failed or was stopped; its last words."""


@dataclass(frozen=True)
class Ended:
    """A command's exit ``code``, what it printed, its last ``words`` on standard error, and ``seconds``."""

    code: int
    printed: str
    words: str
    seconds: float


def clean_environment(builds: Path) -> dict[str, str]:
    """What a child may know of this process: where programs and builds are, nothing else."""
    known = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    return {**known, "PYTHONPATH": str(_PACKAGE), "HDAGEN_BUILD": str(builds.absolute())}


def ask(request: Mapping[str, Any], builds: Path, stop: threading.Event) -> dict[str, Any]:
    """The answer of `hdagen.blind.make`; seed and truth go through pipes and memory only. Raises ChildError."""
    ended = run(MAKER, Path.cwd(), builds, stop, told=json.dumps(request))
    if ended.code:
        raise ChildError(f"the case could not be simulated: {ended.words}")
    return dict(json.loads(ended.printed))


def run(
    command: Sequence[str],
    folder: Path,
    builds: Path,
    stop: threading.Event,
    most_seconds: float = 3600.0,
    told: str = "",
) -> Ended:
    """Run ``command`` in ``folder`` with ``told`` as its input.

    An interrupt from the keyboard reaches it through ``stop`` only. Raises ChildError where it takes longer than
    ``most_seconds`` or is stopped.
    """
    start, pipe = time.monotonic(), subprocess.PIPE
    how = {"cwd": folder, "env": clean_environment(builds), "stdin": pipe, "stdout": pipe, "stderr": pipe, "text": True}
    with start_together(command, **how) as child:
        given: str | None = told
        while True:
            try:
                printed, complained = child.communicate(given, timeout=_LOOK)
                break
            except subprocess.TimeoutExpired:
                given = None  # the rest of it is on its way already
                if stop.is_set():
                    raise ChildError("stopped") from None
                if time.monotonic() - start > most_seconds:
                    raise ChildError(f"it was stopped after {most_seconds:g} s") from None
    return Ended(child.returncode, printed, _last(complained), time.monotonic() - start)


def _last(words: str) -> str:
    lines = [line for line in words.splitlines() if line.strip()]
    return lines[-1].strip()[:300] if lines else "without a word"
