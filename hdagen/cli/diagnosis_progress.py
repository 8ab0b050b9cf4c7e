"""Progress of a diagnosis: a live line on a terminal, one line a stage elsewhere, every step of the search by `-v`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hdagen.diagnosis.progress import Progress

REFRESHES_PER_SECOND = 4  # of the live line: a diagnosis needs the processors


@contextmanager
def show_progress(is_verbose: bool) -> Iterator[Progress]:
    """Show how far a diagnosis is.

    Args:
        is_verbose: Whether every stage keeps its line, with the details of the search between them.

    Yields:
        The listener to which the diagnosis tells its stages.

    """
    from hdagen.diagnosis.progress import Progress

    if is_verbose:
        with _print_details():
            yield Progress()
    elif sys.stderr.isatty():
        with _show_live_line() as progress:
            yield progress
    else:
        yield Progress()


@contextmanager
def _print_details() -> Iterator[None]:
    """Print what the library logs."""
    import logging

    logger, handler = logging.getLogger("hdagen"), logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("         %(message)s"))
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


@contextmanager
def _show_live_line() -> Iterator[Progress]:
    """One line that changes in place, and is gone in the end."""
    from rich.console import Console
    from rich.progress import Progress as LiveLine
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    from hdagen.arm.running_builds import listen_to_builds
    from hdagen.diagnosis.progress import Progress

    stage = [""]

    def show_stage(_: float, words: str) -> None:
        stage[0] = words
        line.update(task, description=words)

    def show_builds(words: str) -> None:
        line.update(task, description=": ".join(filter(None, (stage[0], words))))

    columns = (SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    console = Console(stderr=True)
    with LiveLine(*columns, console=console, transient=True, refresh_per_second=REFRESHES_PER_SECOND) as line:
        task = line.add_task("", total=None)
        with listen_to_builds(show_builds):
            yield Progress(show_stage)
