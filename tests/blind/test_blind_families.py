"""The families of realities: each against energy, closed forms, the generated model, itself from the same seed, and the
noise."""

from __future__ import annotations

import io
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_arms import FLAT, JOINTS, NOTHING, STANDING

import hdagen
from hdagen.blind.realities import log_maker
from hdagen.blind.realities.arm_world import ArmWorld
from hdagen.blind.realities.cases import draw_cases
from hdagen.blind.realities.effect_sizes import EFFECT_SIZES
from hdagen.blind.realities.joint_arm_reality import ChainJoint, ChainSimulation, simulate_chain
from hdagen.blind.realities.joint_arms import JointArmCase
from hdagen.blind.realities.joint_effects import JOINT_EFFECTS
from hdagen.blind.realities.log_noise import choose_kept_rows, color_noise
from hdagen.blind.realities.maxwell_drive import LawTable, MaxwellDrive
from hdagen.blind.realities.maxwell_motion import draw_point_moves
from hdagen.blind.realities.maxwell_reality import MAXWELL_STEP, MaxwellSimulation, simulate_arm
from hdagen.blind.realities.misstated_numbers import NUMBER_RANGES
from hdagen.blind.realities.population import (
    FAMILIES,
    JOINT,
    KINDS_OF_FAMILY,
    MAXWELL,
    Population,
    read_population,
)
from hdagen.blind.realities.two_joint_arms import (
    NOMINAL_SENSOR,
    ArmCase,
    TwoJointArm,
    draw_true_parameters,
)
from hdagen.blind.realities.two_joint_motion import PERIOD, Motion
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import replay

LOSSLESS = {"viscous_friction": 0.0, "coulomb_friction": 0.0, "torsional_damping": 0.0}


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def still(rows: int) -> Motion:
    return Motion(np.arange(rows) * PERIOD, *np.zeros((3, rows, 2)))


def maxwell_log(robot: TwoJointArm, motion: Motion, effects: Any = NOTHING) -> dict[str, np.ndarray]:
    return simulate_arm(ArmWorld(robot.joints, effects, {}, robot.gravity), robot.joints, motion, 7)


# -- what is drawn ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("family", "kind"), [(f, k) for f in FAMILIES for k in KINDS_OF_FAMILY[f]])
def test_a_seed_draws_the_same_cases_and_another_seed_or_family_does_not(family: str, kind: str) -> None:
    population = Population(kind, family)
    few, many = draw_cases("seed", population, 1), draw_cases("seed", population, 2)
    assert [one.label() for one in many[:1]] == [one.label() for one in few]
    names = {one.name for one in many}
    assert len(names) == 2 and names.isdisjoint(one.name for one in draw_cases("other", population, 2))
    other = FAMILIES[FAMILIES.index(family) - 1]
    if kind in KINDS_OF_FAMILY[other] and kind != "joint":
        assert names.isdisjoint(one.name for one in draw_cases("seed", Population(kind, other), 2))


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("background", [None, 0.0, 0.02, 0.08])
def test_the_background_is_the_one_that_is_asked_for(family: str, background: float | None) -> None:
    found = [one.label()["background"] for one in draw_cases("seed", Population("single", family, background), 3)]
    assert found == [background or 0.0] * 3
    none = [one.label()["background"] for one in draw_cases("seed", Population("none", family, background), 4)]
    assert none == ([0.0, 0.04, 0.0, 0.04] if background is None else [background] * 4)


