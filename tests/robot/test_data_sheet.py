"""A gear that the catalogue does not have: its data sheet's numbers stand in the robot file, and no other gear's are
suggested."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import arms
import pytest
from replayed import diagnosis
from uncompiled import load_uncompiled

from gen.robot.description import Drive, RobotError
from gen.robot.load_robot import from_table
from hdagen.adoption.robot_update import adopt

SHEET = """K1 = 1.0e4
K2 = 1.4e4
K3 = 1.6e4
T1 = 3.9
T2 = 12.0
hysteresis_loss = 2.9e-4
starting_torque = 0.037
torsional_damping = 6.0
"""


def drive(springs: str) -> Drive:
    return from_table(tomllib.loads(with_springs(springs)), "robot.toml", Path("robot.toml")).joints[0].drive


def with_springs(text: str) -> str:
    return arms.arm("R").replace(arms.SPRINGS, text)


def refused(springs: str) -> str:
    with pytest.raises(RobotError) as raised:
        drive(springs)
    return str(raised.value)


def test_a_data_sheet_gives_the_springs_that_the_catalogue_gives_from_the_same_numbers() -> None:
    assert drive(SHEET) == drive('torsional_damping = 6.0\ncatalogue = "CSG-17-100"\n')


def test_a_gear_starts_against_its_friction_where_nothing_else_is_stated() -> None:
    found = drive(SHEET.replace("starting_torque = 0.037\n", ""))
    assert found.wave_generator_stiffening is not None
    assert found.wave_generator_stiffening.nominal == pytest.approx(1 / 0.03)


def test_equal_stiffnesses_are_a_linear_spring() -> None:
    found = drive(SHEET.replace("1.4e4", "1.0e4").replace("1.6e4", "1.0e4"))
    assert found.flexspline_stiffness is not None and found.flexspline_stiffness.nominal == pytest.approx(1.0e4)
    assert found.flexspline_stiffening is not None and found.flexspline_stiffening.nominal == 1e-6


def test_no_other_gear_is_suggested() -> None:
    said = refused('torsional_damping = 6.0\ncatalogue = "CSG-20"\n')
    assert "did you mean" not in said
    assert "write ratio, K1, K2, K3, T1, T2 and hysteresis_loss of its own data sheet" in said


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("K2 = 1.4e4\n", "", "drive.K2: found nothing"),
        ("hysteresis_loss = 2.9e-4\n", "", "drive.hysteresis_loss: found nothing"),
        ("hysteresis_loss = 2.9e-4\n", "hysteresis_loss = 0\n", "possible beside K1 to T2 is above 0"),
        ("1.4e4", "9e3", "stiffnesses that do not fall"),
        ("1.4e4", "1.59e4", None),
        ("T1 = 3.9", "T1 = 39", "possible is above T1 = 39"),
        ("T1 = 3.9", "T1 = 11.99", "possible is below 40"),
        ("K1 = 1.0e4", 'K1 = 1.0e4\ncatalogue = "CSG-17-100"', "found beside catalogue"),
        ("K1 = 1.0e4", "K1 = 1.0e4\nflexspline_stiffness = 9e3", "found beside K1 to T2 of a data sheet"),
        ("K1 = 1.0e4", "K1 = 1.0e4\nrigid = true", "found with rigid = true"),
        (SHEET, f"starting_torque = 0.04\n{arms.SPRINGS}", "found without K1 to T2 of a data sheet"),
    ],
)
def test_a_data_sheet_is_whole_and_stands_alone(old: str, new: str, says: str | None) -> None:
    text = SHEET.replace(old, new)
    if "11.99" in new:
        text = text.replace("1.4e4", "5e4").replace("1.6e4", "5e4")
    if says is None:
        assert drive(text)
    else:
        assert says in refused(text)


@pytest.mark.usefixtures("uncompiled")
def test_a_corrected_gear_is_spelt_out_and_keeps_its_wave_generator(tmp_path: Path) -> None:
    robot, stated, new = (tmp_path / name for name in ("robot.toml", "diagnosis.json", "new.toml"))
    robot.write_text(with_springs(SHEET.replace("starting_torque = 0.037\n", "")))
    stated.write_text(json.dumps(diagnosis(verdict=[], parameters={"coulomb_friction_1": 0.031})))
    adopt(stated, robot, new)
    assert "starting_torque = 0.03" in new.read_text() and "K1 = 1.0e4" in new.read_text()
    stated.write_text(json.dumps(diagnosis(verdict=[], parameters={"flexspline_stiffness_1": 1.0e4})))
    text = adopt(stated, robot, new, force=True).text
    assert "# began as K1 = 10000.0, K2 = 14000.0" in text and "\nK1" not in text
    before, after = (load_uncompiled(path).parameters for path in (robot, new))
    assert {name for name in before if before[name] != after[name]} == {"flexspline_stiffness_1"}
