"""The two tables of a diagnosis and its summary, from a stored diagnosis of a real machine."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from hostile_names import NAME

import hdagen
from hdagen.diagnosis.report.diagnosis_summary import SavedDiagnosis
from hdagen.pages.result_table import MOST_PRINTED_ROWS, ResultTable

STORED: dict[str, Any] = json.loads((files("hdagen.data") / "pendulum_diagnosis.json").read_text(encoding="utf-8"))
FRICTION, OTHER = "coulomb_friction@1", "position_dependent_friction@1"


def changed(**changes: Any) -> SavedDiagnosis:
    return SavedDiagnosis(Path("diagnosis.json"), json.loads(json.dumps(STORED)) | changes)


def row(diagnosis: SavedDiagnosis, hypothesis: str) -> dict[str, Any]:
    return next(one for one in diagnosis.table() if one["hypothesis"] == hypothesis)


def test_the_hypotheses_are_ranked_with_their_gaps() -> None:
    table = changed().table()
    assert list(table["rank"]) == list(range(1, len(STORED["hypotheses"]) + 1))
    assert list(table["probability"]) == sorted((h["probability"] for h in STORED["hypotheses"]), reverse=True)
    assert row(changed(), FRICTION)["gap"] == STORED["gap"]["after"]
    assert row(changed(), OTHER)["gap"] is None
    assert [one["hypothesis"] for one in table if one["verdict"]] == STORED["verdict"]
    assert "not calibrated" in table.title and "no effect" in table["hypothesis"]


def test_each_doubt_has_its_column() -> None:
    assert row(changed(), "unknown@1")["unknown"] and not row(changed(), FRICTION)["unknown"]
    assert row(changed(), FRICTION)["confounded_with"] == OTHER
    assert row(changed(), OTHER)["not_shown"] == OTHER
    withdrawn = changed(doubts={"verdict": [FRICTION], "joint": 1, "left": 0.9})
    assert row(withdrawn, FRICTION)["unconfirmed"] and not row(withdrawn, OTHER)["unconfirmed"]
    contradicted = changed(contradicted={"verdict": [OTHER], "closed": 0.9, "left": 1.0})
    assert row(contradicted, OTHER)["unconfirmed"]
    small = changed(small=[{"effect": "coulomb_friction", "joint": 1, "with": 2.0, "without": 2.1}])
    assert row(small, FRICTION)["not_needed"] == FRICTION
    bound = changed()
    cause = next(one for one in bound.stored["causes"] if one["effect"] == "coulomb_friction")
    cause["parameters"]["coulomb_friction"]["end"] = "high"
    assert row(bound, FRICTION)["at_end"] == "coulomb_friction"
    assert bound.parameters()["at_end"][0] == "high"


def test_parameters_of_named_effects_come_first() -> None:
    table = changed().parameters()
    assert table["parameter"][0] == "coulomb_friction_1" and table["effect"][0] == FRICTION
    assert list(table["parameter"])[1:] == list(STORED["parameters"])
    assert table["unit"][0] == "N m" and float(str(table["std"][0])) > 0


def test_a_stored_diagnosis_is_read_from_its_file_or_folder(tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text(json.dumps(STORED), encoding="utf-8")
    for place in (tmp_path, tmp_path / "diagnosis.json"):
        found = hdagen.read_diagnosis(place)
        assert found.content == STORED and found.verdict == (FRICTION,) and not found.sure
        assert found.gap["before"] == STORED["gap"]["before"]
        assert found.sentence.startswith("Coulomb friction on joint 1 is missing in the model")
        assert repr(found) == "<diagnosis: coulomb_friction@1, not sure; gap 24.4 → 8.37 times the noise>"
    (tmp_path / "diagnosis.json").write_text(json.dumps(STORED | {"schema": 3}), encoding="utf-8")
    with pytest.raises(hdagen.PlantError, match="schema is 3"):
        hdagen.read_diagnosis(tmp_path)


def test_a_notebook_shows_the_first_screen() -> None:
    shown = changed()._repr_html_()
    assert "24.4" in shown and FRICTION in shown and shown.count("<tr>") == 6
    assert len(shown) < 5000


def test_tables_go_into_arrow_and_print() -> None:
    table = changed().table()
    assert pa.table(table).to_pydict() == table.to_dict()
    lines = str(table).splitlines()
    assert lines[0] == table.title and lines[-1] == f"… and {len(table) - MOST_PRINTED_ROWS} more rows"
    assert len(lines) == MOST_PRINTED_ROWS + 3
    with pytest.raises(KeyError, match=r"has no column p; it has rank, hypothesis"):
        table["p"]


def test_a_table_goes_into_pandas() -> None:
    pytest.importorskip("pandas")
    assert list(changed().table().to_pandas().columns) == list(changed().table().columns)


def test_columns_of_a_table_have_one_length_and_text_is_escaped() -> None:
    with pytest.raises(ValueError, match="differ in length"):
        ResultTable("x", {"a": [1], "b": []})
    assert str(ResultTable("x", {"a": [], "b": []})) == "x\na  b"
    shown = ResultTable(NAME, {NAME: [NAME]})._repr_html_()
    assert "<script" not in shown and "<img" not in shown and shown.count("&lt;script&gt;") == 3
