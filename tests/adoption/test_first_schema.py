"""A diagnosis.json of the first schema, as earlier versions wrote it, is read with the keys of the present schema."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from replayed import FLEXIBLE

from hdagen.adoption.diagnosis_file import read_content
from hdagen.adoption.diagnosis_schema import RENAMED_KEYS, RENAMED_METHOD_KEYS, SCHEMA, upgrade_content
from hdagen.adoption.robot_update import adopt
from hdagen.adoption.verdict import read_verdict
from hdagen.diagnosis.data.held_out_rows import count_rows
from hdagen.fleet.machine_task import is_machine_row, summarize_diagnosis
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay

STORED = Path(__file__).with_name("diagnosis_schema_1.json")
FIRST = json.loads(STORED.read_text(encoding="utf-8"))


def test_the_keys_of_the_present_schema_take_the_values_of_the_first() -> None:
    found = read_content(STORED)
    assert found["schema"] == SCHEMA
    assert {new: found[new] for new in RENAMED_KEYS.values()} == {new: FIRST[old] for old, new in RENAMED_KEYS.items()}
    method = FIRST["method"]
    assert {new: found["method"][new] for new in RENAMED_METHOD_KEYS.values()} == {
        new: method[old] for old, new in RENAMED_METHOD_KEYS.items()
    }
    for old, table in ((RENAMED_KEYS, found), (RENAMED_METHOD_KEYS, found["method"])):
        assert not old.keys() & table.keys()
    kept = FIRST.keys() - RENAMED_KEYS.keys() - {"schema", "method"}
    assert {key: found[key] for key in kept} == {key: FIRST[key] for key in kept}


def test_a_document_of_another_schema_stays_as_it_is() -> None:
    for other in ({}, {"schema": SCHEMA, "alone": 1}, {"schema": True, "alone": 1}, {"schema": "1", "alone": 1}):
        assert upgrade_content(other) is other


@pytest.mark.parametrize("given", [STORED, FIRST], ids=["file", "content"])
def test_its_verdict_is_read(given: Path | dict[str, object]) -> None:
    said = read_verdict(given)
    assert [(one.name, one.joint, one.parameters) for one in said.effects] == [("current_bias", 1, {"bias_1": 0.02})]
    assert said.base_parameters == {"mass_1": 4.1}


@pytest.mark.usefixtures("uncompiled")
def test_it_is_adopted(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(FLEXIBLE, encoding="utf-8")
    done = adopt(STORED, tmp_path / "robot.toml", tmp_path / "new.toml")
    assert "current_bias" in (tmp_path / "new.toml").read_text(encoding="utf-8") and done


def test_its_rows_are_counted() -> None:
    time = 1e-3 * np.arange(4)
    log = Log(time, {"joint_position_1": np.zeros(4)}, 1, "log.csv")
    columns = {"joint_position_1": np.full(4, 1e-3)}
    noise = {"joint_position_1": 1e-3}
    found = Replay(columns, np.zeros((4, 1)), noise, noise, {}, np.array([0]), 0, ())
    counted = count_rows(found, log, read_content(STORED), "diagnosis.json")
    assert "2 of 4 rows" in counted.notes[-1]


def test_a_fleet_takes_its_row_from_it() -> None:
    assert is_machine_row(summarize_diagnosis(read_content(STORED)))
