"""The claims of docs/reference/commands.md: each command takes --json, and prints JSON with it; --version; ROBOT."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import arms
import numpy as np
import pytest

from hdagen.__main__ import COMMANDS, build_parser, main
from hdagen.blind import blind_page, blind_report
from hdagen.blind import sealed_check as blind_run
from hdagen.campaign.task import Outcome, Status
from hdagen.diagnosis import pipeline
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.report import report_page
from hdagen.fleet import fleet_diagnosis, fleet_page, machine_task
from hdagen.support.version import __version__

ROOT = Path(__file__).parents[2]


def commands() -> dict[str, argparse.ArgumentParser]:
    (choices,) = (
        action.choices for action in build_parser()._actions if isinstance(action, argparse._SubParsersAction)
    )
    return dict(choices)


def list_actions(command: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """The parsers of a command's actions, or its own where it has none."""
    groups = [action for action in command._actions if isinstance(action, argparse._SubParsersAction)]
    return [one for group in groups for one in group.choices.values()] or [command]


def test_every_command_takes_json_and_shows_an_example() -> None:
    assert "those\nof `hdagen` take `--json`" in (ROOT / "docs/reference/commands.md").read_text(encoding="utf-8")
    assert tuple(commands()) == COMMANDS
    for name, command in commands().items():
        for one in list_actions(command):
            assert "--json" in one._option_string_actions, name
        assert "example" in (command.epilog or ""), name


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0 and capsys.readouterr().out == f"hdagen {__version__}\n"


@pytest.mark.parametrize("arguments", [["paper", "list"], ["mpc", "keys"]])
def test_lists_are_json_too(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)


FOUND = {
    "robot": {"name": "arm", "identity": "0" * 64, "sha256": None},
    "verdict": [],
    "sure": True,
    "hypotheses": [{"effects": [], "probability": 1.0}],
    "causes": [],
    "parameters": {},
    "nuisance_effects": [],
    "small": [],
    "remains": [],
    "moments": [],
    "contradicted": None,
    "doubts": None,
    "method": {"calibrated": True},
    "where": [],
    "data": {},
    "as_good_as_it_gets": False,
    "gap": {
        "before": 1.0,
        "after": 1.0,
        "floor": 1.0,
        "achievable": 1.0,
        "shrink": None,
        "interval": None,
        "by_channel": {},
    },
}


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a robot file, a log and a fleet.toml, and a diagnosis that finds nothing at once."""
    (tmp_path / "robot.toml").write_text(arms.SMALL)
    time = np.arange(50) * 1e-3
    rows = [f"{t:.4f},{np.sin(9 * t):.6f},{np.sin(t):.6f}" for t in time]
    (tmp_path / "log.csv").write_text("\n".join(["time,motor_torque_1,joint_position_1", *rows]) + "\n")
    (tmp_path / "fleet.toml").write_text('[[machine]]\nrobot = "robot.toml"\nlog = "log.csv"\n')
    monkeypatch.chdir(tmp_path)
    result: Any = SimpleNamespace(content=FOUND, failures=("a stage failed.",))
    found = Diagnosis(result, "robot.toml", ("log.csv",), ())
    monkeypatch.setattr(pipeline, "diagnose", lambda *_, on_stage, budget: found)
    monkeypatch.setattr(report_page, "write_report", lambda *_: None)
    return tmp_path


def test_a_diagnosis_is_printed_as_json(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", "robot.toml", "log.csv", "--out", "found", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert json.loads((files / "found" / "diagnosis.json").read_text()).items() <= said.items()
    assert said["sentence"].startswith("No effect above the size that counts")
    assert said["page"] == "found/report.html" and said["left_out"] == ["a stage failed."]


def test_a_fleet_is_printed_as_json(
    files: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def diagnosed(machines: Any, *_: Any) -> Any:
        return [
            fleet_diagnosis.MachineResult(machine, Outcome(Status.DONE, machine_task.summarize_diagnosis(FOUND)))
            for machine in machines
        ], False

    monkeypatch.setattr(fleet_diagnosis, "diagnose_fleet", diagnosed)
    monkeypatch.setattr(fleet_page, "write_fleet_page", lambda *_: None)
    assert main(["diagnose", "--fleet", "fleet.toml", "--out", "found", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["counts"]["diagnosed"] == 1 and said["page"] == "found/fleet.html"


def test_a_blind_check_is_printed_as_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    found = SimpleNamespace(bars=[])
    monkeypatch.setattr(blind_run, "run_check", lambda *_: ([], None))
    monkeypatch.setattr(blind_report, "make_report", lambda *_: found)
    monkeypatch.setattr(blind_report, "render_report", lambda _: '{"cases": 0}\n')
    monkeypatch.setattr(blind_page, "write_page", lambda *_: None)
    (tmp_path / "out").mkdir()
    given = ["blind", "--kind", "single", "--cases", "1", "--seed", "any", "--out", str(tmp_path / "out")]
    assert main([*given, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"cases": 0}
