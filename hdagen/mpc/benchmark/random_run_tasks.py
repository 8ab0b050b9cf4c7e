"""Random runs of the table as tasks, so that workers drive them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from functools import cache
from pathlib import Path
from typing import Any

from hdagen.arm.arrays import is_number
from hdagen.arm.build_loader import PlantError
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.installation import describe_installation
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Status, Task, TaskFolder
from hdagen.mpc.benchmark.law_comparison import RandomRun, RandomRunBench, drive_random_run, make_random_bench
from hdagen.mpc.closed_loop_trial import TrialOutcome

_OUTCOME_NUMBERS = tuple(one.name for one in fields(TrialOutcome) if one.name != "violated")


def drive_runs_on_cluster(
    count: int,
    tuned: Mapping[str, float],
    profile: str,
    folder: Path,
    asked: ClusterRequest,
    say: Callable[[str], None],
) -> tuple[list[RandomRun], bool]:
    """Drive the random runs that an earlier call into the same folder has not finished.

    Args:
        count: Count of runs; the seed of the first is 0.
        tuned: Gains of the admittance law.
        profile: Profile of the builds.
        folder: Folder of the results, which is there: a folder for each run, and results.parquet of all.
        asked: Where runs are driven.
        say: Hears how far the work is.

    Returns:
        The finished runs by their seeds, and whether an interrupt stopped the work.

    Raises:
        PlantError: A run fails, the folder is another call's, or no worker can take tasks; what is finished is kept.
        OSError: A result cannot be written.

    """
    shared = {"profile": profile, "tuned": dict(tuned), "code": describe_installation()["code"]}
    tasks = [
        Task(f"run {seed}", drive_run_task, {"seed": seed, **shared}, accepts_row=is_run_row) for seed in range(count)
    ]
    store = ResultStore(folder)
    with store.hold_lock(), open_cluster(asked, say) as runner:
        outcomes, interrupted = run_campaign(tasks, store, runner, say)
    for name, outcome in outcomes.items():
        if outcome.status in (Status.FAILED, Status.REFUSED):
            raise PlantError(f"{name}: {' '.join(outcome.messages)}")
    return [_read_run(one.row) for one in outcomes.values() if one.status is Status.DONE], interrupted


def drive_run_task(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Drive one random run.

    Args:
        folder: Stays empty.
        parameters: Seed of the run, gains of the admittance law, profile of the builds, and hash of the code.

    Returns:
        The fields of the run.

    Raises:
        PlantError: A build fails, a controller refuses its configuration, or a number of the run is not finite.

    """
    bench = _find_bench(tuple(sorted(parameters["tuned"].items())), parameters["profile"])
    row = asdict(drive_random_run(bench, parameters["seed"]))
    if not is_run_row(row):
        raise PlantError("a number of the run is not finite; drive this seed alone to see where.")
    return row


@cache
def _find_bench(tuned: tuple[tuple[str, float], ...], profile: str) -> RandomRunBench:
    """What all runs of this process share."""
    return make_random_bench(dict(tuned), profile)


def is_run_row(row: Mapping[str, Any]) -> bool:
    """Tell whether a row, read from a file, has all that the table shows.

    Args:
        row: The row.

    Returns:
        Whether it is as `drive_run_task` makes it.

    """
    try:
        run = _read_run(row)
    except (LookupError, TypeError):
        return False
    outcomes = (run.predictive, run.free, run.admittance)
    numbers = [run.seed, run.delay, *(getattr(one, each) for one in outcomes for each in _OUTCOME_NUMBERS)]
    return all(is_number(one) for one in numbers) and all(isinstance(one.violated, dict) for one in outcomes)


def _read_run(row: Mapping[str, Any]) -> RandomRun:
    outcomes = {name: TrialOutcome(**row[name]) for name in ("predictive", "free", "admittance")}
    return RandomRun(**{**row, **outcomes})
