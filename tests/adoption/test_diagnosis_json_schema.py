"""The JSON Schema of diagnosis.json: a stored diagnosis keeps it, and what is wrong with one is found."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from typing import Any

import pytest
from json_schemas import violations

from hdagen.adoption.diagnosis_json_schema import TABLES, build_json_schema
from hdagen.adoption.diagnosis_schema import RENAMED_KEYS, RENAMED_METHOD_KEYS

STORED: dict[str, Any] = json.loads((files("hdagen.data") / "pendulum_diagnosis.json").read_text(encoding="utf-8"))
SCHEMA = build_json_schema()


def test_a_stored_diagnosis_keeps_it() -> None:
    assert violations(STORED, SCHEMA) == []


def test_its_keys_are_those_of_the_present_schema() -> None:
    keys = {key for key, _, _ in TABLES["diagnosis"]}
    method = {key for key, _, _ in TABLES["method"]}
    assert set(RENAMED_KEYS.values()) <= keys and not RENAMED_KEYS.keys() & keys
    assert set(RENAMED_METHOD_KEYS.values()) <= method and not RENAMED_METHOD_KEYS.keys() & method


@pytest.mark.parametrize(
    "spoil, place",
    [
        (lambda d: d.update(schema=1), "$.schema"),
        (lambda d: d.pop("ranking"), "$"),
        (lambda d: d.update(ladder=[]), "$.ladder"),
        (lambda d: d["verdict"].append("backlash"), "$.verdict.1"),
        (lambda d: d["gap"].update(before="much"), "$.gap.before"),
        (lambda d: d["hypotheses"][0].update(probability=1.5), "$.hypotheses.0.probability"),
        (lambda d: d["where"][0].update(place="foot"), "$.where.0.place"),
        (lambda d: d.update(sure=1), "$.sure"),
    ],
)
def test_what_is_wrong_is_found(spoil: Callable[[dict[str, Any]], object], place: str) -> None:
    document = json.loads(json.dumps(STORED))
    spoil(document)
    assert [line.split(":")[0] for line in violations(document, SCHEMA)] == [place]


def test_it_is_printed() -> None:
    command = [sys.executable, "-m", "hdagen.adoption.diagnosis_json_schema"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == SCHEMA
