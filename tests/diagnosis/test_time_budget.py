"""A diagnosis whose time is up: the best so far, never sure, with what was not tried. No test asks a real clock."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import wrist
from json_schemas import violations

from hdagen.adoption.diagnosis_json_schema import build_json_schema
from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis import checked_verdict, pipeline
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.report.repeat_commands import DiagnosedFiles, format_commands
from hdagen.diagnosis.report.sentences import say_untried, write_verdict
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.diagnosis.stages.stage import Stage
from hdagen.diagnosis.stages.time_budget import TimeBudget, TimeUpError
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log

SECONDS = 100.0


class StageClock:
    """A clock that stands still, and leaps when a stage begins."""

    def __init__(self, stage: Stage, leap: float = SECONDS) -> None:
        self.now, self.stage, self.leap = 0.0, stage, leap

    def __call__(self) -> float:
        return self.now

    def hear_stage(self, stage: Stage) -> None:
        if stage is self.stage:
            self.now = self.leap


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("wrist") / "robot.toml"
    file.write_text(wrist.ROBOT)
    return file


@pytest.fixture(scope="module")
def machine_log(robot: Path) -> Log:
    """A log of a machine with three times the file's Coulomb friction."""
    return wrist.move_wrist(robot, {"coulomb_friction_1": 3.0}, 5.0)


def diagnose(robot: Path, log: Log, stage: Stage) -> Diagnosis:
    clock = StageClock(stage)
    return pipeline.diagnose(robot, [log], on_stage=clock.hear_stage, budget=TimeBudget(SECONDS, clock))


def list_parts(content: dict[str, Any]) -> dict[str, list[str]]:
    return {one["part"]: one["effects"] for one in content["not_tried"]}


