"""Effects of a model's reality that MuJoCo's stops, springs and encoders make: put in, and found again in the log."""

from __future__ import annotations

import io
import json
import re
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import space_robots
from pyarrow import parquet
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from uncompiled import load_uncompiled

from gen.effects import ALL

pytest.importorskip("mujoco", reason="MuJoCo makes the realities: pip install 'hdagen[mujoco]'")

import mujoco

from hdagen.blind.realities import log_maker
from hdagen.blind.realities.cases import draw_cases
from hdagen.blind.realities.model_arms import (
    EFFECTS,
    RATE,
    ModelCase,
    ModelRobot,
    Table,
    draw_model_cases,
    draw_space_motion,
    list_possible_joints,
)
from hdagen.blind.realities.model_effects import Values, draw_effect
from hdagen.blind.realities.model_reality import CABLE_BEND, make_model_log, simulate_space_arm
from hdagen.blind.realities.population import Population, read_population
from hdagen.blind.realities.space_model import write_space_model

NEW_EFFECTS = ("missing_compliance", "backlash", "cable_spring", "contact", "encoder_eccentricity", "motor_inertia")
LIMITS = "\n[joint.limits]\nposition = [-2.0, 2.0]\nspeed = 3.0\ntorque = 40.0\n"
TWO = space_robots.chain("RR", 3).replace("coulomb_friction = 0.0", f"coulomb_friction = 0.0{LIMITS}")
ROTOR, LINK = 0.1, 0.07  # kg m², of the one joint: 0.03 about its centre, and 1 kg at 0.2 m
ONE = f"""name = "one"
gravity = [0.0, -9.81, 0.0]
[[joint]]
name = "turn"
type = "revolute"
origin = [0.0, 0.0, 0.0]
rotation = [1.0, 0.0, 0.0, 0.0]
axis = [0.0, 0.0, 1.0]
mass = 1.0
center_of_mass = [0.2, 0.0, 0.0]
inertia = [0.02, 0.03, 0.03, 0.0, 0.0, 0.0]
[joint.drive]
ratio = 1.0
rigid = true
motor_inertia = {ROTOR}
viscous_friction = 0.0
coulomb_friction = 0.0{LIMITS}
[tip]
origin = [0.3, 0.0, 0.0]
rotation = [1.0, 0.0, 0.0, 0.0]
"""


def simulate(text: str, seconds: float, effects: Mapping[tuple[str, int], Values]) -> dict[str, np.ndarray]:
    """A log of an arm whose links are those of its file."""
    table, rng = ModelRobot(text).table, np.random.default_rng(5)
    return simulate_space_arm(table, table, draw_space_motion(rng, table, seconds), rng, effects)


