"""The realities of `hdagen blind`: the hand-coded drive alone, and the whole simulation against what must hold."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_arms import FLAT, JOINTS, NOTHING, STANDING

import hdagen
from hdagen.blind.realities.arm_reality import ARM_STEP, PERIOD, simulate_world
from hdagen.blind.realities.arm_world import ArmWorld, tilt_gravity
from hdagen.blind.realities.drivetrain import Drivetrain, MaxwellSlip, Springs
from hdagen.blind.realities.effect_sizes import EFFECT_SIZES, UNKNOWN_KINDS
from hdagen.blind.realities.kinematic_lead import compute_kinematic_lead
from hdagen.blind.realities.log_maker import make_arm_log
from hdagen.blind.realities.two_joint_arms import (
    NOMINAL_DRIVE,
    NOMINAL_SENSOR,
    ArmCase,
    TrueEffect,
    TwoJointArm,
    draw_effect_parameters,
    draw_robots,
)
from hdagen.blind.realities.two_joint_motion import Motion, draw_circle_motion, draw_rich_motion
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import replay


def still(rows: int, q: tuple[float, float] = (0.0, 0.0)) -> Motion:
    position = np.tile(q, (rows, 1))
    return Motion(np.arange(rows) * PERIOD, position, np.zeros((rows, 2)), np.zeros((rows, 2)))


def log(
    robot: TwoJointArm,
    motion: Motion,
    effects: tuple[dict[str, dict[str, float]], ...] = NOTHING,
    arm: dict[str, dict[str, float]] | None = None,
) -> dict[str, np.ndarray]:
    return simulate_world(ArmWorld(robot.joints, effects, arm or {}, robot.gravity), robot.joints, motion, 7)


# -- the drive alone --------------------------------------------------------------------------------------------------


def test_the_springs_are_the_inverse_of_the_torsion_law() -> None:
    k, c, kw, cw, ratio = (JOINTS[0][key] for key in KEYS)
    tau = np.concatenate([np.geomspace(1e-6, 1.0, 40), np.linspace(1.0, 140.0, 200)])
    phi = np.arctan(c * tau) / (c * k) + (1 - np.exp(-cw * tau / ratio)) / (cw * ratio * kw)
    springs = Springs(JOINTS[0])
    found = np.array([springs.torque(x) for x in phi])
    stiffness = 1 / (1 / (k * (1 + (c * tau) ** 2)) + np.exp(-cw * tau / ratio) / (ratio**2 * kw))
    assert np.abs((found - tau) / stiffness).max() < 2e-10  # rad; the encoder of the joint steps by 6e-6
    assert [springs.torque(-x) for x in phi] == [-y for y in found]
    beyond = springs.torque(springs.end + 1e-3) - springs.torque(springs.end)
    assert beyond == pytest.approx(1e-3 * springs.end_stiffness, rel=1e-9)


KEYS = (
    "flexspline_stiffness",
    "flexspline_stiffening",
    "wave_generator_stiffness",
    "wave_generator_stiffening",
    "ratio",
)


def test_slip_elements_forget_speed_and_lose_energy() -> None:
    angle = 2e-4
    swing = angle * 6 * np.sin(np.linspace(0, 4 * np.pi, 4001))
    fine, coarse = MaxwellSlip(1.5, angle), MaxwellSlip(1.5, angle)
    loop = np.array([fine.torque(x) for x in swing])
    again = np.array([coarse.torque(x) for x in swing[::2]])
    # the same path in other steps gives the same torques, wherever no element lets go within a step by less than it
    assert np.abs(loop[::2] - again).max() < 1e-2
    assert loop.max() == pytest.approx(1.5) and loop.min() == pytest.approx(-1.5)
    second = slice(2000, None)
    lost = float(np.sum(0.5 * (loop[second][1:] + loop[second][:-1]) * np.diff(swing[second])))
    assert 0.5 * 4 * 1.5 * 6 * angle < lost < 4 * 1.5 * 6 * angle  # a share of the rectangle about the loop


def test_without_effects_the_drive_is_springs_damper_and_viscous_friction() -> None:
    drive = Drivetrain(JOINTS[0], {}, ARM_STEP)
    motor, level, tau = drive.compute_torques(3.0, 20.0, 0.0299, 0.21)
    expected = Springs(JOINTS[0]).torque(0.03 - 0.0299) + NOMINAL_DRIVE["torsional_damping"] * (0.2 - 0.21)
    assert tau == pytest.approx(expected, rel=1e-12) and level == NOMINAL_DRIVE["coulomb_friction"]
    assert motor == pytest.approx(-NOMINAL_DRIVE["viscous_friction"] * 20.0 - tau / 100.0, rel=1e-12)


def test_a_kinematic_error_makes_no_energy() -> None:
    p = {"once": 1e-4, "once_phase": 0.3, "twice": 2e-4, "twice_phase": 1.0, "fourth": 2e-5, "fourth_phase": 2.0}
    drive = Drivetrain(
        JOINTS[0] | {"viscous_friction": 0.0, "torsional_damping": 0.0}, {"kinematic_error": p}, ARM_STEP
    )
    angles = np.linspace(0, 2 * math.pi, 4001)
    q = 0.005  # the motor turns once against a link that stands still
    work = 0.0
    for theta, width in zip(angles[:-1], np.diff(angles), strict=True):
        work += drive.compute_torques(theta + 0.5 * width, 1e-9, q, 0.0)[0] * width
    springs = Springs(JOINTS[0])
    ends = [theta / 100 - q + compute_kinematic_lead(drive.kinematic, theta)[0] for theta in (0.0, 2 * math.pi)]
    paths = [np.linspace(0.0, end, 2001) for end in ends]
    stored = [float(np.trapezoid([springs.torque(x) for x in path], path)) for path in paths]
    assert -work == pytest.approx(stored[1] - stored[0], rel=1e-3)


def test_the_bristle_settles_at_the_level_of_friction() -> None:
    effects = {"presliding_friction": {"share": 0.5, "angle": 0.1, "damping": 0.0}}
    drive = Drivetrain(JOINTS[0], effects, ARM_STEP)
    start, rest, _ = drive.compute_torques(0.0, 0.0, 0.0, 0.0)
    for _ in range(round(1.0 / (50.0 * ARM_STEP))):  # a radian at 50 rad/s, ten times the angle
        motor, _, _ = drive.compute_torques(0.0, 50.0, 0.0, 0.5)
    assert start == 0.0 and rest == pytest.approx(0.5 * NOMINAL_DRIVE["coulomb_friction"])
    assert motor + NOMINAL_DRIVE["viscous_friction"] * 50.0 == pytest.approx(-rest, rel=1e-3)


# -- the whole --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", [FLAT, STANDING], ids=lambda robot: robot.name)
def test_the_generated_model_replays_a_reality_without_effects_at_the_noise(robot: TwoJointArm, tmp_path: Path) -> None:
    """Both simulators share no line, so this holds each to the other."""
    path = tmp_path / "robot.toml"
    path.write_text(robot.toml())
    columns = log(robot, draw_rich_motion(11, 3.0))
    time = columns.pop("time")
    found = replay(hdagen.load_robot(path), Log(time, columns, 2, "reality"))
    for name, noise in found.noise.items():
        # by window: one that starts where friction just holds or just lets go may differ
        error = np.split(found.columns[name] - columns[name], found.starts[1:])
        typical = float(np.median([np.sqrt(np.mean(part**2)) for part in error]))
        assert typical < (3.0 if name.startswith("joint") else 1.3) * noise, name
    assert found.gap < 3.0


@pytest.mark.parametrize("q", [(0.0, 0.0), (0.7, -1.2)])
def test_an_arm_that_is_asked_to_stand_stands(q: tuple[float, float]) -> None:
    columns = log(STANDING, still(300, q))
    for j in (1, 2):
        assert np.ptp(columns[f"joint_position_{j}"]) <= 2 * NOMINAL_SENSOR["joint_encoder_resolution"]
        assert abs(columns[f"joint_position_{j}"][0] - q[j - 1]) < NOMINAL_SENSOR["joint_encoder_resolution"]


def test_a_payload_weighs_what_it_weighs() -> None:
    effects: tuple[dict[str, Any], ...] = ({}, {"payload": {"mass": 0.4}})
    now, before = (log(STANDING, still(2), e)["motor_position_1"][0] / 100 for e in (effects, NOTHING))
    springs = Springs(JOINTS[0])
    added = springs.torque(now) - springs.torque(before)  # of the first joint's springs, N m
    one_count = NOMINAL_SENSOR["motor_encoder_resolution"] / 100 * 16e3
    assert added == pytest.approx(0.4 * 9.81 * (0.15 + 0.17), abs=one_count)


def _kept(name: str, effects: dict[str, dict[str, float]]) -> dict[str, np.ndarray]:
    return log(FLAT, draw_rich_motion(3, 1.0), ({}, effects))


def test_a_delayed_command_acts_when_it_arrives() -> None:
    columns = _kept("delay", {"command_delay": {"time": 1.5e-3}})
    command, current = columns["motor_current_command_2"], columns["motor_current_2"]
    late = current[2:] - command[:-2]  # sampled between the second and the first row before
    assert np.std(late) == pytest.approx(0.01, rel=0.15)
    assert np.std(current[1:] - command[:-1]) > 0.03


def test_a_lagging_current_is_a_first_order_filter_of_its_command() -> None:
    columns = _kept("lag", {"current_loop_lag": {"time": 3e-3}})
    command, current = columns["motor_current_command_2"], columns["motor_current_2"]
    expected = np.zeros(len(command))
    for k in range(1, len(command)):
        expected[k] = command[k - 1] + (expected[k - 1] - command[k - 1]) * math.exp(-PERIOD / 3e-3)
    assert np.std(current - expected) == pytest.approx(0.01, rel=0.15)


def test_a_limit_cuts_the_current_and_nothing_else() -> None:
    columns = _kept("limit", {"current_saturation": {"limit": 1.5}})
    command, current = columns["motor_current_command_2"], columns["motor_current_2"]
    assert np.abs(command).max() > 2.0
    assert np.std(current[1:] - np.clip(command[:-1], -1.5, 1.5)) == pytest.approx(0.01, rel=0.15)


def test_a_late_encoder_shows_the_angle_of_before() -> None:
    true = log(FLAT, draw_rich_motion(3, 1.0))["joint_position_2"]
    late = _kept("late", {"sensor_delay": {"time": 2.25e-3}})["joint_position_2"]
    k = np.arange(3, len(true))
    expected = true[k - 2] + 0.25 * (true[k - 3] - true[k - 2])
    assert np.abs(late[3:] - expected).max() < 3 * NOMINAL_SENSOR["joint_encoder_resolution"]


@pytest.mark.parametrize("j", [0, 1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_wall_stands_at_its_angle(j: int, side: float) -> None:
    wall = {"angle": side * 0.1, "side": side, "stiffness": 1e4, "damping": 0.4}
    effects = tuple({"contact": wall} if k == j else {} for k in range(2))
    time = np.arange(500) * PERIOD
    position = np.zeros((500, 2))
    position[:, j] = side * 0.2 * np.sin(np.pi * time / time[-1] / 2) ** 2
    motion = Motion(time, position, np.asarray(np.gradient(position, PERIOD, axis=0)), np.zeros((500, 2)))
    reached = side * log(FLAT, motion, effects)[f"joint_position_{j + 1}"]
    free = side * log(FLAT, motion)[f"joint_position_{j + 1}"]
    assert free.max() > 0.18 and 0.1 < reached.max() < 0.13
    assert np.abs((reached - free)[reached < 0.09][:100]).max() < 1e-5


@pytest.mark.parametrize(("lowest", "highest"), [(-0.5, 0.4), (-0.02, 0.6), (-0.7, 0.0), (-0.1, 0.05)])
def test_no_arm_begins_in_a_wall_and_every_one_reaches_it(lowest: float, highest: float) -> None:
    ends, size = {"lowest": lowest, "highest": highest}, EFFECT_SIZES["contact"]
    sides = set()
    for seed in range(20):
        wall = size.draw(1.5 * size.typical, np.random.default_rng(seed), ends)
        reach = highest if wall["side"] > 0 else -lowest
        assert 0.0 < wall["side"] * wall["angle"] < reach
        sides.add(wall["side"])
    roomy = {side for side, reach in ((-1.0, -lowest), (1.0, highest)) if reach > 1.5 * size.typical}
    assert sides == (roomy or {-1.0, 1.0})


def test_a_tilted_base_turns_gravity() -> None:
    arm = {"gravity_tilt": {"angle": 0.1, "direction": 0.5}}
    x, y = tilt_gravity(ArmWorld(JOINTS, NOTHING, arm, (0.0, -9.81)))
    assert math.hypot(x, y) == pytest.approx(9.81) and math.atan2(y, x) == pytest.approx(-math.pi / 2 + 0.1)
    x, y = tilt_gravity(ArmWorld(JOINTS, NOTHING, arm, (0.0, 0.0)))
    assert (x, y) == pytest.approx((9.81 * math.sin(0.1) * math.cos(0.5), 9.81 * math.sin(0.1) * math.sin(0.5)))


def lively() -> Motion:
    """A second that covers half a radian either way, with a shake that the transmission feels."""
    time = np.arange(1000) * PERIOD
    shake = 1.5e-3 * np.sin(2 * np.pi * 18.0 * time)
    start = np.clip(time / 0.2, 0.0, 1.0) ** 2
    position = np.column_stack([0.5 * np.sin(2 * np.pi * time) + shake, 0.5 * np.sin(2 * np.pi * time) - shake])
    position *= start[:, None]
    return Motion(time, position, np.asarray(np.gradient(position, PERIOD, axis=0)), np.zeros((1000, 2)))


@pytest.fixture(scope="module")
def quiet() -> dict[str, np.ndarray]:
    return log(FLAT, lively())


CASE = ArmCase("x", "single", FLAT, (), 1.0, 5)  # its background is the typical size of everything
ENDS = {j: {"peak": 4.0, "lowest": -0.02, "highest": 0.02} for j in (1, 2)}


@pytest.mark.parametrize("effect", EFFECT_SIZES)
def test_every_effect_at_its_typical_size_stands_above_the_noise(effect: str, quiet: dict[str, np.ndarray]) -> None:
    joint = {"each": 2, "last": 2, "arm": 0}[EFFECT_SIZES[effect].joints]
    p = {effect: draw_effect_parameters(replace(CASE, truth=(TrueEffect(effect, joint, 1.0),)), ENDS)[effect, joint]}
    if effect == "contact":
        p["contact"] |= {"angle": 0.0, "side": 1.0}
    found = log(FLAT, lively(), ({}, p if joint else {}), {} if joint else p)
    noise = {"motor_current": 0.01, "motor_position": 1.5e-3 / 12**0.5, "joint_position": 6e-6 / 12**0.5}
    seen = max(
        float(np.std(found[f"{name}_{j}"] - quiet[f"{name}_{j}"])) / sd for name, sd in noise.items() for j in (1, 2)
    )
    assert seen > 3.0


@pytest.mark.parametrize("kind", range(len(UNKNOWN_KINDS)), ids=UNKNOWN_KINDS)
def test_every_unknown_torque_stands_above_the_noise(kind: int, quiet: dict[str, np.ndarray]) -> None:
    p = {"kind": kind, "torque": 1.5, "frequency": 3.0, "order": 20.0, "phase": 1.0, "play": 0.02}
    found = log(FLAT, lively(), ({"unknown": p}, {}))
    assert np.std(found["motor_position_1"] - quiet["motor_position_1"]) > 10 * 4.4e-4


def test_the_same_case_is_the_same_to_the_bit() -> None:
    case = ArmCase("x", "background", draw_robots("s")[0], (TrueEffect("backlash", 1, 1.0),), 0.04, 3)
    (one, found, snr), (again, _, _) = (make_arm_log(case, "log", 0.4, None) for _ in range(2))
    assert all(np.array_equal(one[name], again[name]) for name in one) and snr > 1.0
    assert len(found) == 2 * 24 - 3 + 1 - 2  # each effect at both joints; payload at the last, tilt of the arm; no wall
    held, _, _ = make_arm_log(case, "hold_out", 0.4, found)
    assert not np.array_equal(one["joint_position_reference_1"], held["joint_position_reference_1"])


# -- motions ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_rich_motions_start_at_rest_hold_turn_back_and_stay_slow_enough(seed: int) -> None:
    motion = draw_rich_motion(seed)
    v = motion.velocity
    assert np.abs(v[:3]).max() < 1e-2 and np.all(motion.position[0] == 0.0)
    assert np.abs(v).max() <= 3.0 + 1e-9
    standing = np.all(np.abs(v) < 1e-3, axis=1)
    assert 0.6 <= standing.mean() * motion.time[-1] <= 3.0
    assert min(np.count_nonzero(np.diff(np.sign(v[~standing, j]))) for j in (0, 1)) > 20
    assert np.any(motion.force[:, 0]) and np.any(motion.force[:, 1])
    spectrum = np.abs(np.fft.rfft(np.gradient(v[:, 0], PERIOD)))
    frequency = np.fft.rfftfreq(len(v), PERIOD)
    assert spectrum[(frequency > 15) & (frequency < 24)].max() > 20 * np.median(spectrum[frequency > 60])


def test_the_circle_is_one() -> None:
    motion = draw_circle_motion(4, (0.15, 0.17))
    q1, both = motion.position[:, 0], motion.position.sum(axis=1)
    tip = np.stack([0.15 * np.cos(q1) + 0.17 * np.cos(both), 0.15 * np.sin(q1) + 0.17 * np.sin(both)], axis=1)
    middle = 0.5 * (tip.max(axis=0) + tip.min(axis=0))
    assert np.abs(np.linalg.norm(tip - middle, axis=1) - 0.05).max() < 1e-4
    assert [set(np.flatnonzero(motion.force[:, a])) for a in (0, 1)] == [set(range(3000, 4000)), set(range(6000, 7000))]
