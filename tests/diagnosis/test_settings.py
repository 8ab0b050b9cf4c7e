"""The settings of a diagnosis: each has its unit and reason, and goes into diagnosis.json and the docs' tables."""

from __future__ import annotations

import dataclasses
import importlib
import json
from pathlib import Path

import pytest

from hdagen.bench.settings_tables import build_settings_table
from hdagen.diagnosis.settings import STAGE_SETTINGS, record_settings
from hdagen.support.setting_declaration import list_settings

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_every_setting_has_its_unit_and_reason(stage: str) -> None:
    for one in list_settings(STAGE_SETTINGS[stage]):
        assert one.unit.strip() and one.reason.strip() and one.chosen_on.strip(), one.name


@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_a_setting_cannot_be_changed(stage: str) -> None:
    settings = STAGE_SETTINGS[stage]
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(settings, dataclasses.fields(settings)[0].name, 1.0)


def test_every_settings_class_has_its_stage() -> None:
    found = set()
    rooms = ("hdagen/data_quality", "hdagen/prediction", "hdagen/diagnosis")
    for path in (path for room in rooms for path in (ROOT / room).rglob("*_settings.py")):
        module = importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
        found |= {name for name, value in vars(module).items() if name.isupper() and dataclasses.is_dataclass(value)}
    assert len(found) == len(STAGE_SETTINGS) == len({type(settings) for settings in STAGE_SETTINGS.values()})


def test_the_record_is_json_with_every_value() -> None:
    read = json.loads(json.dumps(record_settings(), allow_nan=False))
    assert read["search"]["least_evidence_gain"] == STAGE_SETTINGS["search"].least_evidence_gain
    assert tuple(read["candidate_models"]["spike_scales"]) == STAGE_SETTINGS["candidate_models"].spike_scales
    for stage, settings in STAGE_SETTINGS.items():
        assert set(read[stage]) == {one.name for one in list_settings(settings)}


@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_a_table_has_a_line_for_each_setting(stage: str) -> None:
    lines = build_settings_table(stage).splitlines()
    assert [line.split("`")[1] for line in lines[2:]] == [one.name for one in list_settings(STAGE_SETTINGS[stage])]
    assert {line.count(" | ") for line in lines if not line.startswith("|---")} == {4}
