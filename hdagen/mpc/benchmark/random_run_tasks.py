"""Random runs of the table as tasks, so that workers drive them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict
from functools import cache
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.task import Status, Task, TaskFolder
from hdagen.mpc.benchmark.law_comparison import RandomRun, RandomRunBench, drive_random_run, make_random_bench
from hdagen.mpc.closed_loop_trial import TrialOutcome


def drive_runs_on_cluster(
    count: int, tuned: Mapping[str, float], profile: str, asked: ClusterRequest, say: Callable[[str], None]
) -> Iterator[RandomRun]:
    """Drive random runs where a request says.

    Args:
        count: Count of runs; the seed of the first is 0.
        tuned: Gains of the admittance law.
        profile: Profile of the builds.
        asked: Where runs are driven.
        say: Hears a sentence on addresses and workers.

    Yields:
        The runs as they end.

    Raises:
        PlantError: A run fails, or no worker can take tasks.

    """
    shared = {"profile": profile, "tuned": dict(tuned)}
    tasks = [Task(f"run {seed}", drive_run_task, {"seed": seed, **shared}) for seed in range(count)]
    with open_cluster(asked, say) as runner, closing(runner.run_tasks(tasks)) as ended:
        for task, outcome in ended:
            if outcome.status is not Status.DONE:
                raise PlantError(f"{task.name}: {' '.join(outcome.messages)}")
            yield _read_run(outcome.row)


def drive_run_task(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Drive one random run.

    Args:
        folder: Stays empty.
        parameters: Seed of the run, gains of the admittance law, and profile of the builds.

    Returns:
        The fields of the run.

    Raises:
        PlantError: A build fails, or a controller refuses its configuration.

    """
    bench = _find_bench(tuple(sorted(parameters["tuned"].items())), parameters["profile"])
    return asdict(drive_random_run(bench, parameters["seed"]))


@cache
def _find_bench(tuned: tuple[tuple[str, float], ...], profile: str) -> RandomRunBench:
    """What all runs of this process share."""
    return make_random_bench(dict(tuned), profile)


def _read_run(row: Mapping[str, Any]) -> RandomRun:
    outcomes = {name: TrialOutcome(**row[name]) for name in ("predictive", "free", "admittance")}
    return RandomRun(**{**row, **outcomes})
