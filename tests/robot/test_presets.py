"""The robots that ship with the project: they load, and their numbers are those of their sources."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from planar_links import get_planar_link

from gen.presets import find_presets
from gen.robot.description import Robot
from gen.robot.load_robot import load
from gen.robot.mass_matrix import mass_matrix

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("HDAGEN_DATA", ROOT.parent / "shared" / "data"))
DFKI = ("1.0", "1.1", "2.0", "3.0")


IN_SPACE = ("kinova_gen3", "panda", "so101", "ur5e")


def test_there_are_all_thirteen() -> None:
    paper = {"paper", "paper_table1", "paper_prototype", "paper_three_joints"}
    assert set(find_presets()) == {*paper, "emps", *(f"dfki_{m.replace('.', '_')}" for m in DFKI), *IN_SPACE}
    assert {name for name in find_presets() if load(name).in_space} == set(IN_SPACE)


@pytest.mark.parametrize("name", find_presets())
def test_a_preset_loads_with_the_effects_there_are(name: str) -> None:
    robot = load(name)
    assert robot.source.stem == name
    assert load(str(robot.source)).joints == robot.joints


def test_loading_without_effects_leaves_casadi_alone() -> None:
    check = "import sys; from gen.robot.load_robot import load; load('paper'); sys.exit('casadi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", check], cwd=ROOT, check=False).returncode == 0


@pytest.mark.parametrize("file", sorted(DATA.glob("made/*/*/robot.toml")) or [None])
def test_the_robots_of_the_made_logs_load(file: Path | None) -> None:
    if file is None:
        pytest.skip("the made logs lie neither in $HDAGEN_DATA nor in ../shared/data")
    robot = load(file)
    assert robot.name == "dual-joint harmonic-drive arm" and robot.slug == "dual_joint_harmonic_drive_arm"
    assert [joint.mass.nominal for joint in robot.joints] == [1.6, 0.9]
    assert all(joint.drive.wave_generator_stiffness.nominal == 2.5517 for joint in robot.joints)  # type: ignore[union-attr]


def test_paper_is_the_robot_of_the_made_logs() -> None:
    file = next(iter(sorted(DATA.glob("made/single/*/robot.toml"))), None)
    if file is None:
        pytest.skip("the made logs lie neither in $HDAGEN_DATA nor in ../shared/data")
    preset, made = load("paper"), load(file)
    for ours, theirs in zip(preset.joints, made.joints, strict=True):
        assert (ours.mass, get_planar_link(ours), ours.sensor) == (theirs.mass, get_planar_link(theirs), theirs.sensor)
        drive = {**vars(ours.drive), "hysteresis_loss": None}  # the made robot files state no loss
        assert drive == vars(theirs.drive)


# -- paper_table1 -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def table_1() -> Robot:
    return load("paper_table1")


def _stiffness_at_rest(robot: Robot) -> float:
    d = robot.joints[0].drive
    assert d.flexspline_stiffness and d.wave_generator_stiffness
    wave = d.ratio.nominal**2 * d.wave_generator_stiffness.nominal
    return 1 / (1 / d.flexspline_stiffness.nominal + 1 / wave)


def test_table_1_resonates_at_18_5_hz(table_1: Robot) -> None:
    drive = table_1.joints[0].drive
    rotor = drive.ratio.nominal**2 * drive.motor_inertia.nominal
    arm = get_planar_link(table_1.joints[0]).inertia.nominal
    K = _stiffness_at_rest(table_1)
    assert pytest.approx(7051, abs=0.5) == K
    assert math.sqrt(K * (1 / arm + 1 / rotor)) / (2 * math.pi) == pytest.approx(18.5, abs=0.05)
    assert math.sqrt(1e4 * (1 / arm + 1 / rotor)) / (2 * math.pi) == pytest.approx(
        22.0, abs=0.05
    )  # K_f = 10,000, rigid


def test_table_1_damping_is_5_percent_of_critical(table_1: Robot) -> None:
    drive = table_1.joints[0].drive
    assert drive.torsional_damping
    inertia = 1 / (
        1 / get_planar_link(table_1.joints[0]).inertia.nominal
        + 1 / (drive.ratio.nominal**2 * drive.motor_inertia.nominal)
    )
    assert drive.torsional_damping.nominal / (2 * math.sqrt(_stiffness_at_rest(table_1) * inertia)) == pytest.approx(
        0.05, abs=0.001
    )


def test_table_1_inertia_about_each_joint_gives_torques_of_1_4_to_1(table_1: Robot) -> None:
    """Equal motor torques, slow against the resonance: joint torques τ = M q̈ with (M + N² J_m) q̈ = N τ_m."""
    M = mass_matrix(table_1.joints, np.array([[0.0, 0.7]]))[0]
    np.testing.assert_allclose(M, np.array([[2, 1], [1, 1]]) * 0.876, rtol=1e-12)
    rotors = np.diag([j.drive.ratio.nominal**2 * j.drive.motor_inertia.nominal for j in table_1.joints])
    torque = M @ np.linalg.solve(M + rotors, np.ones(2))
    assert torque[0] / torque[1] == pytest.approx(1.4, abs=0.05)


# -- machines that were measured --------------------------------------------------------------------------------------


def test_emps_balances_forces_as_published() -> None:
    robot = load("emps")
    (joint,), (bias,) = robot.joints, robot.effects
    assert (bias.name, bias.joint) == ("current_bias", 1) and joint.kind == "prismatic" and joint.drive.rigid
    assert joint.drive.torque_constant is None and joint.drive.ratio.nominal == 1
    speed, acceleration = 0.1, -0.4
    inertia = mass_matrix(robot.joints, np.zeros((1, 1)))[0, 0, 0]
    friction = joint.drive.viscous_friction.nominal * speed + joint.drive.coulomb_friction.nominal * np.sign(speed)
    force = (
        inertia * acceleration + friction - bias.parameters["bias"].nominal
    )  # the bias is added to the motor's torque
    assert force == pytest.approx(95.1089 * acceleration + 203.5034 * speed + 20.3935 + (-3.1648), rel=1e-12)


@pytest.mark.parametrize("model", DFKI)
def test_dfki_is_its_published_model(model: str) -> None:
    folder = DATA / "real/dfki_double_pendulum/system_identification/identified_parameters/design_C.1"
    file = folder / f"model_{model}" / "model_parameters.yml"
    if not file.exists():
        pytest.skip("the double pendulum's models lie neither in $HDAGEN_DATA nor in ../shared/data")
    p = {name: float(number) for name, number in (line.split(": ") for line in file.read_text().splitlines() if line)}
    robot = load(f"dfki_{model.replace('.', '_')}")
    assert [v.nominal for v in robot.gravity] == [p["g"], 0]
    for j, joint in enumerate(robot.joints, 1):
        d, q = joint.drive, 0.3  # q: joint speed, rad/s
        level, viscous = d.ratio.nominal * d.coulomb_friction.nominal, d.ratio.nominal**2 * d.viscous_friction.nominal
        assert level + viscous * q == pytest.approx(math.pi / 2 * p[f"cf{j}"] + p[f"b{j}"] * q, rel=1e-12)
        assert joint.limits.torque == p[f"tl{j}"] and d.torque_constant is None and d.rigid
    if p["Ir"]:  # at rest the smooth sign is as steep as arctan(100 q̇)
        d = robot.joints[0].drive
        slope = d.coulomb_friction.nominal / d.friction_smoothing.nominal * d.ratio.nominal**2
        assert slope == pytest.approx(100 * p["cf1"], rel=1e-12)
    for angle in (0.0, 1.0, 3.0):
        assert _with_coupling(robot, angle) == pytest.approx(_published_mass_matrix(p, angle), rel=1e-12)


def _with_coupling(robot: Robot, angle: float) -> np.ndarray:
    """M with rotor 2 riding on link 1: ½ J (N q̇2 + coupling q̇1)² in place of ½ J (N q̇2)²."""
    M = mass_matrix(robot.joints, np.array([[0.0, angle]]))[0]
    drive = robot.joints[1].drive
    for effect in robot.effects:
        coupling = effect.parameters["coupling"].nominal
        assert (effect.name, effect.joint) == ("rotor_coupling", 2)
        M = M + drive.motor_inertia.nominal * np.array(
            [[coupling**2, coupling * drive.ratio.nominal], [coupling * drive.ratio.nominal, 0]]
        )
    return M


def _published_mass_matrix(p: dict[str, float], angle: float) -> np.ndarray:
    cross, gear = p["m2"] * p["l1"] * p["r2"] * math.cos(angle), p["gr"]
    first = p["I1"] + p["I2"] + p["m2"] * p["l1"] ** 2 + 2 * cross + gear**2 * p["Ir"] + p["Ir"]
    off = p["I2"] + cross - gear * p["Ir"]
    return np.array([[first, off], [off, p["I2"] + gear**2 * p["Ir"]]])
