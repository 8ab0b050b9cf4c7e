"""Figures made and put away, in as many processes as there are processors; what is finished is left alone."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from hdagen.paper import store
from hdagen.paper.listed import Listed
from hdagen.paper.prototype import ROBOT, TABLE_1, THREE, Bench

Content = dict[str, Any]  # the JSON of a figure


def produce(
    figures: Sequence[Listed], folder: Path, profile: str, processes: int, say: Callable[[str], None]
) -> Iterator[tuple[Listed, Content, bool]]:
    """Every figure with its JSON, and whether it was made now; in the order in which they are done. Raises
    PlantError."""
    bench = Bench(profile, threads=1 if processes > 1 else 2)
    say("building the arms")
    builds = tuple(bench.arm(robot).folder.name for robot in (ROBOT, TABLE_1, THREE))
    came_from = store.inputs(builds)
    groups: dict[str, list[Listed]] = {}  # what shares runs
    for figure in figures:
        done = store.finished(folder, figure.name, came_from)
        if done is not None:
            yield figure, done, False
        else:
            groups.setdefault(figure.name if figure.alone else figure.module, []).append(figure)
    order = sorted(groups.values(), key=lambda group: not group[0].alone)  # sweeps take longest and go first
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
    with ProcessPoolExecutor(processes, context) as pool:
        waiting = {pool.submit(_group, group, folder, bench, came_from): group for group in groups}
        try:
            for future in as_completed(waiting):
                for figure, content in zip(waiting[future], future.result(), strict=True):
                    say(figure.title)
                    yield figure, content, True
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _group(group: list[Listed], folder: Path, bench: Bench, came_from: str) -> list[Content]:
    return [made(bench, figure, folder, came_from) for figure in group]


def made(bench: Bench, figure: Listed, folder: Path, came_from: str) -> Content:
    """One figure, simulated, drawn and written."""
    begun = time.perf_counter()
    result = figure.make(bench)
    return store.put(folder, result, came_from, time.perf_counter() - begun)


def processors() -> int:
    """How many this process may use, two at most: more than the longest figure needs is of no use."""
    return min(2, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
