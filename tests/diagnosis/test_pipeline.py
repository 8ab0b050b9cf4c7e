"""The stages of the pipeline: each hands on a frozen result whose attributes are explained."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hdagen.diagnosis.checked_verdict import CheckedVerdict
from hdagen.diagnosis.data.models import Models
from hdagen.diagnosis.data.prepared_data import PreparedData
from hdagen.diagnosis.decision.verdict_content import StatedEffects
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.explanation import Alternatives, Explanation
from hdagen.diagnosis.holdout.holdout_check import HoldoutJudge, SettledStatement, Statement
from hdagen.diagnosis.holdout.long_window_prediction import LongWindowPrediction
from hdagen.diagnosis.holdout.verdict_withdrawal import ConfirmedVerdict
from hdagen.diagnosis.pipeline import diagnose
from hdagen.diagnosis.report import report_page
from hdagen.diagnosis.report.diagnosis_result import DiagnosisResult
from hdagen.diagnosis.report.repeat_commands import DiagnosedFiles, format_commands
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.search.null_model import NullModel

RESULTS = (
    Alternatives,
    CheckedVerdict,
    ConfirmedVerdict,
    Diagnosis,
    DiagnosisResult,
    Explanation,
    HoldoutJudge,
    LongWindowPrediction,
    Models,
    NullModel,
    PreparedData,
    SearchResult,
    SettledStatement,
    StatedEffects,
    Statement,
)


@pytest.mark.parametrize("result", RESULTS, ids=lambda one: one.__name__)
def test_a_result_is_frozen_and_explains_its_attributes(result: Any) -> None:
    assert result.__dataclass_params__.frozen
    explained = re.findall(r"^    (\w+): ", (inspect.getdoc(result) or "").partition("Attributes:")[2], re.MULTILINE)
    assert explained == [field.name for field in dataclasses.fields(result)]


def test_a_hold_out_and_a_listener_are_optional() -> None:
    parameters = inspect.signature(diagnose).parameters
    assert list(parameters) == ["robot", "logs", "holdout", "on_stage", "budget"]
    assert parameters["holdout"].default == ()
    for name in ("on_stage", "budget"):
        assert parameters[name].default is None and parameters[name].kind is inspect.Parameter.KEYWORD_ONLY


def test_a_diagnosis_tells_its_verdict_and_saves_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = {"verdict": ["payload@2"], "sure": False, "gap": {"before": 9.0}, "robot": {"identity": "0" * 64}}
    result: Any = SimpleNamespace(content=content, failures=("a stage failed.",))
    found = Diagnosis(result, "robot.toml", ("a log.csv",), ("other.csv",))
    assert (found.verdict, found.sure, found.gap) == (("payload@2",), False, {"before": 9.0})
    assert found.failures == ("a stage failed.",)
    pages: list[Any] = []
    monkeypatch.setattr(report_page, "write_report", lambda *given: pages.append(given))
    found.save(tmp_path / "new" / "folder")
    assert json.loads((tmp_path / "new" / "folder" / "diagnosis.json").read_text()) == content
    ((drawn, page, files),) = pages
    assert drawn is result and page == tmp_path / "new" / "folder" / "report.html"
    assert "hdagen diagnose robot.toml 'a log.csv' --hold-out other.csv\n" in format_commands(files, "0" * 64)
    assert files.shell_diagnosis == str(tmp_path / "new" / "folder" / "diagnosis.json")


def test_the_commands_name_the_columns() -> None:
    said = format_commands(DiagnosedFiles("paper", ("log.csv",), (), "found", "my columns.toml"), "0" * 64)
    assert "hdagen diagnose paper log.csv --columns 'my columns.toml'\n" in said
    assert "hdagen replay paper log.csv --columns 'my columns.toml' --with found/diagnosis.json" in said
