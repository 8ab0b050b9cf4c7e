"""Figures made and stored, in as many processes as there are processors; finished figures are left alone."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from hdagen.paper import figure_store
from hdagen.paper.figure_catalogue import Listed
from hdagen.paper.prototype.virtual_prototype import ROBOT, TABLE_1, THREE, Bench

Content = dict[str, Any]  # the JSON of a figure
LONGEST = "maps"  # the module that starts first; its threads use the processors that other processes leave
_worker: dict[str, Bench] = {}  # the bench that a worker process keeps from group to group


def produce(
    figures: Sequence[Listed], folder: Path, profile: str, processes: int, say: Callable[[str], None]
) -> Iterator[tuple[Listed, Content, bool]]:
    """Make figures, and store their files.

    Args:
        figures: the figures.
        folder: of their files.
        profile: of the arms' builds.
        processes: how many processes make figures at the same time.
        say: called with the title of the figure that is being made, or was made by another process.

    Yields:
        Each figure with its JSON, and whether it was made now; in the order in which they are done.

    Raises:
        PlantError: an arm cannot be built, or a file cannot be written.

    """
    bench = Bench(profile)
    say("building the arms")
    arms = [*(bench.arm(robot) for robot in (ROBOT, TABLE_1, THREE)), bench.lean()]
    builds = tuple(arm.folder.name for arm in arms)
    came_from = figure_store.inputs(builds)
    groups: dict[str, list[Listed]] = {}  # figures that share runs
    for figure in figures:
        done = figure_store.finished(folder, figure.name, came_from)
        if done is not None:
            yield figure, done, False
        else:
            groups.setdefault(figure.module, []).append(figure)
    order = sorted(groups.values(), key=lambda group: group[0].module != LONGEST)
    if processes < 2 or len(groups) < 2:
        for figure in (figure for group in order for figure in group):
            say(figure.title)
            yield figure, made(bench, figure, folder, came_from), True
        return
    yield from _together(order, folder, bench, came_from, processes, say)


def _together(
    groups: list[list[Listed]], folder: Path, bench: Bench, came_from: str, processes: int, say: Callable[[str], None]
) -> Iterator[tuple[Listed, Content, bool]]:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context, _begin, (bench,)) as pool:
        heard = signal.signal(signal.SIGINT, signal.SIG_IGN)  # workers inherit this until they have begun
        waiting = {pool.submit(_group, group, folder, came_from): group for group in groups}
        signal.signal(signal.SIGINT, heard)
        try:
            for future in as_completed(waiting):
                for figure, content in zip(waiting[future], future.result(), strict=True):
                    say(figure.title)
                    yield figure, content, True
        except BaseException:
            for worker in multiprocessing.active_children():
                os.kill(worker.pid or 0, signal.SIGINT)
            pool.shutdown(cancel_futures=True)
            raise


def _begin(bench: Bench) -> None:
    """Start a worker with a bench of its own, whose runs all its groups share."""
    _worker["bench"] = bench
    signal.signal(signal.SIGINT, _stop)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when its parent has died, as no more work would ever come."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _stop(*_: object) -> None:
    """End an interrupted worker: it leaves its figure, begins nothing more, and prints nothing, as the parent does."""
    _worker.clear()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.unraisablehook = lambda _: None  # for an interrupt in a callback, where SystemExit cannot be raised
    sys.exit(1)


def _group(group: list[Listed], folder: Path, came_from: str) -> list[Content]:
    if not _worker:
        sys.exit(1)
    return [made(_worker["bench"], figure, folder, came_from) for figure in group]


def made(bench: Bench, figure: Listed, folder: Path, came_from: str) -> Content:
    """Simulate and draw a figure and write its files; return its JSON."""
    begun = time.perf_counter()
    result = figure.make(bench)
    return figure_store.put(folder, result, came_from, time.perf_counter() - begun)


def processors() -> int:
    """Count the processors that this process may use, two at most: the longest figure needs no more."""
    if hasattr(os, "sched_getaffinity"):
        return min(2, len(os.sched_getaffinity(0)))
    return min(2, os.cpu_count() or 1)