@pytest.mark.parametrize("family", FAMILIES)
def test_files_are_wrong_in_the_numbers_of_the_label_and_in_no_other(family: str) -> None:
    cases = draw_cases("seed", Population("rough", family), 12)
    assert 0 < sum(bool(one.label()["verdict"][len(one.label()["numbers"]) :]) for one in cases) < 12
    for case in cases:
        assert isinstance(case, ArmCase | JointArmCase)
        numbers = dict(case.label()["numbers"])
        assert 1 <= len(numbers) <= 4 and set(numbers).isdisjoint(str(one) for one in case.truth)
        for j, (stated, right) in enumerate(zip(case.robot.joints, case.machine.joints, strict=True), 1):
            for key in stated:
                names = [name for name, limits in NUMBER_RANGES.items() if limits.key == key]
                factor = numbers.pop(f"{names[0]}@{j}", 1.0) if names else 1.0
                assert right[key] == pytest.approx(factor * stated[key], rel=1e-12)
                if factor != 1.0:
                    limits = NUMBER_RANGES[names[0]]
                    assert limits.low <= max(factor, 1.0 / factor) <= limits.high
        assert not numbers


def test_a_machine_scatters_about_its_right_numbers() -> None:
    case = draw_cases("seed", Population("rough", MAXWELL), 1)[0]
    assert isinstance(case, ArmCase)
    for true, right in zip(draw_true_parameters(case.machine, case.seed), case.machine.joints, strict=True):
        assert all(abs(true[key] - right[key]) <= 0.1001 * abs(right[key]) for key in right)


def test_a_request_that_is_older_than_the_families_is_read() -> None:
    assert read_population({"kind": "single"}) == Population("single")
    assert read_population({"kind": "joint"}).family == JOINT and Population("joint", JOINT).name == "joint"
    assert Population("single", MAXWELL, 0.08).name == "maxwell single 0.08"
    stated = {"kind": "none", "family": MAXWELL, "background": 0.0}
    assert read_population(stated) == Population("none", MAXWELL, 0.0)


@pytest.mark.parametrize("elastic", [True, False])
def test_a_robot_file_of_joints_can_be_read(elastic: bool, tmp_path: Path) -> None:
    from gen.robot.load_robot import load

    cases = draw_cases("seed", Population("none", JOINT), 12)
    case = next(one for one in cases if isinstance(one, JointArmCase) and (one.robot.encoder == "motor") == elastic)
    path = tmp_path / "robot.toml"
    path.write_text(case.robot.toml())
    assert len(load(path).joints) == len(case.robot.joints)


# -- the family "maxwell" ---------------------------------------------------------------------------------------------


def test_springs_are_the_inverse_of_the_torsion_law() -> None:
    keys = ("flexspline_stiffness", "flexspline_stiffening", "wave_generator_stiffness", "wave_generator_stiffening")
    (k, c, kw, cw), ratio = (JOINTS[0][key] for key in keys), JOINTS[0]["ratio"]
    tau = np.concatenate([np.geomspace(1e-4, 1.0, 30), np.linspace(1.0, 140.0, 90)])
    phi = np.arctan(c * tau) / (c * k) + (1 - np.exp(-cw * tau / ratio)) / (cw * ratio * kw)
    table = LawTable(JOINTS[0])
    found = np.array([table.read_torque(x) for x in phi])
    assert np.abs(found - tau).max() < 2e-3 and np.abs(found - tau)[tau < 10.0].max() < 1e-4
    assert [table.read_torque(-x) for x in phi] == [-y for y in found]


def test_without_losses_energy_stays_and_with_friction_it_only_falls() -> None:
    """The arm falls freely, with motors that the springs drag along, and rings from springs that were bent."""

    def fall(changes: Mapping[str, float]) -> tuple[np.ndarray, float]:
        joints = [{**joint, **changes} for joint in JOINTS]
        one = MaxwellSimulation(ArmWorld(joints, NOTHING, {}, (0.0, -9.81)), joints, still(1))
        one.commands = [type(row)([0.0] * len(row), maxlen=row.maxlen) for row in one.commands]
        one.q[0], one.q[1] = one.q[0] + 1e-3, one.q[1] - 2e-3
        energy, springs = [], []
        for n in range(150):
            stored = 0.0
            for j, drive in enumerate(one.drives):
                phi = one.theta[j] / drive.ratio - one.q[j]
                path = np.linspace(0.0, phi, 60)
                stored += float(np.trapezoid([drive.law.read_torque(x) for x in path], path))
            springs.append(stored)
            energy.append(one.compute_energy() + stored)
            for _ in range(25):
                one.advance_step(n * 25 * MAXWELL_STEP, 0, (0.0, 0.0))
        return np.array(energy), float(np.ptp(springs))

    free, exchanged = fall(LOSSLESS)
    assert exchanged > 5e-3 and np.abs(free - free[0]).max() < 0.02 * exchanged
    lossy, _ = fall({"torsional_damping": 20.0, "coulomb_friction": 1e-3})
    assert np.diff(lossy).max() < 1e-4 * exchanged and lossy[-1] < lossy[0] - 0.5 * exchanged


