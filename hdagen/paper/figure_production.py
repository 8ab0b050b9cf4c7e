"""Figures made and stored, module by module as tasks; finished figures are left alone."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.task import Status, Task, TaskFolder
from hdagen.paper import figure_store
from hdagen.paper.figure_catalogue import FigureEntry, find_figures
from hdagen.paper.prototype.virtual_prototype import PROTOTYPE, TABLE_1, THREE_JOINTS, Bench

FigureContent = dict[str, Any]  # the JSON of a figure
FIRST_MODULE = "compliance_maps"  # the module that takes longest starts first
_benches: dict[str, Bench] = {}  # by profile: the bench that a process keeps from task to task


def make_figures(
    figures: Sequence[FigureEntry], folder: Path, profile: str, asked: ClusterRequest, say: Callable[[str], None]
) -> Iterator[tuple[FigureEntry, FigureContent, bool]]:
    """Make figures, and store their files.

    Args:
        figures: the figures.
        folder: of their files.
        profile: of the arms' builds.
        asked: where figures are made; on workers those of one module are one task, for they share runs.
        say: called with the title of each figure that was made.

    Yields:
        Each figure with its JSON, and whether it was made now; in the order in which they are done.

    Raises:
        PlantError: an arm cannot be built, a figure cannot be made, or a file cannot be written.

    """
    bench = _find_bench(profile)
    say("building the arms")
    arms = [*(bench.arm(robot) for robot in (PROTOTYPE, TABLE_1, THREE_JOINTS)), bench.lean_arm()]
    came_from = figure_store.hash_inputs(tuple(arm.folder.name for arm in arms))
    groups: dict[str, list[FigureEntry]] = {}  # figures of one task
    has_workers = asked.is_remote or asked.jobs > 1
    for figure in figures:
        done = figure_store.read_finished(folder, figure.name, came_from)
        if done is not None:
            yield figure, done, False
        else:
            groups.setdefault(figure.module if has_workers else figure.name, []).append(figure)
    order = sorted(groups, key=lambda module: module != FIRST_MODULE)
    shared = {"profile": profile, "from": came_from}
    tasks = [Task(key, make_figure_group, {"names": [f.name for f in groups[key]], **shared}) for key in order]
    with open_cluster(asked, say) as runner, closing(runner.run_tasks(tasks)) as ended:
        for task, outcome in ended:
            if outcome.status is not Status.DONE:
                raise PlantError(f"{task.name}: {' '.join(outcome.messages)}")
            for figure in groups[task.name]:
                say(figure.title)
                yield figure, figure_store.keep_figure(folder, figure.name, outcome.files), True


def make_figure_group(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Make the figures of a module, which share runs.

    Args:
        folder: takes the files of the figures.
        parameters: names of the figures, profile of the builds, and the hash of the inputs.

    Returns:
        Nothing: the figures are files.

    Raises:
        PlantError: an arm cannot be built, or matplotlib is missing.

    """
    bench = _find_bench(parameters["profile"])
    for figure in find_figures(parameters["names"]):
        begun = time.perf_counter()
        result = figure.make_result(bench)
        figure_store.store_figure(folder.out, result, parameters["from"], time.perf_counter() - begun)
    return {}


def _find_bench(profile: str) -> Bench:
    """The bench of this process, whose arms and runs all its tasks share."""
    return _benches.setdefault(profile, Bench(profile))


def count_processors() -> int:
    """Count the processors that this process may use, two at most: the longest figure needs no more."""
    if hasattr(os, "sched_getaffinity"):
        return min(2, len(os.sched_getaffinity(0)))
    return min(2, os.cpu_count() or 1)
