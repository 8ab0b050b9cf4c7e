"""The JSON Schema of robot.toml: every robot of the project keeps it, and it refuses what the reader refuses."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import arms
import pytest
from json_schemas import violations

from gen.robot.json_schema import build_json_schema
from gen.robot.load_robot import RobotError, from_table

ROOT = Path(__file__).parents[2]
SCHEMA = build_json_schema()
ROBOTS = [*(ROOT / "gen" / "presets").glob("*.toml")]
ROBOTS += [path for path in (ROOT / "docs" / "examples").rglob("*.toml") if "gravity" in path.read_text("utf-8")]
GOOD = arms.arm("RP", drive="torque_constant = 0.05\nmax_current = 10.0")


def is_refused(table: dict[str, Any]) -> bool:
    try:
        from_table(table, "robot.toml", Path("robot.toml"))
    except RobotError:
        return True
    return False


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda path: path.stem)
def test_every_robot_keeps_it(robot: Path) -> None:
    assert violations(tomllib.loads(robot.read_text(encoding="utf-8")), SCHEMA) == []


@pytest.mark.parametrize(
    "found, instead",
    [
        ("name = ", "nom = "),
        ("torque_constant = 0.05", "torque_constant = -0.05"),
        ("torque_constant = 0.05", "torque_constant = '0.05'"),
        ("torque_constant = 0.05", "torque_constant = {value = 0.05}"),
        ("torque_constant = 0.05", "torque_constant = {value = 0.05, tolerance = 0.1, more = 1}"),
        ("torque_constant = 0.05", "rigid = true"),
        ("torque_constant = 0.05", "K1 = 1e4"),
        ("torque_constant = 0.05", "catalogue = 'CSD-17-100'"),
        ("max_current = 10.0", "max_current = 0"),
        ("max_current = 10.0", "unknown_key = 1"),
        ("gravity = [", "gravity = [1.0, "),
        ("mass = ", "weight = "),
        ("[joint.drive]", "[joint.motor]"),
    ],
)
def test_it_refuses_what_the_reader_refuses(found: str, instead: str) -> None:
    assert violations(tomllib.loads(GOOD), SCHEMA) == [] and not is_refused(tomllib.loads(GOOD))
    assert found in GOOD
    table = tomllib.loads(GOOD.replace(found, instead, 1))
    assert violations(table, SCHEMA) != [] and is_refused(table)


@pytest.mark.parametrize(
    "effect",
    [
        {"name": "backlash"},
        {"name": "backlash", "joint": 13},
        {"name": "backlash", "joint": 1, "payload_mass": 0.5},
        {"name": "back lash", "joint": 1},
        {"name": "payload", "joint": 1, "payload_mass": 1e9},
    ],
    ids=str,
)
def test_a_wrong_effect_is_refused(effect: dict[str, Any]) -> None:
    table = tomllib.loads(GOOD) | {"effect": [effect]}
    assert violations(table, SCHEMA) != [] and is_refused(table)


def test_a_right_effect_is_not() -> None:
    table = tomllib.loads(GOOD) | {"effect": [{"name": "payload", "joint": 2, "payload_mass": 0.2}]}
    assert violations(table, SCHEMA) == [] and not is_refused(table)


def test_it_is_printed() -> None:
    done = subprocess.run([sys.executable, "-m", "gen.robot.json_schema"], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == SCHEMA