def test_a_rotor_that_is_pushed_less_than_it_sticks_stands_exactly() -> None:
    columns = maxwell_log(STANDING, still(200))
    for j in (1, 2):
        assert np.ptp(columns[f"motor_position_{j}"]) == 0.0
        assert np.ptp(columns[f"joint_position_{j}"]) <= 2 * NOMINAL_SENSOR["joint_encoder_resolution"]


def test_slip_elements_reach_the_level_and_dahl_s_loop_its_torque() -> None:
    effects = {
        "presliding_friction": {"share": 0.5, "angle": 0.1, "damping": 0.0},
        "transmission_hysteresis": {"torque": 1.5, "angle": 2e-4},
    }
    drive = MaxwellDrive(JOINTS[0] | LOSSLESS | {"coulomb_friction": 0.04}, effects, MAXWELL_STEP)
    start = drive.compute_torques(0.0, 0.0, 0.0, 0.0)
    assert start[0] == 0.0 and start[1:3] == (0.02, 0.02)
    theta = 0.0
    for _ in range(600):
        theta += 50.0 * MAXWELL_STEP
        motor, ahead, _, tau = drive.compute_torques(theta, 50.0, 0.0, 0.5)
    bare = LawTable(JOINTS[0]).read_torque(theta / 100.0)
    assert tau - bare == pytest.approx(1.5, rel=1e-6) and ahead == pytest.approx(0.02)
    assert motor + tau / 100.0 == pytest.approx(-0.02, rel=1e-6)


def test_a_late_command_and_a_lagging_current_follow_their_closed_forms() -> None:
    motion = draw_point_moves(3, 0.6)

    def simulate(effects: Mapping[str, Mapping[str, float]]) -> tuple[np.ndarray, np.ndarray]:
        world = ArmWorld(JOINTS, ({}, effects), {}, (0.0, 0.0))
        rows = MaxwellSimulation(world, JOINTS, motion).simulate_rows()
        return rows["motor_current_command_2"], rows["motor_current_2"]

    command, current = simulate({"command_delay": {"time": 1.5e-3}})
    assert np.array_equal(current[3:], command[1:-2])
    command, current = simulate({"current_loop_lag": {"time": 3e-3}})
    expected = current[:1].tolist()
    for asked in command[:-1]:
        expected.append(asked + (expected[-1] - asked) * math.exp(-PERIOD / 3e-3))
    assert np.abs(current - expected).max() < 1e-9
    command, current = simulate({"current_saturation": {"limit": 0.8}})
    assert np.array_equal(current[1:], np.clip(command[:-1], -0.8, 0.8)) and np.abs(command).max() > 1.0


