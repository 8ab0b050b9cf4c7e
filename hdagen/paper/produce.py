"""Figures made and put away, in as many processes as there are processors; what is finished is left alone."""

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

from hdagen.paper import store
from hdagen.paper.listed import Listed
from hdagen.paper.prototype import ROBOT, TABLE_1, THREE, Bench

Content = dict[str, Any]  # the JSON of a figure
LONGEST = "sweeps"  # the module that is begun first; its threads take what the other processes leave
_worker: dict[str, Bench] = {}  # what a worker process keeps from group to group


def produce(
    figures: Sequence[Listed], folder: Path, profile: str, processes: int, say: Callable[[str], None]
) -> Iterator[tuple[Listed, Content, bool]]:
    """Every figure with its JSON, and whether it was made now; in the order in which they are done. Raises
    PlantError."""
    bench = Bench(profile)
    say("building the arms")
    arms = [*(bench.arm(robot) for robot in (ROBOT, TABLE_1, THREE)), bench.lean()]
    builds = tuple(arm.folder.name for arm in arms)
    came_from = store.inputs(builds)
    groups: dict[str, list[Listed]] = {}  # what shares runs
    for figure in figures:
        done = store.finished(folder, figure.name, came_from)
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
        heard = signal.signal(signal.SIGINT, signal.SIG_IGN)  # workers take this over until they have begun
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
    """A worker's own bench, whose runs all groups share that it makes."""
    _worker["bench"] = bench
    signal.signal(signal.SIGINT, _stop)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when its parent has died without a word: what it waits for would never come."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _stop(*_: object) -> None:
    """What a worker does when interrupted: leave what it makes, begin nothing more, and say nothing, for the parent
    does."""
    _worker.clear()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.unraisablehook = lambda _: None  # where this comes in the midst of a callback, which cannot raise it
    sys.exit(1)


def _group(group: list[Listed], folder: Path, came_from: str) -> list[Content]:
    if not _worker:
        sys.exit(1)
    return [made(_worker["bench"], figure, folder, came_from) for figure in group]


def made(bench: Bench, figure: Listed, folder: Path, came_from: str) -> Content:
    """One figure, simulated, drawn and written."""
    begun = time.perf_counter()
    result = figure.make(bench)
    return store.put(folder, result, came_from, time.perf_counter() - begun)


def processors() -> int:
    """How many this process may use, two at most: more than the longest figure needs is of no use."""
    return min(2, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
