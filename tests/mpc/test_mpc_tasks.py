"""Random runs of the table as tasks: the same bits in this process and on workers, whichever runs share one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import trivial_tasks
from mpc_arms import built

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.task import Status, Task
from hdagen.cli import mpc as command
from hdagen.control.reference_motion import circle
from hdagen.mpc.benchmark import law_comparison, random_run_tasks

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


@pytest.fixture
def short_runs(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Runs on a short path; the list has the seeds that were driven."""
    driven: list[int] = []
    drive = law_comparison.drive_random_run

    def note_drive(bench: law_comparison.RandomRunBench, seed: int) -> law_comparison.RandomRun:
        driven.append(seed)
        return drive(bench, seed)

    def shorten(radius: float, center: tuple[float, float], turn: float, _: float, period: float) -> Any:
        return circle(radius, center, turn, 0.6, period)

    monkeypatch.setenv("HDAGEN_BUILD", str(built()[0].folder.parent))
    monkeypatch.setattr(law_comparison, "circle", shorten)
    monkeypatch.setattr(random_run_tasks, "drive_random_run", note_drive)
    random_run_tasks._find_bench.cache_clear()
    return driven


def test_a_second_call_drives_what_is_missing_and_the_table_has_a_row_a_run(
    short_runs: list[int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = argparse.Namespace(out=tmp_path / "runs", profile="portable")
    first = command._drive_random_runs(2, TUNED, options, ClusterRequest())
    again = command._drive_random_runs(COUNT, TUNED, options, ClusterRequest())
    assert short_runs == [0, 1, 2] and repr(again[:2]) == repr(first)  # to the bit, through their files
    assert "2 of 3 were finished before and are kept, 1 are left." in capsys.readouterr().err
    rows = pq.read_table(tmp_path / "runs" / "results.parquet").to_pylist()
    assert [(row["task"], row["status"], row["seed"]) for row in rows] == [
        (f"run {seed}", "done", seed) for seed in range(COUNT)
    ]
    command._drive_random_runs(1, {**TUNED, "bandwidth": 70.0}, options, ClusterRequest())
    assert short_runs == [0, 1, 2, 0]  # with other gains it is another run


def test_an_interrupt_leaves_the_finished_runs(
    short_runs: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = law_comparison.drive_random_run

    def interrupt(bench: law_comparison.RandomRunBench, seed: int) -> law_comparison.RandomRun:
        if seed == 1:
            raise KeyboardInterrupt
        return drive(bench, seed)

    monkeypatch.setattr(random_run_tasks, "drive_random_run", interrupt)
    options = argparse.Namespace(out=tmp_path / "runs", profile="portable")
    assert [one.seed for one in command._drive_random_runs(COUNT, TUNED, options, ClusterRequest())] == [0]
    assert f"1 of 3 random runs are kept in {tmp_path / 'runs'}; the same command" in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    with pytest.raises(PlantError, match="name another folder with --out"):
        command._drive_random_runs(1, TUNED, argparse.Namespace(**{**vars(options), "out": tmp_path / "file"}),
                                   ClusterRequest())  # fmt: skip


def test_a_row_that_is_not_whole_is_not_taken() -> None:
    outcome: dict[str, Any] = {**dict.fromkeys(random_run_tasks._OUTCOME_NUMBERS, 1.0), "violated": {}}
    row = {"seed": 1, "delay": 2, "legal": True, "kept": True, "predictive": outcome, "free": outcome}
    assert not random_run_tasks.is_run_row(row)
    assert random_run_tasks.is_run_row({**row, "admittance": outcome})
    for broken in ({"distance": float("nan")}, {"violated": None}, {"refused": "x"}, {"other": 1}):
        assert not random_run_tasks.is_run_row({**row, "admittance": {**outcome, **broken}})