@pytest.mark.parametrize("stage", [Stage.SCREENING, Stage.RACE_ROUND_1, Stage.RIVALS])
def test_the_best_so_far_is_stated_whenever_the_time_is_up(
    robot: Path, machine_log: Log, stage: Stage, tmp_path: Path
) -> None:
    found = diagnose(robot, machine_log, stage)
    content, parts = found.content, list_parts(found.content)
    assert not found.sure and parts
    assert violations(content, build_json_schema()) == []
    assert math.isfinite(found.gap["after"]) and found.gap["after"] <= 1.02 * found.gap["before"]
    assert sum(one["probability"] for one in content["hypotheses"]) == pytest.approx(1.0)
    assert "was not tried" in write_verdict(content) and "not sure" in write_verdict(content)
    found.save(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "Give it more time" in page and "no limit of time" in page
    begun_early = {Stage.SCREENING, Stage.RACE_ROUND_1}
    assert ("fits of single effects" in parts) == (stage in begun_early)
    assert ("one more effect beside the leading set" in parts) == (stage is Stage.RACE_ROUND_1)
    if stage is Stage.SCREENING:
        assert set(parts["fits of single effects"]) == set(content["tried"]) > {"coulomb_friction@1"}
    if stage not in begun_early:
        assert found.verdict == ("coulomb_friction@1",)


def test_a_set_that_outdoes_the_null_model_before_the_race_stands_where_the_time_is_up_then(robot: Path) -> None:
    """The regression of the torque finds it, so the null model is out of the race that has no time for a step."""
    log = wrist.move_wrist(robot, {"coulomb_friction_1": 5.0, "viscous_friction_1": 20.0}, 5.0)
    found = diagnose(robot, log, Stage.RACE_ROUND_1)
    assert not found.sure and list_parts(found.content)
    assert found.verdict == ("coulomb_friction@1", "viscous_friction@1")


def test_a_file_is_not_called_another_machines_where_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was not tried may explain the log."""
    monkeypatch.setattr(checked_verdict, "refuse_wrong_robot", lambda _: "it is another machine's.")
    decision: Any = SimpleNamespace(is_unknown=False, best=None, hypotheses=())
    data: Any = SimpleNamespace(logs=[SimpleNamespace(source="a.parquet")])
    now = iter([0.0, 50.0, 150.0])
    budget = TimeBudget(SECONDS, lambda: next(now))
    with pytest.raises(LogError, match=r"a\.parquet: it is another machine's"):
        checked_verdict._check_robot(decision, data, budget)
    assert checked_verdict._check_robot(decision, data, budget) is decision


@pytest.mark.parametrize(
    ("shares", "is_refused"),
    [
        ({"strained": 0.95, "right": 0.05}, True),
        ({"strained": 0.85, "right": 0.15}, False),
        ({"strained": 0.85, "right": 0.04, "unknown@1": 0.11}, False),
        ({"strained": 0.6, "unfitted": 0.4}, True),
    ],
)
def test_a_file_is_refused_where_hypotheses_with_which_it_is_right_hold_little(
    shares: dict[str, float], is_refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checked_verdict, "refuse_wrong_robot", lambda fit: "wrong" if fit == "strained" else None)
    hypotheses = [
        SimpleNamespace(probability=share, is_unknown=name == "unknown@1", fit=name if name[0] in "sr" else None)
        for name, share in shares.items()
    ]
    decision: Any = SimpleNamespace(is_unknown=False, best="strained", hypotheses=hypotheses)
    data: Any = SimpleNamespace(logs=[SimpleNamespace(source="a.parquet")])
    if is_refused:
        with pytest.raises(LogError, match="wrong"):
            checked_verdict._check_robot(decision, data, TimeBudget())
    else:
        assert checked_verdict._check_robot(decision, data, TimeBudget()) is decision


def test_enough_time_is_as_good_as_no_limit(robot: Path, machine_log: Log) -> None:
    found = diagnose(robot, machine_log, Stage.REPORT)
    assert found.content["not_tried"] == [] and say_untried(found.content) == ""
    assert found.verdict == ("coulomb_friction@1",) and found.sure


def test_where_not_even_the_null_model_is_done_a_sentence_says_so(robot: Path, machine_log: Log) -> None:
    with pytest.raises(TimeUpError, match=r"within 100 s not even the fit without effects .* 100\.0 s; give more time"):
        diagnose(robot, machine_log, Stage.NULL_MODEL)


def test_a_part_of_the_time_is_kept_for_the_statement() -> None:
    now = [10.0]
    budget = TimeBudget(20.0, lambda: now[0])
    now[0] = 24.0
    assert budget.passed == 14.0 and not budget.is_left_out("a search", ["backlash@1"])
    budget.keep_for_statement(6.0)
    assert budget.is_up and budget.is_left_out("a search", ["backlash@1"]) and budget.is_left_out("a search", ["x@2"])
    budget.require_time("anything")  # the time of the statement is not up
    assert budget.describe_untried() == [{"part": "a search", "effects": ["backlash@1", "x@2"]}]
    assert Attempts(budget).attempt_in_time("the ranking", lambda: pytest.fail("it ran"), "nothing") == "nothing"
    assert Attempts(budget).attempt("what must be", lambda: "made", "nothing") == "made"
    assert [one["part"] for one in budget.describe_untried()] == ["a search", "the ranking"]


@pytest.mark.parametrize("seconds", [0.0, -3.0, math.inf, math.nan])
def test_a_time_that_is_none_is_refused(seconds: float) -> None:
    with pytest.raises(PlantError, match="possible is a positive number of seconds"):
        TimeBudget(seconds)


def test_no_limit_is_never_up() -> None:
    now = [0.0]
    budget = TimeBudget(clock=lambda: now[0])
    now[0] = 1e12
    assert not budget.is_up and not budget.is_left_out("anything") and budget.describe_untried() == []


def test_many_untried_effects_are_counted() -> None:
    effects = [f"payload@{j}" for j in range(1, 8)]
    said = say_untried({"not_tried": [{"part": "fits", "effects": effects}, {"part": "rivals", "effects": []}]})
    assert "fits (payload@1, payload@2, payload@3, payload@4 and 3 more); rivals. Give more time" in said
    text = format_commands(DiagnosedFiles("paper", ("log.csv",), (), "found"), "0" * 64, is_complete=False)
    assert "The same input gives the same diagnosis" not in text
