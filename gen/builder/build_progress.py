"""Progress of a build: the stage that it is at, and how many objects are compiled of all.

On a terminal it is one line that is overwritten and gone in the end. A program that starts a build asks for lines that
begin with `PROGRESS_MARK`; elsewhere nothing is shown.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

StageListener = Callable[[str], None]
PROGRESS_MARK = "progress: "  # begins a line for the program that started the build
CLEAR_LINE = "\x1b[K"  # the rest of a terminal's line


def ignore_stage(words: str) -> None:
    """Show nothing.

    Args:
        words: The stage.

    """
    del words


@contextmanager
def show_stages(are_lines_wanted: bool) -> Iterator[StageListener]:
    """Show the stages of a build on standard error.

    Args:
        are_lines_wanted: Whether each stage is a line for another program.

    Yields:
        The listener to which the build tells its stages.

    """
    if are_lines_wanted:
        yield _print_line
        return
    if not sys.stderr.isatty():
        yield ignore_stage
        return
    try:
        yield _overwrite_line
    finally:
        _overwrite_line("")


def _print_line(words: str) -> None:
    print(f"{PROGRESS_MARK}{words}", file=sys.stderr, flush=True)


def _overwrite_line(words: str) -> None:
    """The cursor goes back to the line's start, so that whatever is printed next takes its place."""
    print(f"{words}{CLEAR_LINE}", end="\r", file=sys.stderr, flush=True)
