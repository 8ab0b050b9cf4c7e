"""A measured input is taken between rows as it acted there: held by a slow loop, gone on under a fast one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from replayed import FLEXIBLE, simulated

from gen.effects import ALL
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.inference.linear_gaussian import CrossProducts
from hdagen.diagnosis.inference.linear_model import LinearModel
from hdagen.diagnosis.inference.marginal_likelihood import TORQUE_GRID, compute_posteriors
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.rollout import Rollout
from hdagen.diagnosis.inference.sensitivities import (
    count_torque_steps,
    measure_input_noise,
    measure_input_uncertainty,
    measure_torque_units,
)
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import InitialGuess, guess_from_log
from hdagen.diagnosis.search.null_model import fit_without_effects
from hdagen.log.measured_log import Log
from hdagen.prediction.driving_inputs import read_driving_inputs
from hdagen.prediction.input_interpolation import judge_interpolation
from hdagen.prediction.window_replay import replay

PERIOD = 0.01  # s between rows
STEP, NOISE = 1e-4, 0.2  # rad of the encoder, N m of the torque's sensor
DIRECT = f"""name = "heavy joint"
gravity = [0, 0]
[[joint]]
length = 0.5
mass = 10
center_of_mass = 0
inertia = 8
[joint.drive]
rigid = true
ratio = 1
motor_inertia = 0.01
viscous_friction = 30
coulomb_friction = 20
[joint.sensor]
joint_encoder_resolution = {STEP}
"""


@pytest.fixture(scope="module")
def heavy(build: Callable) -> Arm:
    return Arm(build(DIRECT).folder)


def looped(arm: Arm, loops_a_row: int, seconds: float = 16.0) -> Log:
    """The log of a position loop that runs ``loops_a_row`` times between two rows, torque as it is measured."""
    rng = np.random.default_rng(0)
    h = PERIOD / loops_a_row
    x, torque, kept = np.zeros(arm.nx), 0.0, []
    place, speed = arm.index("joint_position_1"), arm.index("joint_velocity_1")
    for k in range(round(seconds / h)):
        if k % loops_a_row == 0:
            kept.append((torque + NOISE * rng.standard_normal(), STEP * round(x[place] / STEP)))
        goal = 0.6 * np.sin(2 * np.pi * 0.35 * k * h) + 0.3 * np.sin(2 * np.pi * 0.9 * k * h)
        torque = 4000.0 * (goal - x[place]) - 300.0 * x[speed]
        x = arm.step(x, [torque, 0.0, 0.0], h, exact=True)
    read = np.array(kept).T
    return Log(PERIOD * np.arange(len(kept)), {"motor_torque_1": read[0], "joint_position_1": read[1]}, 1, "looped")


def error(arm: Arm, log: Log) -> float:
    return replay(arm, log).errors["joint_position_1"]


def test_a_fast_loops_torque_goes_on_between_rows(heavy: Arm) -> None:
    log = looped(heavy, 5)
    assert not judge_interpolation(heavy, log, 1, log["motor_torque_1"]).is_held
    inputs, notes = read_driving_inputs(heavy, log, "command")
    torque = log["motor_torque_1"]
    assert inputs[:-1, 0] == pytest.approx((torque[1:] + torque[:-1]) / 2)
    assert "on a straight line from row to row (held, the motion leaves" in notes[0]
    held = {"motor_torque_command_1": np.append(torque[1:], torque[-1]), "joint_position_1": log["joint_position_1"]}
    assert error(heavy, log) < error(heavy, Log(log.time, held, 1, "held")) / 2
    assert np.array_equal(replay(heavy, log).columns["motor_torque_1"], torque)


def test_a_slow_loops_torque_is_held_between_rows(heavy: Arm) -> None:
    log = looped(heavy, 1)
    assert judge_interpolation(heavy, log, 1, log["motor_torque_1"]).is_held
    inputs, notes = read_driving_inputs(heavy, log, "command")
    assert np.array_equal(inputs[:-1, 0], log["motor_torque_1"][1:])
    assert "as what acted before its row" in notes[0]


def test_what_a_robot_file_does_not_know_changes_neither(heavy: Arm, build: Callable) -> None:
    """The judge needs no model that is right: here friction is left out and the inertia is off by a third."""
    without = Arm(build(DIRECT.replace("= 30", "= 0").replace("= 20", "= 0").replace("= 8", "= 6")).folder)
    for loops in (1, 5):
        log = looped(heavy, loops)
        assert judge_interpolation(without, log, 1, log["motor_torque_1"]).is_held is (loops == 1)


def test_a_command_that_is_logged_tells(build: Callable) -> None:
    arm = Arm(build(FLEXIBLE).folder)
    log = simulated(arm)
    current, command = log["motor_current_1"], log["motor_current_command_1"]
    assert judge_interpolation(arm, log, 1, current).is_held
    ahead = np.append(command[1:], command[-1])  # a loop that runs faster than it is logged has come half a row further
    later = Log(log.time, {**log.columns, "motor_current_1": (command + ahead) / 2}, 2, "later")
    assert not judge_interpolation(arm, later, 1, later["motor_current_1"]).is_held


def test_of_a_measured_input_no_effect_of_commands_is_asked(build: Callable) -> None:
    arm = Arm(build(FLEXIBLE, effects=tuple(effect.name for effect in ALL)).folder)
    log = simulated(arm)
    only = Log(log.time, {n: v for n, v in log.columns.items() if n != "motor_current_command_1"}, 2, "measured")
    seen = cut_windows(arm, LogPortion.all_rows(only), 0.05)
    assert seen.joints_without_command == (1,)
    names = {atom.name for atom in build_candidates(arm, InitialGuess({}, {}, {}), seen.joints_without_command).members}
    assert "command_delay@2" in names and not names & {"command_delay@1", "current_loop_lag@1"}
    late = arm.p.copy()
    late[list(arm.parameters.described).index("command_delay_1")] = 5e-3
    shooting = MultipleShooting(arm, seen)
    inputs = np.empty((len(log), arm.nu))
    lane = Rollout(late, shooting.measured_initial_states(late))
    shooting._fill_inputs(shooting._prepare_lane(lane), slice(None), inputs)
    assert np.array_equal(inputs[:, 0], seen.command[:, 0])


def test_what_is_uncertain_of_a_measured_input_is_the_least_torque_left_unexplained(
    heavy: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = looped(heavy, 5, 4.0)
    shooting = MultipleShooting(heavy, cut_windows(heavy, LogPortion.all_rows(log), 0.25))
    noise = shooting.record.input_noise
    assert noise[0] == pytest.approx(judge_interpolation(heavy, log, 1, log["motor_torque_1"]).uncertainty)
    assert NOISE / np.sqrt(2) < noise[0] < 3 * NOISE
    steps = 25 / count_torque_steps(shooting)
    assert measure_input_uncertainty(shooting) == pytest.approx(noise / measure_torque_units(shooting) / np.sqrt(steps))
    units = measure_torque_units(shooting)
    assert measure_input_noise(shooting) == pytest.approx(measure_input_uncertainty(shooting))
    monkeypatch.setitem(heavy.robot["joints"][0]["sensor"], "current_noise", 5.0 * NOISE)  # more than the rows show
    assert measure_input_noise(shooting) * units == pytest.approx(5.0 * NOISE)
    gram = CrossProducts(np.eye(4)[None], 1, 1)
    for least in (0.0, 0.5, 1e9):
        linear = LinearModel(gram, np.zeros((1, 4)), np.ones(1), np.array([9]), np.zeros(2), least_torque=least)
        for near in (None, 1e-3):
            found = min(one.s for one in compute_posteriors(linear, np.ones(2), near))
            assert found >= min(least, TORQUE_GRID[-1]) and (least > 0 or found < 0.5)
    commanded = {"motor_torque_command_1": log["motor_torque_1"], "joint_position_1": log["joint_position_1"]}
    told = cut_windows(heavy, LogPortion.all_rows(Log(log.time, commanded, 1, "commanded")), 0.25)
    assert told.input_noise.tolist() == [0.0]
    assert measure_input_noise(MultipleShooting(heavy, told)).tolist() == [0.0]  # of a command nothing is read


@pytest.mark.parametrize("slow", [0.0, 0.6, 0.9])
def test_the_stated_noise_of_a_measured_input_is_no_torque_of_the_machine(build: Callable, slow: float) -> None:
    """A slow noise looks like a torque that nothing explains, and rows hardly show it; the robot file states it."""
    rng, noise = np.random.default_rng(1), np.empty(1600)
    value = 0.0
    for k in range(len(noise)):
        value = slow * value + np.sqrt(1.0 - slow**2) * rng.standard_normal()
        noise[k] = 10.0 * NOISE * value
    unexplained = []
    for stated in (0.0, 10.0 * NOISE):
        arm = Arm(build(DIRECT + f"current_noise = {stated}\n").folder)
        log = looped(arm, 5)
        columns = {**log.columns, "motor_torque_1": log["motor_torque_1"] + noise}
        record = cut_windows(arm, LogPortion.all_rows(Log(log.time, columns, 1, "noisy")), 0.25)
        shooting = MultipleShooting(arm, record)
        fit = fit_without_effects(shooting, build_candidates(arm, guess_from_log(arm, record)))
        unexplained.append(float(fit.unexplained_torque[0] * measure_torque_units(shooting)[0]))
    assert unexplained[1] <= 0.5 * unexplained[0]