def balance_torques(table: Table, log: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, accelerations and the torques that the model leaves over, all (T, n), smoothed alike."""
    n, still = len(table["joint"]), [0.0] * len(table["joint"])
    smooth = [
        np.column_stack([gaussian_filter1d(log[f"{name}_{j + 1}"], 0.02 * RATE) for j in range(n)])
        for name in ("joint_position", "motor_torque_command")
    ]
    position, torque = smooth
    velocity = np.gradient(position, 1 / RATE, axis=0)
    acceleration = np.gradient(velocity, 1 / RATE, axis=0)
    damping = [joint["drive"]["viscous_friction"] for joint in table["joint"]]
    model = mujoco.MjModel.from_xml_string(write_space_model(table, still, damping))
    data, left = mujoco.MjData(model), np.empty_like(torque)
    for k, (q, v, a) in enumerate(zip(position, velocity, acceleration, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        left[k] = torque[k] - data.qfrc_inverse
    inner = slice(int(0.3 * RATE), -int(0.3 * RATE))  # smoothed from both sides
    return position[inner], acceleration[inner], left[inner]


def recover_motor_angle(log: Mapping[str, np.ndarray]) -> np.ndarray:
    """The rotor's angle (T,), rad, of the one joint: rotor and link keep the momentum that torque and weight give."""
    time, q, torque = log["time"], log["joint_position_1"], log["motor_torque_command_1"]
    weight = CubicSpline(time, 0.2 * 9.81 * np.cos(q))
    pushed = np.concatenate([[0.0], np.cumsum(torque[:-1]) / RATE])  # a command is held from row to row
    moved = np.concatenate([[0.0], np.cumsum(pushed[:-1] / RATE + 0.5 * torque[:-1] / RATE**2)])
    return np.asarray((moved - weight.antiderivative(2)(time) - LINK * (q - q[0])) / ROTOR)


def fit_columns(target: np.ndarray, *columns: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients of the columns, and the rms of what they leave."""
    basis = np.column_stack(columns)
    found = np.linalg.lstsq(basis, target, rcond=None)[0]
    return found, float(np.sqrt(np.mean((target - basis @ found) ** 2)))


# -- nothing in, nothing out ------------------------------------------------------------------------------------------

NOTHING: dict[str, Values] = {
    "cable_spring": {"stiffness": 0.0, "rest": 0.3},
    "contact": {"angle": 1.9, "side": 1.0, "stiffness": 1e3, "damping": 1.0},
    "encoder_eccentricity": {"share": 0.0, "phase": 1.0},
    "motor_inertia": {"inertia": ROTOR},
    "missing_compliance": {"compliance": 1.5e-5, "damping": 10.0},
    "backlash": {"width": 0.0, "compliance": 1.5e-5, "damping": 10.0},
}


@pytest.mark.parametrize("effect", NEW_EFFECTS)
def test_an_effect_of_size_nothing_changes_nothing(effect: str) -> None:
    without, log = simulate(ONE, 3.0, {}), simulate(ONE, 3.0, {(effect, 1): NOTHING[effect]})
    changed = np.abs(log["joint_position_1"] - without["joint_position_1"]).max()
    if effect in ("missing_compliance", "backlash"):
        assert changed < 2e-4  # the stiffest gear that the step carries still turns by 1.5e-5 rad/(N m)
    else:
        assert changed == 0.0


# -- put in and found again -------------------------------------------------------------------------------------------


def test_a_nominal_joint_leaves_nothing() -> None:
    log, table = simulate(ONE, 4.0, {}), ModelRobot(ONE).table
    assert np.abs(balance_torques(table, log)[2]).max() < 0.02
    time, theta = log["time"], recover_motor_angle(log)
    assert fit_columns(theta - log["joint_position_1"], np.ones_like(time), time)[1] < 1e-3


def test_a_missing_compliance_yields_by_the_torque_that_it_carries() -> None:
    put = {"compliance": 2e-3, "damping": 0.3}
    log = simulate(ONE, 4.0, {("missing_compliance", 1): put})
    time, q = log["time"], log["joint_position_1"]
    smooth = gaussian_filter1d(q, 0.01 * RATE)
    carried = LINK * np.gradient(np.gradient(smooth, 1 / RATE), 1 / RATE) + 0.2 * 9.81 * np.cos(q)
    twist = recover_motor_angle(log) - q
    found, _ = fit_columns(twist[50:-50], np.ones_like(time)[50:-50], time[50:-50], carried[50:-50])
    assert found[2] == pytest.approx(put["compliance"], rel=0.1)


def test_play_is_crossed_from_side_to_side() -> None:
    """Without weight, so that the link is pushed from either side."""
    put = {"width": 8e-3, "compliance": 2e-5, "damping": 5.0}
    text = ONE.replace("-9.81", "0.0")
    time = np.arange(4 * RATE) / RATE
    log = simulate(text, 4.0, {("backlash", 1): put})
    torque, q = log["motor_torque_command_1"], log["joint_position_1"]
    pushed = np.concatenate([[0.0], np.cumsum(torque[:-1]) / RATE])
    moved = np.concatenate([[0.0], np.cumsum(pushed[:-1] / RATE + 0.5 * torque[:-1] / RATE**2)])
    twist = (moved - LINK * (q - q[0])) / ROTOR - q
    twist -= twist[: RATE // 10].mean()
    low, high = np.quantile(twist, [0.05, 0.95])
    assert high - low == pytest.approx(put["width"], rel=0.1)
    beyond = np.abs(twist - (low + high) / 2) > 0.6 * put["width"]
    assert beyond.mean() < 0.02  # the stops hold
    rigid = simulate(text, 4.0, {})
    assert np.array_equal(time, rigid["time"]) and rigid.keys() == log.keys()


def test_a_cable_pulls_by_the_angle() -> None:
    put = {"stiffness": 2.0, "rest": 0.3}
    position, _, left = balance_torques(ModelRobot(TWO).table, simulate(TWO, 6.0, {("cable_spring", 1): put}))
    bent = CABLE_BEND * position[:, 0]
    found, rest = fit_columns(left[:, 0], np.sin(bent), np.cos(bent))
    assert CABLE_BEND * np.hypot(*found) == pytest.approx(put["stiffness"], rel=0.03)
    assert np.arctan2(-found[1], found[0]) / CABLE_BEND == pytest.approx(put["rest"], abs=0.02)
    assert rest < 0.03 and np.abs(left[:, 1]).max() < 0.1  # nothing at the other joint


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_stop_pushes_back_on_one_side_alone(side: float) -> None:
    put = {"angle": 0.2 * side, "side": side, "stiffness": 30.0, "damping": 0.6}
    log = simulate(TWO, 6.0, {("contact", 1): put})
    position, _, left = balance_torques(ModelRobot(TWO).table, log)
    depth = side * (position[:, 0] - put["angle"])
    assert depth.max() > 0.05 and depth.min() < -0.2
    free, deep = depth < -0.03, depth > 0.01  # smoothing blurs the edge
    assert np.abs(left[free, 0]).max() < 0.1 and np.abs(left[:, 1]).max() < 0.1
    found, _ = fit_columns(side * left[deep, 0], depth[deep], np.gradient(depth, 1 / RATE)[deep])
    assert found == pytest.approx([put["stiffness"], put["damping"]], rel=0.05)


@pytest.mark.parametrize("stated", [True, False])
def test_a_rotor_resists_acceleration_alone(stated: bool) -> None:
    text = TWO if stated else re.sub(r"motor_inertia = \S+", "motor_inertia = 0.0", TWO)
    table = ModelRobot(text).table
    known = table["joint"][1]["drive"]["motor_inertia"]
    log = simulate(text, 6.0, {("motor_inertia", 2): {"inertia": 0.15}})
    assert table["joint"][1]["drive"]["motor_inertia"] == known  # what the controller knows is left alone
    _, acceleration, left = balance_torques(table, log)
    found, rest = fit_columns(left[:, 1], acceleration[:, 1])
    assert found[0] + known == pytest.approx(0.15, rel=0.03) and rest < 0.02 and np.abs(left[:, 0]).max() < 0.1


def test_a_disc_off_its_centre_errs_once_a_turn_and_moves_nothing() -> None:
    """Without weight the torques alone tell where the joint is."""
    put = {"share": 5e-3, "phase": 0.8}
    text = ONE.replace("-9.81", "0.0")
    without, log = simulate(text, 4.0, {}), simulate(text, 4.0, {("encoder_eccentricity", 1): put})
    assert np.array_equal(without["motor_torque_command_1"], log["motor_torque_command_1"])
    q, read = without["joint_position_1"], log["joint_position_1"]
    (sine, cosine, _), rest = fit_columns(read - q, np.sin(q), np.cos(q), np.ones_like(q))
    assert [np.hypot(sine, cosine), np.arctan2(cosine, sine)] == pytest.approx([put["share"], put["phase"]], rel=0.02)
    assert rest < 5e-5 and abs((read - q)[np.argmin(np.abs(q))]) < 1e-4  # 0 at the zero position


# -- where an effect can be, and what is told -------------------------------------------------------------------------


def test_an_effect_is_drawn_where_the_dictionary_offers_it(tmp_path: Path) -> None:
    """A gear that gives way needs a rotor of its own; a joint that slides has no disc."""
    first, second = space_robots.chain("RP", 4).split('name = "axis_2"')
    text = 'name = "axis_2"'.join(
        re.sub(r"motor_inertia = \S+", f"motor_inertia = {rotor}", part)
        for part, rotor in ((first, 0.0), (second, 0.05))
    )
    robot = tmp_path / "robot.toml"
    robot.write_text(text)
    arm, table = load_uncompiled(robot, effects=tuple(effect.name for effect in ALL)), ModelRobot(text).table
    offered = {(one["name"], j) for one in arm.manifest["effects"] for j in one["joints"]}
    for effect in set(EFFECTS) - {"motor_inertia"}:  # a number of the robot file, which every joint has
        at = list_possible_joints(effect, table)
        assert {(effect, j) for j in at} == {one for one in offered if one[0] == effect}, effect
    assert list_possible_joints("backlash", table) == (2,) == list_possible_joints("missing_compliance", table)
    assert list_possible_joints("encoder_eccentricity", table) == (1,)


def make_case(path: Path, effect: str, size: float = 0.5) -> ModelCase:
    """The first case of a model with an effect of a size at its last possible joint."""
    case = draw_model_cases("seed", Population("single", "model", model=str(path)), 1)[0]
    return replace(case, effect=effect, joint=list_possible_joints(effect, case.robot.table)[-1], size=size)


@pytest.mark.parametrize("effect", NEW_EFFECTS)
def test_size_and_joint_are_those_of_the_label(effect: str, tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text(TWO)
    case = make_case(path, effect)
    without, _, _ = make_model_log(make_case(path, ""), "log", 2.0)
    log, found, snr = make_model_log(case, "log", 2.0)
    assert found == draw_effect(case, without) and all(np.isfinite(list(found.values()))) and snr > 1.0
    small, large = (draw_effect(make_case(path, effect, size), without) for size in (0.0, 1.0))
    key = {"encoder_eccentricity": "share", "missing_compliance": "compliance", "backlash": "width"}.get(effect)
    key = key or {"cable_spring": "stiffness", "contact": "angle", "motor_inertia": "inertia"}[effect]
    assert small[key] != large[key] and (key == "angle" or small[key] < found[key] < large[key])
    label = case.label()
    assert label["verdict"] == [f"{effect}@{case.joint}"]
    assert label["optional"] == (["missing_compliance@2"] if effect == "backlash" else [])
    assert log.keys() == without.keys()


def test_labels_never_reach_a_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Logs of all effects have the same columns and the same robot file, and no word of what is in them."""
    model = tmp_path / "two.toml"
    model.write_text(TWO)
    request: dict[str, Any] = {"seed": "s", "kind": "single", "family": "model", "model": str(model), "seconds": 0.3}
    cases = draw_cases("s", read_population(request), len(EFFECTS))
    told_words, schemas = set(), set()
    out = tmp_path / "logs"
    out.mkdir()
    for index, case in enumerate(cases):
        wanted = request | {"index": index, "motion": "log", "out": str(out / f"{case.name}.parquet")}
        monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps(wanted)))
        log_maker.main()
        told = json.loads(capsys.readouterr().out)
        label = case.label()
        assert told["parameters"].keys() == {*label["verdict"], *label["optional"]} and told["snr"] > 0.0
        told_words |= {word for name, p in told["parameters"].items() for word in (name.split("@")[0], *p)} - {*"xyz"}
        schema = parquet.read_schema(out / f"{case.name}.parquet")
        schemas.add((tuple(schema.names), str(schema.metadata)))
    assert {name for name in told_words if name in EFFECTS} == set(EFFECTS) and len(schemas) == 1
    assert len({case.robot.toml() for case in cases}) == 1
    unsaid = told_words - {"torque", "time"}  # torques and time are columns
    for path in out.iterdir():
        content = path.read_bytes()
        assert not any(word.encode() in content for word in unsaid)
