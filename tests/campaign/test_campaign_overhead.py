"""What measures the engine: the made fleet, and the figures of a run."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from hdagen.arm.build_loader import PlantError
from hdagen.bench.campaign_overhead import hash_results, measure_overhead, sleep_for_task
from hdagen.bench.campaign_overhead import main as measure_campaign
from hdagen.bench.made_fleet import draw_one_joint_cases, main
from hdagen.campaign.task import Outcome, Status, Task
from hdagen.fleet.fleet_file import read_fleet
from hdagen.log.measured_log import read


def test_a_made_fleet_is_a_fleet_whose_logs_differ(tmp_path: Path) -> None:
    assert main([str(tmp_path), "--robots", "2", "--logs", "2", "--seconds", "0.5"]) == 0
    machines = read_fleet(tmp_path / "fleet.toml")
    assert [Path(one.robot).name for one in machines] == ["robot_001.toml"] * 2 + ["robot_002.toml"] * 2
    assert [one.date for one in machines] == ["2026-01-05", "2026-02-04"] * 2
    logs = [read(one.log) for one in machines]
    assert all(log.n_joints == 1 and math.isclose(log.time[-1], 0.5, rel_tol=0.1) for log in logs)
    assert len({log.columns[min(log.columns)].tobytes() for log in logs}) == 4
    assert draw_one_joint_cases("a", 2) == draw_one_joint_cases("a", 3)[:2]


def sleepers(count: int) -> list[Task]:
    return [Task(f"sleep {k}", sleep_for_task, {"seconds": 0.0, "number": k}) for k in range(count)]


def test_figures_of_a_run_add_up_and_results_are_told_apart(tmp_path: Path) -> None:
    found, _ = measure_overhead(sleepers(3), 0, tmp_path)
    assert found["ended"] == {"done": 3} and found["messages_per_task"] == 0
    assert found["memory"][0]["last"] > 0 and found["processor_seconds_outside"] > 0
    one = Outcome(Status.DONE, {"value": 0.1 + 0.2}, seconds=1.0)
    same = hash_results({"a": one})
    assert hash_results({"a": replace(one, seconds=2.0)}) == same
    assert hash_results({"a": replace(one, row={"value": 0.3})}) != same


def test_a_measurement_goes_on_in_its_folder_and_counts_each_task_once(tmp_path: Path) -> None:
    first, _ = measure_overhead(sleepers(2), 0, tmp_path)
    both, _ = measure_overhead(sleepers(5), 0, tmp_path)
    assert (first["tasks"], both["tasks"], both["calls"]) == (2, 5, 2)
    assert both["processor_seconds_outside"] > first["processor_seconds_outside"]
    again, _ = measure_overhead(sleepers(5), 0, tmp_path)
    assert again == both  # nothing was left to do, and nothing is added
    with pytest.raises(PlantError, match="begun with --jobs 0"):
        measure_overhead(sleepers(5), 1, tmp_path)


def test_a_result_that_differs_in_one_process_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["--tasks", "4", "--seconds", "0", "--jobs", "0", "--out", str(tmp_path), "--compare-every", "2"]
    assert measure_campaign(command) == 0
    assert '"compared": 2' in capsys.readouterr().out
    row = tmp_path / "one_process" / "sleep-2" / "task.json"
    row.write_text(row.read_text().replace('"number": 2', '"number": 3'))
    assert measure_campaign(command) == 1
    assert json.loads(capsys.readouterr().out)["differ"] == ["sleep-2"]
    (tmp_path / "campaign" / "calls.json").write_text("half")
    assert measure_campaign(command) == 2
    assert "calls.json" in capsys.readouterr().err
