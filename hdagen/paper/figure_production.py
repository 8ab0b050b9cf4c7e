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
from hdagen.paper.figure_catalogue import FigureEntry
from hdagen.paper.prototype.virtual_prototype import PROTOTYPE, TABLE_1, THREE_JOINTS, Bench

FigureContent = dict[str, Any]  # the JSON of a figure
FIRST_MODULE = "maps"  # the module that starts first; its threads use the processors that other processes leave
_worker_bench: dict[str, Bench] = {}  # the bench that a worker process keeps from group to group


def make_figures(
    figures: Sequence[FigureEntry], folder: Path, profile: str, processes: int, say: Callable[[str], None]
) -> Iterator[tuple[FigureEntry, FigureContent, bool]]:
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
    arms = [*(bench.arm(robot) for robot in (PROTOTYPE, TABLE_1, THREE_JOINTS)), bench.lean_arm()]
    builds = tuple(arm.folder.name for arm in arms)
    came_from = figure_store.hash_inputs(builds)
    groups: dict[str, list[FigureEntry]] = {}  # figures that share runs
    for figure in figures:
        done = figure_store.read_finished(folder, figure.name, came_from)
        if done is not None:
            yield figure, done, False
        else:
            groups.setdefault(figure.module, []).append(figure)
    order = sorted(groups.values(), key=lambda group: group[0].module != FIRST_MODULE)
    if processes < 2 or len(groups) < 2:
        for figure in (figure for group in order for figure in group):
            say(figure.title)
            yield figure, make_figure_files(bench, figure, folder, came_from), True
        return
    yield from _make_in_processes(order, folder, bench, came_from, processes, say)


def _make_in_processes(
    groups: list[list[FigureEntry]],
    folder: Path,
    bench: Bench,
    came_from: str,
    processes: int,
    say: Callable[[str], None],
) -> Iterator[tuple[FigureEntry, FigureContent, bool]]:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context, _begin_worker, (bench,)) as pool:
        heard = signal.signal(signal.SIGINT, signal.SIG_IGN)  # workers inherit this until they have begun
        waiting = {pool.submit(_make_group, group, folder, came_from): group for group in groups}
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


def _begin_worker(bench: Bench) -> None:
    """Start a worker with a bench of its own, whose runs all its groups share."""
    _worker_bench["bench"] = bench
    signal.signal(signal.SIGINT, _stop_worker)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when its parent has died, as no more work would ever come."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _stop_worker(*_: object) -> None:
    """End an interrupted worker: it leaves its figure, begins nothing more, and prints nothing, as the parent does."""
    _worker_bench.clear()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.unraisablehook = lambda _: None  # for an interrupt in a callback, where SystemExit cannot be raised
    sys.exit(1)


def _make_group(group: list[FigureEntry], folder: Path, came_from: str) -> list[FigureContent]:
    if not _worker_bench:
        sys.exit(1)
    return [make_figure_files(_worker_bench["bench"], figure, folder, came_from) for figure in group]


def make_figure_files(bench: Bench, figure: FigureEntry, folder: Path, came_from: str) -> FigureContent:
    """Simulate and draw a figure and write its files; return its JSON."""
    begun = time.perf_counter()
    result = figure.make_result(bench)
    return figure_store.store_figure(folder, result, came_from, time.perf_counter() - begun)


def count_processors() -> int:
    """Count the processors that this process may use, two at most: the longest figure needs no more."""
    if hasattr(os, "sched_getaffinity"):
        return min(2, len(os.sched_getaffinity(0)))
    return min(2, os.cpu_count() or 1)
