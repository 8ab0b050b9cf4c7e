"""Arms in space as URDF and MJCF: the numbers come back by import, and MuJoCo accelerates as the compiled arm does."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import space_robots
from compiled import Compiled
from described_arms import describe_arm

from gen.presets import find_presets
from gen.robot.link_geometry import make_rotation
from hdagen.__main__ import main
from hdagen.arm.compiled_arm import Arm
from hdagen.blind.realities.model_arms import ModelRobot
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import FORMATS
from hdagen.model_export.mjcf_writer import write as write_mjcf
from hdagen.model_export.urdf_writer import find_roll_pitch_yaw
from hdagen.model_export.urdf_writer import write as write_urdf
from hdagen.model_import.chain_reduction import ChainRequest
from hdagen.model_import.robot_writing import import_model

LIMITS = "\n[joint.limits]\nposition = [-1.5, 1.5]\nspeed = 3.0\ntorque = 80.0\nmotor_torque_rate = 8000.0\n"
FRICTION = f"coulomb_friction = 0.3{LIMITS}"
FOUR = space_robots.chain("RPRR", 11).replace("coulomb_friction = 0.0", FRICTION)  # a build that other tests want, too
MADE = {
    "six joints": space_robots.chain("RRPRRR", 3).replace("coulomb_friction = 0.0", FRICTION),
    "seven joints": space_robots.chain("RRRRRRR", 4),  # without limits
}
ROBOTS = MADE | {name: find_presets()[name].read_text() for name in ("panda", "kinova_gen3", "ur5e", "so101")}
EXACT = 1e-9


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build(FOUR).folder)


def come_back(file: Path) -> dict[str, Any]:
    return ModelRobot(import_model(str(file), ChainRequest(tip="tip")).text).table


def compare(ours: dict[str, Any], theirs: dict[str, Any], lost: tuple[str, ...]) -> None:
    """Every number of two robot files but those that a format does not hold."""
    if "gravity" not in lost:
        assert theirs["gravity"] == pytest.approx(ours["gravity"], abs=EXACT)
    frames = [*zip(ours["joint"], theirs["joint"], strict=True), (ours["tip"], theirs["tip"])]
    for one, other in frames:
        turns = [make_rotation(tuple(table["rotation"])) for table in (one, other)]
        assert turns[1] == pytest.approx(turns[0], abs=EXACT)
        for key in ("origin", "axis", "mass", "center_of_mass", "inertia"):
            if key in one:
                assert other[key] == pytest.approx(one[key], rel=EXACT, abs=EXACT * np.abs(one[key]).max()), key
    for one, other in frames[:-1]:
        assert one["name"] == other["name"] and other["type"] == one.get("type", "revolute")
        for table in ("drive", "limits"):
            stated = {key: value for key, value in one.get(table, {}).items() if key not in lost}
            found = {key: value for key, value in other.get(table, {}).items() if key not in lost}
            assert found == {key: pytest.approx(value, rel=EXACT) for key, value in stated.items()}


@pytest.mark.parametrize("robot", ROBOTS)
def test_urdf_comes_back(robot: str, tmp_path: Path) -> None:
    written = write_urdf(describe_arm(ROBOTS[robot]), tmp_path / "robot.urdf")
    compare(
        tomllib.loads(ROBOTS[robot]),
        come_back(tmp_path / "robot.urdf"),
        ("gravity", "motor_inertia", "friction_smoothing"),
    )
    assert any("URDF states no gravity" in note for note in written.notes)


@pytest.mark.parametrize("robot", ROBOTS)
def test_mjcf_comes_back(robot: str, tmp_path: Path) -> None:
    write_mjcf(describe_arm(ROBOTS[robot]), tmp_path / "robot.xml")
    compare(tomllib.loads(ROBOTS[robot]), come_back(tmp_path / "robot.xml"), ("speed", "friction_smoothing"))


def test_mujoco_accelerates_as_the_compiled_arm_does(arm: Arm, tmp_path: Path) -> None:
    frictionless = arm.with_parameters(arm.p)
    frictionless.parameters.update({name: 0.0 for name in arm.parameters if name.startswith("coulomb_friction")})
    write_mjcf(CorrectedRobot("robot.toml", frictionless, frictionless), tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    data, n, rng = mujoco.MjData(model), arm.n, np.random.default_rng(0)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    for _ in range(50):
        x, torque = rng.uniform(-2.0, 2.0, arm.nx), rng.uniform(-20.0, 20.0, n)
        data.qpos[:], data.qvel[:], data.ctrl[:] = x[:n], x[n:], torque
        mujoco.mj_forward(model, data)
        ours = frictionless.rhs(x, np.append(torque, np.zeros(6)))[n:]
        assert data.qacc == pytest.approx(ours, rel=EXACT, abs=EXACT * np.abs(ours).max())


def test_the_commands_take_an_arm_in_space(
    build: Callable[..., Compiled], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A model, the same corrected by a diagnosis, and refusals that leave it alone; effects by the joints' names."""
    monkeypatch.setenv("HDAGEN_BUILD", str(build(FOUR).folder.parent))
    monkeypatch.chdir(tmp_path)
    Path("robot.toml").write_text(FOUR)
    cause = {"effect": "coulomb_friction", "joint": 3, "parameters": {"coulomb_friction": {"value": 0.5}}}
    content = {"schema": 2, "verdict": ["coulomb_friction@3"], "causes": [cause]}
    Path("diagnosis.json").write_text(json.dumps(content | {"parameters": {"mass_2": {"value": 2.0, "std": 0.1}}}))
    found = ("--with", "diagnosis.json", "--json")
    for format in ("mjcf", "urdf"):
        mine, new = f"mine.{FORMATS[format].ending[1:]}", f"new{FORMATS[format].ending}"
        assert main(["export", format, "robot.toml", "--out", mine]) == 0
        before = Path(mine).read_bytes()
        capsys.readouterr()
        assert main(["export", format, "robot.toml", *found, "--into", mine, "--out", new]) == 0
        said = json.loads(capsys.readouterr().out)
        changed = {change["where"]: change["after"] for change in said["changes"]}
        assert set(changed) == {"axis_2.mass", "axis_3.frictionloss"} and changed["axis_3.frictionloss"] == 0.5
        assert not said["left_out"] and Path(mine).read_bytes() == before
        table = come_back(Path(new))
        assert table["joint"][1]["mass"] == pytest.approx(changed["axis_2.mass"], rel=EXACT)
        assert table["joint"][2]["drive"]["coulomb_friction"] == 0.5
    assert main(["export", "urdf", "robot.toml", *found, "--into", "mine.xml", "--out", "no.urdf"]) == 2
    assert "is no URDF; export mjcf" in capsys.readouterr().err and not Path("no.urdf").exists()


def test_every_turn_is_roll_pitch_and_yaw_to_the_last_digit() -> None:
    """Right angles of pitch included, where roll and yaw are one turn."""

    def turn(axis: int, angle: float) -> np.ndarray:
        quaternion = np.zeros(4)
        quaternion[0], quaternion[axis] = np.cos(angle / 2), np.sin(angle / 2)
        return make_rotation(tuple(quaternion))

    rng = np.random.default_rng(5)
    turns = [*rng.normal(size=(100, 4)), [1, 0, 1, 0], [1, 1, 1, 1], [1, -1, 1, 1], [0, 1, 0, 1]]
    for off in (1e-5, 1e-8, 1e-12):  # of a pitch of a right angle
        turns += [np.array([1, 0, -1, 0]) + off * rng.normal(size=4) for _ in range(20)]
    for stated in turns:
        unit = np.asarray(stated) / np.linalg.norm(stated)
        roll, pitch, yaw = find_roll_pitch_yaw(tuple(unit))
        made = turn(3, yaw) @ turn(2, pitch) @ turn(1, roll)
        assert made == pytest.approx(make_rotation(tuple(unit)), abs=1e-15)
