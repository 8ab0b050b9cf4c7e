"""A rule of the decision is switched off and on again, cases are decided before they are scored, and counts add up."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from hdagen.blind import ablation, ablation_task
from hdagen.blind.ablation_table import AS_IT_IS, render_ablation
from hdagen.blind.confidence_intervals import estimate_paired_difference
from hdagen.blind.decision_rules import RULES, Rule
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.log.data_table import LogError
from hdagen.support.setting_declaration import list_settings

ALARM_RULE = next(rule for rule in RULES if rule.name == "no_effect_threshold")
REFUSAL_RULE = next(rule for rule in RULES if rule.name == "least_file_probability")


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_a_rule_is_off_within_its_block_alone(rule: Rule) -> None:
    usual = {one.name: one.value for one in list_settings(rule.settings)}
    assert rule.neutral.items() - usual.items() == rule.neutral.items()
    off: dict[str, Any] = {}

    def fail_without_rule() -> None:
        with rule.switch_off():
            off.update({one.name: one.value for one in list_settings(rule.settings)})
            raise LogError(["another robot."])

    with pytest.raises(LogError):
        fail_without_rule()
    assert off == {**usual, **rule.neutral}
    assert {one.name: one.value for one in list_settings(rule.settings)} == usual


def test_every_rule_has_a_name_of_its_own() -> None:
    assert len({rule.name for rule in RULES}) == len({rule.words for rule in RULES}) == len(RULES)


class StubDiagnosis:
    """A diagnosis that names an effect where the threshold of alarms lets it, and refuses where it is told to."""

    def decide_again(self) -> dict[str, Any]:
        if DECISION.least_file_probability == 0.0:
            raise LogError(["another robot."])
        verdict = ["backlash@1"] if DECISION.no_effect_threshold == 1.0 else []
        return {
            "verdict": verdict,
            "sure": True,
            "hypotheses": [{"effects": verdict, "probability": 1.0}],
            "causes": [{"effect": "backlash", "joint": 1, "probability": 1.0}],
            "gap": {"before": 2.0, "after": 1.0, "flexible": None},
            "lacks_search": False,
        }


def make_check(folder: Path, truth: list[str], said: dict[str, Any]) -> Path:
    """A finished check of one case, with ``said`` as its diagnosis."""
    out = folder / "cases" / "case-000" / "out"
    out.mkdir(parents=True)
    for path in (out / "searches.npz", out.parent / "robot.toml", out.parent / "log.parquet"):
        path.touch()
    (out / "diagnosis.json").write_text(json.dumps(said))
    row: dict[str, Any] = {
        "name": "case-000",
        "kind": "single" if truth else "none",
        "truth": truth,
        "sizes": [1.0] * len(truth),
    }
    row |= {"optional": [], "numbers": [], "background": 0.0, "snr": 9.0, "parameters": {one: {} for one in truth}}
    report = {"kind": row["kind"], "family": "maxwell", "background": None, "model": "", "seed": "s", "rows": [row]}
    (folder / "blind.json").write_text(json.dumps(report))
    return folder


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> StubDiagnosis:
    made = StubDiagnosis()
    monkeypatch.setattr(ablation_task, "read_diagnosis", lambda *_: made)
    monkeypatch.setattr(ablation_task, "read", lambda *_, **__: None)
    monkeypatch.setattr(ablation_task, "read_joint_names", lambda _: None)
    return made


def ablate_here(folder: Path, *known: str) -> ablation.AblatedCheck:
    """The cases of a check that are not known, decided in this process."""
    return ablation.ablate_check(folder, known, ClusterRequest(), lambda _: None)


@pytest.mark.parametrize("truth", [["backlash@1"], []])
def test_a_case_is_scored_with_each_rule_off(stub: StubDiagnosis, tmp_path: Path, truth: list[str]) -> None:
    folder = make_check(tmp_path, truth, stub.decide_again())
    (case,) = ablate_here(folder).cases
    outcomes = case["outcomes"]
    assert outcomes.keys() == {AS_IT_IS, *(rule.name for rule in RULES)}
    assert [outcomes[AS_IT_IS][key] for key in ("right", "named", "differs")] == [not truth, False, False]
    off = outcomes[ALARM_RULE.name]
    assert [off[key] for key in ("right", "named", "joint", "differs")] == [bool(truth), True, bool(truth), True]
    refused = outcomes[REFUSAL_RULE.name]
    assert [refused[key] for key in ("right", "named", "sure", "differs")] == [False, False, False, True]
    again = ablate_here(folder, case["name"])
    assert (again.cases, again.problems, again.was_interrupted) == ([], [], False)
    (row,) = pq.read_table(folder / "ablation" / "results.parquet").to_pylist()  # what is known keeps its row
    assert (row["task"], row["status"], row["decisions"], row["differ"]) == ("case-000", "done", len(RULES) + 1, 2)
    table = render_ablation({"cases": [case]})
    assert "Cases: 1 (arms of another simulator, " in table and table.count("\n| ") == len(RULES) + 2
    (line,) = (line for line in table.splitlines() if f"`{ALARM_RULE.name}`" in line)
    assert "| 1 of 1, 1 in probabilities |" in line and "+100 %" in line


def test_a_case_that_is_not_decided_as_it_was_is_refused(
    stub: StubDiagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_check(tmp_path / "check", [], {**stub.decide_again(), "sure": False})
    monkeypatch.setattr("sys.argv", ["ablation", str(folder), "--out", str(tmp_path / "cases.json")])
    assert ablation.main() == 2
    assert "diagnosis.json: the case is not decided as it says" in capsys.readouterr().err
    assert not (tmp_path / "cases.json").exists()
    monkeypatch.setattr("sys.argv", ["ablation", str(tmp_path), "--out", str(tmp_path / "cases.json")])
    assert ablation.main() == 2
    assert "keeps no searches" in capsys.readouterr().err


def test_an_interrupted_ablation_goes_on_and_no_label_is_among_the_inputs(
    stub: StubDiagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second of two cases is interrupted; the same command decides that one alone."""
    folder, file, decided = make_check(tmp_path / "check", ["backlash@1"], stub.decide_again()), tmp_path / "x.json", []
    report = json.loads((folder / "blind.json").read_text())
    report["rows"].append({**report["rows"][0], "name": "case-001"})
    (folder / "blind.json").write_text(json.dumps(report))
    shutil.copytree(folder / "cases" / "case-000", folder / "cases" / "case-001")
    task = ablation_task.make_ablation_task(folder / "cases" / "case-001")
    assert set(task.files) == {"robot.toml", "log.parquet", "searches.npz", "diagnosis.json"}
    (folder / "cases" / "case-001" / "log.parquet").write_text("another log")

    def read_once(robot: Path, *_: object) -> StubDiagnosis:
        decided.append(robot)
        if len(decided) == 2:
            raise KeyboardInterrupt
        return stub

    monkeypatch.setattr(ablation_task, "read_diagnosis", read_once)
    monkeypatch.setattr("sys.argv", ["ablation", str(folder), "--out", str(file)])
    assert ablation.main() == 130
    assert [case["name"] for case in json.loads(file.read_text())["cases"]] == ["s/case-000"]
    assert ablation.main() == 0
    assert "1 of 2 were finished before and are kept, 1 are left." in capsys.readouterr().err and len(decided) == 3
    assert [case["name"] for case in json.loads(file.read_text())["cases"]] == ["s/case-000", "s/case-001"]