@pytest.mark.parametrize("robot", [FLAT, STANDING], ids=lambda robot: robot.name)
def test_the_generated_model_replays_it_without_effects_at_the_noise(robot: TwoJointArm, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(robot.toml())
    rows = MaxwellSimulation(
        ArmWorld(robot.joints, NOTHING, {}, robot.gravity), robot.joints, draw_point_moves(11, 2.5)
    )
    columns = rows.simulate_rows()
    found = replay(hdagen.load_robot(path), Log(rows.motion.time, columns, 2, "reality"))
    for name, noise in found.noise.items():
        error = np.split(found.columns[name] - columns[name], found.starts[1:])
        typical = float(np.median([rms(part) for part in error]))
        assert typical < (3.0 if name.startswith("joint") else 1.3) * noise, name


def test_a_log_has_its_noise_its_jitter_and_its_losses() -> None:
    rng = np.random.default_rng(1)
    noise = color_noise(rng, 100_000)
    assert rms(noise) == pytest.approx(1.0, rel=0.02)
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(0.6, abs=0.02)
    kept = choose_kept_rows(rng, 100_000)
    assert 0.003 < 1.0 - kept.mean() < 0.02 and kept[:2].all() and kept[-2:].all()
    motion = draw_point_moves(5, 1.0)
    columns = maxwell_log(FLAT, motion)
    time = columns["time"]
    assert len({len(one) for one in columns.values()}) == 1 and np.all(np.diff(time) > 0.0)
    assert np.abs(time / PERIOD - np.round(time / PERIOD)).max() <= 0.031
    same, other = maxwell_log(FLAT, motion), maxwell_log(FLAT, draw_point_moves(6, 1.0))
    assert all(np.array_equal(columns[name], same[name]) for name in columns)
    assert not np.array_equal(columns["motor_position_1"], other["motor_position_1"])


def test_motions_from_point_to_point_are_slow_enough_and_turn_back() -> None:
    for seed in range(4):
        motion = draw_point_moves(seed, 10.0)
        assert np.abs(motion.velocity).max() <= 3.0 + 1e-9 and np.abs(motion.position).max() < 0.8
        assert np.abs(motion.position[0]).max() < 1e-9
        assert min(np.count_nonzero(np.diff(np.sign(v[500:]))) for v in motion.velocity.T) > 20


@pytest.mark.parametrize("name", [*EFFECT_SIZES, "unknown"])
def test_every_effect_of_the_arms_of_another_simulator_stands_above_the_noise(name: str) -> None:
    """At its least size, in a second."""
    cases = draw_cases("noise", Population("unknown" if name == "unknown" else "single", MAXWELL), len(EFFECT_SIZES))
    case = next(one for one in cases if isinstance(one, ArmCase) and one.truth[0].effect == name)
    least = replace(case, truth=(replace(case.truth[0], size=0.5),))
    snr = log_maker.make_arm_log(least, "log", 1.2, None)[2]
    assert snr > 3.0


# -- the family "joint" -----------------------------------------------------------------------------------------------


def joint_case(name: str, kind: str = "single") -> JointArmCase:
    cases = draw_cases("noise", Population(kind, JOINT), len(JOINT_EFFECTS))
    return next(one for one in cases if isinstance(one, JointArmCase) and one.truth[0].effect == name)


@pytest.mark.parametrize("name", [*JOINT_EFFECTS, "unknown"])
def test_every_effect_of_joints_stands_above_the_noise(name: str) -> None:
    case = joint_case(name, "unknown" if name == "unknown" else "single")
    least = replace(case, truth=(replace(case.truth[0], size=0.5),))
    log, found, snr = log_maker.make_chain_log(least, "log", 2.5, None)
    assert snr > 3.0 and (name, case.truth[0].joint) in found
    assert all(np.isfinite(column).all() for column in log.values())
    angles = [log[f"{case.robot.encoder}_position_{j}"] for j in range(1, len(case.robot.joints) + 1)]
    assert all(0.02 < np.ptp(angle) < 6.0 for angle in angles)


def test_the_same_case_of_joints_is_the_same_to_the_bit_and_the_hold_out_another() -> None:
    case = joint_case("payload")
    found = case.effect_parameters(1.0)
    one, again = (simulate_chain(case, "log", 1.0, found) for _ in range(2))
    assert list(one) == list(again) and all(np.array_equal(one[name], again[name]) for name in one)
    held = simulate_chain(case, "hold_out", 1.0, found)
    name = f"{case.robot.encoder}_position_1"
    assert not np.array_equal(one[name][:300], held[name][:300])


@pytest.mark.parametrize("elastic", [True, False])
def test_a_chain_without_losses_keeps_its_energy(elastic: bool) -> None:
    """MuJoCo's own energy of links and rotors, and the springs' beside it, while the chain falls freely."""
    cases = draw_cases("seed", Population("none", JOINT, 0.0), 20)
    case = next(one for one in cases if isinstance(one, JointArmCase) and (one.robot.encoder == "motor") == elastic)
    lossless = {"coulomb_friction": 0.0, "viscous_friction": 0.0}
    if elastic:
        lossless["torsional_damping"] = 0.0
    robot = replace(case.robot, joints=tuple({**joint, **lossless} for joint in case.robot.joints))
    one = ChainSimulation(replace(case, robot=robot), "log", 0.01, {})
    one.model.opt.enableflags |= 2  # mjENBL_ENERGY
    one.command = [0.0] * len(one.command)
    for row in one.inputs:
        row.extend([0.0] * len(row))
    energy, moving = [], []
    for n in range(3000):
        before = one.data.qvel.copy()
        one._advance_step(n * 1e-4)
        if n % 50:
            continue
        middle = 0.5 * (before + one.data.qvel)
        kept = one.data.qvel.copy()
        one.data.qvel[:] = middle
        import mujoco

        mujoco.mj_energyPos(one.model, one.data)
        mujoco.mj_energyVel(one.model, one.data)
        one.data.qvel[:] = kept
        springs = 0.0
        for j, (joint, dof) in enumerate(zip(one.joints, one.drive_dof, strict=True)):
            if one.soft[j]:
                path = np.linspace(0.0, one.data.qpos[dof] - one.data.qpos[j], 60)
                springs += float(np.trapezoid([joint.spring_torque(x, 0.0) for x in path], path))
        energy.append(float(one.data.energy.sum()) + springs)
        moving.append(float(one.data.energy[1]))
    assert np.ptp(energy) < 0.03 * max(moving)


def test_a_spring_carries_what_it_is_bent_by() -> None:
    case = next(
        one
        for one in draw_cases("seed", Population("none", JOINT), 20)
        if isinstance(one, JointArmCase) and one.robot.encoder == "motor"
    )
    joint = ChainJoint(case.robot.joints[0], {}, 1.0)
    for torque in (-3.0, 0.5, 4.0):
        assert joint.spring_torque(joint.rest_torsion(torque), 0.0) == pytest.approx(torque, rel=1e-12)
    stiff = joint.spring_torque(1e-9, 0.0) / 1e-9
    assert stiff == pytest.approx(case.robot.joints[0]["flexspline_stiffness"], rel=1e-6)


# -- who knows the truth ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("family", "index"), [(MAXWELL, 0), (JOINT, 1), ("drivetrain", 2)])
def test_the_child_tells_the_truth_by_pipe_alone(
    family: str, index: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The log names columns alone; the hold-out is of the same reality as the log."""
    request = {"seed": "s", "kind": "rough", "family": family, "index": index, "motion": "log", "seconds": 0.3}
    request["out"] = str(tmp_path / "a.parquet")
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps(request)))
    log_maker.main()
    told = json.loads(capsys.readouterr().out)
    label = draw_cases("s", read_population(request), index + 1)[-1].label()
    assert set(label["verdict"]) <= set(told["parameters"])
    for name, factor in label["numbers"].items():
        assert told["parameters"][name] == {"factor": factor}
    request |= {"motion": "hold_out", "truth": told["parameters"], "out": str(tmp_path / "b.parquet")}
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps(request)))
    log_maker.main()
    again = json.loads(capsys.readouterr().out)
    assert again["parameters"] == told["parameters"] and again["snr"] == 0.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.parquet", "b.parquet"]
    for path in tmp_path.iterdir():
        text = path.read_bytes()
        assert not any(word.encode() in text for word in ("factor", "rough", "maxwell", "drivetrain"))
