"""`hdagen diagnose` for those who run it unattended: conditions with an exit code of their own, and its progress."""

from __future__ import annotations

import io
import json
import logging
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import arms
import catalogue
import numpy as np
import pytest
from test_json_of_commands import FOUND

from hdagen.__main__ import UNFORESEEN_ERROR, main
from hdagen.arm import compiled_arm
from hdagen.campaign.task import Outcome, Status
from hdagen.cli.failure_conditions import CONDITION_MET
from hdagen.diagnosis import pipeline
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.report import report_page, sentences
from hdagen.diagnosis.search import hypothesis_search
from hdagen.diagnosis.stages.stage import Stage
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.fleet import fleet_diagnosis, fleet_page, machine_task

Run = Callable[..., int]
EFFECTS = [{"name": "payload", "joints": [1]}, {"name": "gravity", "joints": [0]}]


def describe(verdict: list[str], gap: float | None) -> dict[str, Any]:
    """The content of a diagnosis with this verdict, for a robot file with this gap."""
    return {**FOUND, "verdict": verdict, "gap": {**FOUND["gap"], "before": gap}}  # type: ignore[dict-item]


@pytest.fixture
def diagnose(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """diagnose(*options, content=…) -> exit code of `hdagen diagnose`, whose diagnosis finds this content at once."""
    (tmp_path / "robot.toml").write_text(arms.SMALL)
    time = np.arange(50) * 1e-3
    rows = [f"{t:.4f},{np.sin(9 * t):.6f},{np.sin(t):.6f}" for t in time]
    (tmp_path / "log.csv").write_text("\n".join(["time,motor_torque_1,joint_position_1", *rows]) + "\n")
    (tmp_path / "fleet.toml").write_text('[[machine]]\nname = "left"\nrobot = "robot.toml"\nlog = "log.csv"\n')
    monkeypatch.chdir(tmp_path)
    arm = SimpleNamespace(n=1, manifest={"effects": EFFECTS}, effects=catalogue.EFFECTS, robot={"joints": [{}]})
    monkeypatch.setattr(compiled_arm, "load", lambda *_: arm)
    monkeypatch.setattr(report_page, "write_report", lambda *_: None)
    monkeypatch.setattr(sentences, "write_verdict", lambda _: "a verdict")
    monkeypatch.setattr(fleet_page, "write_fleet_page", lambda *_: None)

    def run(*options: str, content: Mapping[str, Any] = FOUND) -> int:
        result: Any = SimpleNamespace(content=content, failures=())

        def find(*_: Any, on_stage: Callable[[Stage], None], budget: TimeBudget) -> Diagnosis:
            assert not budget.is_up
            on_stage(Stage.MODELS)
            hypothesis_search.LOGGER.info("fitting payload@1, round 1 of 3")
            on_stage(Stage.SCREENING)
            return Diagnosis(result, "robot.toml", ("log.csv",), ())

        def diagnose_all(machines: Any, *_: Any) -> Any:
            outcome = Outcome(Status.DONE, machine_task.summarize_diagnosis(content))
            return [fleet_diagnosis.MachineResult(one, outcome) for one in machines], False

        monkeypatch.setattr(pipeline, "diagnose", find)
        monkeypatch.setattr(fleet_diagnosis, "diagnose_fleet", diagnose_all)
        return main(["diagnose", *options])

    return run


ONE = ("robot.toml", "log.csv")
FLEET = ("--fleet", "fleet.toml")


# -- conditions -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("given", [ONE, FLEET], ids=["one machine", "a fleet"])
@pytest.mark.parametrize(
    ("options", "verdict", "gap", "words"),
    [
        (("--fail-above", "2"), [], 2.0, ""),
        (("--fail-above", "2"), [], 2.5, "--fail-above 2: the gap of the robot file on held-out motion is 2.5 times"),
        (("--fail-above", "2"), [], None, "--fail-above 2: the gap of the robot file could not be measured"),
        (("--fail-on", "payload"), [], 9.0, ""),
        (("--fail-on", "gravity"), ["payload@1"], 9.0, ""),
        (("--fail-on", "payload"), ["payload@1"], 1.0, "--fail-on payload: the verdict names payload@1."),
        (("--fail-on", "unknown@1"), ["unknown@1"], 1.0, "--fail-on unknown@1: the verdict names unknown@1."),
        (("--fail-on", "gravity", "--fail-on", "payload@1"), ["payload@1"], 1.0, "--fail-on payload@1: the verdict"),
    ],
)
def test_a_condition_that_is_met_has_an_exit_code_of_its_own(
    given: tuple[str, ...],
    options: tuple[str, ...],
    verdict: list[str],
    gap: float | None,
    words: str,
    diagnose: Run,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code = diagnose(*given, "--json", *options, content=describe(verdict, gap))
    printed = capsys.readouterr()
    assert code == (CONDITION_MET if words else 0)
    last = printed.err.splitlines()[-1:] or [""]
    prefix = "left: " if given == FLEET else ""
    assert last[0].startswith(prefix + words) if words else "--fail" not in printed.err
    assert json.loads(printed.out)  # what is printed stays as it is
    assert CONDITION_MET not in {0, 1, 2, 3, UNFORESEEN_ERROR}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--fail-above", "-1"), "--fail-above -1: possible is a positive number, in multiples of noise; give one."),
        (("--fail-above", "nan"), "--fail-above nan: possible is a positive number"),
        (("--fail-on", "paylod"), "--fail-on paylod: no effect has this name (did you mean payload?); possible are "),
        (("--fail-on", "payload@2"), "--fail-on payload@2: payload does not act there; possible is payload at 1;"),
        (("--fail-on", "payload@"), "--fail-on payload@: payload does not act there; possible is payload at 1;"),
    ],
)
def test_a_condition_that_can_never_be_met_is_refused_before_the_work(
    options: tuple[str, ...], words: str, diagnose: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for given in (ONE, FLEET):
        assert diagnose(*given, *options) == 2
        assert capsys.readouterr().err.startswith(words)
    assert not list(tmp_path.glob("diagnosis-*"))


# -- progress ---------------------------------------------------------------------------------------------------------


class Terminal(io.StringIO):
    """A standard error that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_elsewhere_a_stage_has_one_line(diagnose: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert diagnose(*ONE) == 0
    lines = [line.partition(" s  ")[2] for line in capsys.readouterr().err.splitlines()]
    assert [line.partition(",")[0] for line in lines] == [
        stage.value for stage in (Stage.MODELS, Stage.SCREENING, Stage.REPORT)
    ]


@pytest.mark.parametrize("is_terminal", [False, True])
def test_verbose_prints_every_step_between_the_stages(
    is_terminal: bool, diagnose: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = Terminal() if is_terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)
    assert diagnose(*ONE, "-v") == 0
    lines = said.getvalue().splitlines()
    assert [line[9:] for line in lines[1:2]] == ["fitting payload@1, round 1 of 3"] and len(lines) == 4
    logger = logging.getLogger("hdagen")
    assert [type(handler) for handler in logger.handlers] == [logging.NullHandler] and not logger.level


def test_a_terminal_has_one_live_line(diagnose: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    said = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", said)
    assert diagnose(*ONE) == 0
    text = said.getvalue()
    assert Stage.REPORT.value in text and "fitting" not in text
    assert text.count("\n") <= 1 and "\x1b[2K" in text  # the line changes in its place, and is gone in the end


def test_the_library_logs_in_silence(diagnose: Run, capsys: pytest.CaptureFixture[str]) -> None:
    hypothesis_search.LOGGER.warning("something that a user may want to hear")
    assert capsys.readouterr().err == ""