def test_the_file_of_cases_grows(
    stub: StubDiagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, file = make_check(tmp_path / "check", [], stub.decide_again()), tmp_path / "cases.json"
    for _ in range(2):  # the second time there is nothing new
        monkeypatch.setattr("sys.argv", ["ablation", str(folder), "--out", str(file)])
        assert ablation.main() == 0
        assert [case["name"] for case in json.loads(file.read_text())["cases"]] == ["s/case-000"]
    table = capsys.readouterr().out
    monkeypatch.setattr("sys.argv", ["ablation", str(file)])
    assert ablation.main() == 0
    assert table.endswith(capsys.readouterr().out)


def test_the_interval_of_a_paired_difference() -> None:
    """A change on 5 of 20 cases, all of them lost, by hand: -5/22 ± 1.96 sqrt(6 - 25/22)/22."""
    found = estimate_paired_difference([True] * 10 + [False] * 10, [True] * 5 + [False] * 15)
    half = 1.959964 * math.sqrt(6 - 25 / 22) / 22
    assert (found.value, found.count) == (-0.25, 20)
    assert found.low == pytest.approx(-5 / 22 - half, abs=1e-6) and found.high == pytest.approx(
        -5 / 22 + half, abs=1e-6
    )
    same = estimate_paired_difference([True] * 4, [True] * 4)
    assert same.value == 0.0 and same.low == -same.high < -0.3
    assert estimate_paired_difference([], []).count == 0
