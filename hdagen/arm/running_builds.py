"""Progress of the builds that child processes make: what each of them is at, for whoever shows it.

A build is started far below the command that shows its progress, and often two at once, so the listener is the
process's: `listen_to_builds` sets it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock

BuildListener = Callable[[str], None]
PROGRESS_MARK = "progress: "  # begins a line of the generator that tells a stage
CLEAR_LINE = "\x1b[K"  # the rest of a terminal's line


class _RunningBuilds:
    """What each running build is at, and who listens."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.listener: BuildListener | None = None
        self.stages: dict[int, str] = {}

    def tell(self, build: int, stage: str) -> None:
        """Keep the stage of a build, empty at its end, and tell those of all."""
        with self.lock:
            if self.stages.get(build, "") == stage:
                return
            self.stages[build] = stage
            if not stage:
                del self.stages[build]
            if self.listener is not None:
                self.listener("; ".join(self.stages.values()))


_running = _RunningBuilds()


def tell_build_stage(build: int, stage: str) -> None:
    """Tell what a build is at.

    Args:
        build: A number of the build's own.
        stage: The stage in words; empty where the build has ended.

    """
    _running.tell(build, stage)


@contextmanager
def listen_to_builds(listener: BuildListener) -> Iterator[None]:
    """Hear of every build that this process waits for.

    Args:
        listener: Is called with the stages of all running builds, from any thread; with "" when the last has ended.

    Yields:
        Nothing, while it hears.

    """
    before, _running.listener = _running.listener, listener
    try:
        yield
    finally:
        _running.listener = before


@contextmanager
def show_builds() -> Iterator[None]:
    """Show the stages of builds on a terminal, as one line that is overwritten; elsewhere nothing.

    Yields:
        Nothing, while they are shown.

    """
    if not sys.stderr.isatty():
        yield
        return
    with listen_to_builds(_overwrite_line):
        yield


def _overwrite_line(words: str) -> None:
    """The cursor goes back to the line's start, so that whatever is printed next takes its place."""
    print(f"{words}{CLEAR_LINE}", end="\r", file=sys.stderr, flush=True)
