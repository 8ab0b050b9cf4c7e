"""Cases of a model that the caller names: drawn from a seed, moved by MuJoCo, and refused where they cannot be."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import space_robots

from gen.robot.load_robot import from_table
from hdagen.__main__ import main

pytest.importorskip("mujoco", reason="MuJoCo makes the realities: pip install 'hdagen[mujoco]'")

from hdagen.blind.realities.cases import draw_cases
from hdagen.blind.realities.model_arms import EFFECTS, OWN_ROTOR_EFFECTS, RATE, SCATTER, ModelCase, ModelRobot
from hdagen.blind.realities.model_reality import make_model_log
from hdagen.blind.realities.population import Population, read_population

LOG_SECONDS = 3.0  # the first of which the motion takes to begin
URDF = """<robot name="two"><link name="base"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="40" velocity="3"/></joint>
<link name="a"><inertial><origin xyz="0.1 0 0.1"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0" ixz="0.002" iyz="0"/></inertial></link>
<joint name="lift" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.2 0 0.2"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" effort="40" velocity="3"/></joint>
<link name="b"><inertial><origin xyz="0.15 0.02 0"/><mass value="1.5"/>
<inertia ixx="0.005" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>
"""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "two.urdf"
    path.write_text(URDF)
    return path


def draw(model: Path, kind: str, count: int, seed: str = "seed") -> list[ModelCase]:
    cases = draw_cases(seed, Population(kind, "model", model=str(model)), count)
    return [case for case in cases if isinstance(case, ModelCase)]


def test_a_model_is_a_family_of_its_own(model: Path) -> None:
    assert read_population({"kind": "single", "model": "two.urdf"}) == Population("single", "model", model="two.urdf")
    assert Population("none", "model", model="a/two.urdf").name == "model two none"


def test_the_robot_file_states_the_tolerance_by_which_the_reality_is_scattered(model: Path) -> None:
    """As the files of the other families do. A file that says less of itself hides a payload among its masses."""
    (case,) = draw(model, "single", 1)
    silent = re.sub("(?m)^tolerance = .*$", "", case.robot.text)
    for robot in (case.robot, ModelRobot(silent)):
        assert from_table(tomllib.loads(robot.toml()), "two", model).joints[1].mass.tolerance == SCATTER


def test_more_cases_begin_with_the_fewer_and_effects_come_in_turn(model: Path) -> None:
    few, many = draw(model, "single", 3), draw(model, "single", 22)
    assert many[:3] == few and len({case.name for case in many}) == 22
    possible = set(EFFECTS) - {"missing_compliance", "backlash"}  # the URDF states no rotor that a gear turns
    assert {case.effect for case in many[:11]} == possible == {case.effect for case in many[11:]}
    assert all(case.joint == {"gravity_tilt": 0, "payload": 2}.get(case.effect, case.joint) <= 2 for case in many)
    assert draw(model, "single", 3, "other") != few
    assert all(case.label()["verdict"] == [] and case.kind == "none" for case in draw(model, "none", 2))
    assert few[0].label()["verdict"] == [f"{few[0].effect}@{few[0].joint}"]


def test_links_are_scattered_and_stay_bodies(model: Path) -> None:
    case = draw(model, "none", 1)[0]
    stated, true = case.robot.table, case.true_table()
    for one, other in zip(stated["joint"], true["joint"], strict=True):
        assert 0 < abs(other["mass"] / one["mass"] - 1) < 0.07
        shift = np.linalg.norm(np.subtract(other["center_of_mass"], one["center_of_mass"]))
        assert 0 < shift < 0.11 * np.linalg.norm(one["center_of_mass"])
        factor = other["inertia"][0] / one["inertia"][0]
        assert other["inertia"] == pytest.approx([factor * entry for entry in one["inertia"]]) and factor != 1.0
        assert one["origin"] == other["origin"] and one["axis"] == other["axis"]


@pytest.fixture(scope="module")
def without(model: Path) -> dict[str, np.ndarray]:
    """The log of the first case without an effect."""
    case = replace(draw(model, "single", 1)[0], effect="", kind="none", joint=1, size=0.5)
    log, nothing, none = make_model_log(case, "log", LOG_SECONDS)
    assert nothing == {} and none == 0.0
    return log


@pytest.mark.parametrize("effect", [effect for effect in EFFECTS if effect not in OWN_ROTOR_EFFECTS])
def test_an_effect_shows_and_none_is_none(effect: str, model: Path, without: dict[str, np.ndarray]) -> None:
    joint = {"gravity_tilt": 0, "payload": 2}.get(effect, 1)
    case = replace(draw(model, "single", 1)[0], effect=effect, joint=joint, size=0.5)
    log, found, snr = make_model_log(case, "log", LOG_SECONDS)
    assert snr > 10 and found and all(np.isfinite(values).all() for values in log.values())
    assert len(log["time"]) == LOG_SECONDS * RATE and {"motor_torque_command_2", "joint_position_2"} <= log.keys()
    again, same, _ = make_model_log(case, "log", LOG_SECONDS, found)
    assert same == found and all(np.array_equal(again[name], log[name]) for name in log)
    assert not np.array_equal(without["joint_position_1"], log["joint_position_1"])


def test_what_stands_before_the_motor_shows_in_its_torque(model: Path) -> None:
    case = replace(draw(model, "single", 1)[0], joint=2)
    log, found, _ = make_model_log(replace(case, effect="current_saturation", size=0.2), "log", 1.5)
    spread = 0.04  # N m of noise
    assert (
        np.abs(log["motor_torque_2"]).max() < found["limit"] + 6 * spread < np.abs(log["motor_torque_command_2"]).max()
    )
    late, _, _ = make_model_log(replace(case, effect="command_delay"), "log", 1.5, {"time": 3 / RATE})
    command, torque = late["motor_torque_command_2"], late["motor_torque_2"]
    left = [np.std(torque[10:] - command[10 - k : len(command) - k]) for k in range(8)]
    assert int(np.argmin(left)) == 4 and min(left) < 1.5 * spread  # a row shows what acts until it


def test_cases_are_written(model: Path, tmp_path: Path) -> None:
    command = ["blind", "--model", str(model), "--kind", "single", "--cases", "1", "--seconds", "2", "--seed", "s"]
    assert main([*command, "--write", str(tmp_path), "--jobs", "1"]) == 0
    folder = tmp_path / "model-two-single"
    label = json.loads((folder / "labels.json").read_text())["case-000"]
    assert label["kind"] == "single" and label["parameters"].keys() == set(label["verdict"])
    assert (folder / "case-000" / "hold_out.parquet").is_file()
    assert 'name = "turn"' in (folder / "case-000" / "robot.toml").read_text()


def test_what_is_no_model_is_refused(model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flat, mass = tmp_path / "flat.toml", tmp_path / "mass.toml"
    flat.write_text('name = "a"\n[[joint]]\nlength = 1.0\n')
    mass.write_text(space_robots.chain("R", 1).replace("mass = ", "mass = 1 # "))
    for given, says in (
        (["--model", str(tmp_path / "none.urdf")], "there is no such file"),
        (["--model", str(flat)], "found no rigid joints in space at ratio 1"),
        (["--model", str(mass)], "found no rigid joints in space at ratio 1"),
        (["--model", str(model), "--family", "joint"], "--model is a family of its own"),
        (["--model", str(model), "--background", "0.04"], "--model has no background"),
    ):
        assert main(["blind", "--kind", "single", "--cases", "1", "--out", str(tmp_path / "out"), *given]) == 2
        assert says in capsys.readouterr().err
    assert main(["blind", "--kind", "pair", "--cases", "1", "--model", str(model)]) == 2
    assert "has no kind pair; possible are single, none" in capsys.readouterr().err
