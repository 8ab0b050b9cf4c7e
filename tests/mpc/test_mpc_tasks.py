"""Random runs of the table as tasks: the same bits in this process and on workers, whichever runs share one."""

from __future__ import annotations

import pytest
import trivial_tasks
from mpc_arms import built

from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.task import Status, Task

TUNED = {"bandwidth": 74.2, "observer_bandwidth": 52.8, "velocity_cutoff": 136.8}
COUNT = 3


def test_runs_have_the_same_bits_in_this_process_and_on_two_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """By short runs; in this process all of them share controllers, on workers some do."""
    monkeypatch.setenv("HDAGEN_BUILD", str(built()[0].folder.parent))
    shared = {"profile": "portable", "tuned": TUNED}
    tasks = [Task(f"run {seed}", trivial_tasks.drive_short_run, {"seed": seed, **shared}) for seed in range(COUNT)]

    def drive(jobs: int) -> dict[str, str]:
        with open_cluster(ClusterRequest(jobs=jobs), lambda _: None) as runner:
            ended = {task.name: outcome for task, outcome in runner.run_tasks(tasks)}
        assert {outcome.status for outcome in ended.values()} == {Status.DONE}, ended
        return {name: repr(outcome.row) for name, outcome in sorted(ended.items())}  # repr tells every bit

    here, there = drive(1), drive(2)
    assert here == there and len(set(here.values())) == COUNT
