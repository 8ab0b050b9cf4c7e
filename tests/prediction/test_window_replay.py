"""Replay: nothing measured inside a window counts, and a true model meets the noise of the sensors."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from replayed import FLEXIBLE, HYSTERESIS, MEMORY, RIGID, multiples, simulated, spoilt

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.driving_inputs import read_driving_inputs
from hdagen.prediction.measurement_model import Readings
from hdagen.prediction.window_replay import find_window_starts, replay


@pytest.fixture(scope="module")
def made(build: Callable) -> Callable[..., Arm]:
    """made(text, effects=()) -> a fresh Arm."""
    return lambda robot, effects=(): Arm(build(robot, "portable", effects).folder)


# -- causality --------------------------------------------------------------------------------------------------------

CASES = {
    "flexible": (FLEXIBLE, (), {}, False, "command"),
    "flexible, velocities logged": (FLEXIBLE, (), {}, True, "command"),
    "flexible, driven by the measured current": (FLEXIBLE, (), {}, False, "measured"),
    "effects that remember": (FLEXIBLE, MEMORY, HYSTERESIS | {"presliding_share_2": 0.5}, False, "command"),
    "effects that remember, velocities logged": (FLEXIBLE, MEMORY, HYSTERESIS, True, "command"),
    "rigid": (RIGID, (), {}, False, "command"),
}


@pytest.mark.parametrize("case", CASES)
def test_no_measurement_after_a_windows_start_reaches_its_prediction(case: str, made: Callable) -> None:
    robot, effects, parameters, velocities, source = CASES[case]
    arm = made(robot, effects)
    log = simulated(arm, velocities=velocities)
    arm.parameters.update(parameters)
    keep = ("motor_current", "motor_torque") if source == "measured" else ()
    true = replay(arm, log, 0.25, source)
    ends = [*true.starts[1:], len(log)]
    assert len(ends) == 5
    for first, end in zip(true.starts, ends, strict=True):
        again = replay(arm, spoilt(log, int(first), keep), 0.25, source)
        for name, values in true.columns.items():
            assert again.columns[name][:end].tobytes() == values[:end].tobytes(), (name, first)
        if end < len(log):  # and the noise does arrive where it may
            assert any(np.any(again.columns[name][end:] != values[end:]) for name, values in true.columns.items())


def test_an_earlier_measurement_does_reach_a_prediction(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm)
    first = int(find_window_starts(log.time, 0.25)[2])
    moved = replay(arm, spoilt(log, first - 3)).columns["joint_position_1"][first:]
    assert np.any(moved != replay(arm, log).columns["joint_position_1"][first:])


# -- a true model -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("even", [True, False])
def test_a_true_flexible_model_meets_the_noise_of_the_sensors(even: bool, made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 3.0, even=even)
    found = replay(arm, log)
    assert max(multiples(found, "motor_current")) < 1.1
    assert max(multiples(found, "motor_position")) < 1.5
    assert max(multiples(found, "joint_position")) < 3.0
    assert found.gap < 1.7
    assert found.columns["time"].tobytes() == log.time.tobytes()
    assert set(found.columns) == {"time"} | {
        f"{what}_{j}" for what in ("motor_current", "motor_position", "joint_position") for j in (1, 2)
    }


def test_a_true_rigid_model_meets_the_noise_of_the_sensors(made: Callable) -> None:
    found = replay(arm := made(RIGID), simulated(arm, 3.0))
    assert max(multiples(found, "motor_position")) < 1.5
    assert max(multiples(found, "joint_position")) < 3.0
    assert "motor_torque_1" in found.columns and "motor_current_1" not in found.columns


def test_springs_damped_far_beyond_the_robot_file_lose_no_window() -> None:
    arm = load("paper")
    arm.parameters["torsional_damping_2"] = 19.0 * arm.parameters["torsional_damping_2"]
    assert arm.stability.longest_step(arm.p) < arm.step_size
    found = replay(arm, simulated(arm, 3.0))
    assert not found.notes
    assert found.gap < 1.7


@pytest.mark.parametrize("input", ["command", "measured"])
def test_a_channel_that_drives_the_model_is_no_part_of_the_gap(input: str, made: Callable) -> None:
    """It errs by nothing, whatever the model is: counted, it would make any model look good."""
    arm = made(FLEXIBLE)
    log = simulated(arm, 2.0)
    if input == "command":  # which is not logged at joint 1
        log = Log(log.time, {k: v for k, v in log.columns.items() if k != "motor_current_command_1"}, 2, "driven")
    arm.parameters["mass_2"] *= 1.5
    found = replay(arm, log, input=input)
    driving = ("motor_current_1",) if input == "command" else ("motor_current_1", "motor_current_2")
    assert found.driving_channels == driving and found.counted_channels == [
        name for name in found.errors if name not in driving
    ]
    errs = [found.errors[name] / found.noise[name] for name in found.errors if name not in driving]
    assert found.gap == pytest.approx(math.exp(float(np.mean(np.log(errs)))))
    told = evaluate_gap(found, found, LogPortion.all_rows(log))
    assert told["before"] == pytest.approx(found.gap, rel=1e-9) and set(told["by_channel"]) == set(
        found.counted_channels
    )


@pytest.mark.parametrize("side", ["motor", "joint"])
def test_one_encoder_is_enough(side: str, made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 3.0)
    other = "joint_position" if side == "motor" else "motor_position"
    kept = {name: values for name, values in log.columns.items() if not name.startswith(f"{other}_")}
    found = replay(arm, Log(log.time, kept, 2, "one side"))
    assert max(multiples(found, f"{side}_position")) < 30  # 1e-4 rad of the joint with the motor's, 5e-5 with its own
    assert {name for name in found.columns if "position" in name} == {
        f"{s}_position_{j}" for s in ("motor", "joint") for j in (1, 2)
    }
    error = found.columns[f"{other}_1"] - log[f"{other}_1"]
    assert np.sqrt(np.mean(error**2)) < (2e-4 if other == "joint_position" else 2e-2)


def test_effects_states_go_on_from_window_to_window(made: Callable) -> None:
    arm = made(FLEXIBLE, MEMORY)
    arm.parameters.update(HYSTERESIS)
    log = simulated(arm, 3.0)
    true, without = replay(arm, log), replay(made(FLEXIBLE), log)
    assert true.gap < 3.0 < without.gap / 3
    hidden = true.states[:, arm.index("hysteresis_1")]
    assert np.abs(hidden[true.starts[1:]]).max() > 0.5  # a reset would begin each window at 0


def test_an_effect_of_amplitude_0_changes_no_bit(made: Callable) -> None:
    log = simulated(plain := made(FLEXIBLE))
    added = replay(made(FLEXIBLE, MEMORY), log)
    for name, values in replay(plain, log).columns.items():
        assert added.columns[name].tobytes() == values.tobytes()


def test_a_wrong_model_hardly_bends_the_state_at_the_starts(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 3.0, velocities=True)
    blind = Log(log.time, {n: v for n, v in log.columns.items() if "velocity" not in n}, 2, "no velocities")
    arm.parameters.update(coulomb_friction_1=0.05, mass_2=3.5, viscous_friction_2=4e-4)
    states = replay(arm, blind).states
    starts = find_window_starts(log.time, 0.25)[1:]
    for j in (1, 2):
        error = states[starts, arm.index(f"joint_velocity_{j}")] - log[f"joint_velocity_{j}"][starts]
        assert np.abs(error).max() < 0.02  # rad/s, of motions up to 2 rad/s


def test_a_joint_encoder_that_is_read_late_ruins_no_window(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 3.0)
    lag = np.append(np.full(15, log["joint_position_2"][0]), log["joint_position_2"][:-15])
    late = {**log.columns, "joint_position_2": lag}
    found = replay(arm, Log(log.time, late, 2, "late"))
    twist = late["motor_position_2"] / 100 - late["joint_position_2"]
    assert np.abs(twist).max() > 5e-3  # as torsion it would mean hundreds of N m
    assert not any("bounds" in note for note in found.notes)
    assert found.errors["motor_position_2"] < 0.2 and found.errors["joint_position_2"] < 1.2 * np.std(twist)


def test_rows_that_are_missing_are_bridged(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 3.0)
    kept = np.flatnonzero(~np.isin(np.arange(3000), [*range(740, 745), 1200, *range(2000, 2003)]))
    found = replay(arm, Log(log.time[kept], {n: v[kept] for n, v in log.columns.items()}, 2, "gaps"))
    assert len(found.columns["joint_position_1"]) == len(kept)
    assert max(multiples(found, "motor_position")) < 300  # the commands that are missing are


def test_noise_ruins_nothing(made: Callable) -> None:
    """Windows that begin in nonsense end in numbers, with a sentence where they left all bounds."""
    arm = made(FLEXIBLE)
    found = replay(arm, spoilt(simulated(arm), 100))
    assert all(np.isfinite(values).all() for values in found.columns.values())


# -- inputs and windows -----------------------------------------------------------------------------------------------


def test_windows_start_at_the_first_row_at_or_after_each_multiple() -> None:
    time = 3.0 + 0.1 * np.arange(11).astype(float)
    assert find_window_starts(time, 0.25).tolist() == [0, 3, 5, 8, 10]
    assert find_window_starts(time, 0.3).tolist() == [0, 3, 6, 9]  # though 3 · 0.1 is above 0.3 by a rounding error
    assert find_window_starts(time, math.inf).tolist() == [0]
    assert find_window_starts(np.array([0.0, 0.1, 5.0, 5.1]), 0.25).tolist() == [0, 2]  # a gap skips windows
    for wrong in (0.0, -1.0, math.nan):
        with pytest.raises(PlantError, match="window"):
            find_window_starts(time, wrong)


def test_a_command_is_held_and_a_measurement_belongs_to_the_row_before(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 0.3)
    commanded, notes = read_driving_inputs(arm, log, "command")
    assert np.array_equal(commanded[:, 0], log["motor_current_command_1"]) and not notes
    assert np.array_equal(commanded[:, 3], log["tip_force_y"])
    measured, _ = read_driving_inputs(arm, log, "measured")
    assert np.array_equal(measured[:-1, 0], log["motor_current_1"][1:])
    found = replay(arm, log)
    assert np.array_equal(found.columns["motor_current_1"][1:], log["motor_current_command_1"][:-1])
    assert replay(arm, log, input="measured").errors["motor_current_1"] == 0.0


def test_torque_drives_a_robot_that_takes_current_and_not_the_other_way_round(made: Callable) -> None:
    log = simulated(arm := made(FLEXIBLE), 0.3)
    torque = {
        n.replace("motor_current", "motor_torque"): v * 0.05 if "current" in n else v for n, v in log.columns.items()
    }
    by_torque = replay(arm, Log(log.time, torque, 2, "torque"))
    assert by_torque.columns["joint_position_1"] == pytest.approx(
        replay(arm, log).columns["joint_position_1"], abs=1e-9
    )
    assert by_torque.columns["motor_torque_1"][1:] == pytest.approx(torque["motor_torque_command_1"][:-1])
    with pytest.raises(LogError, match="no torque_constant for joint 1"):
        read_driving_inputs(made(RIGID), log, "command")


def test_what_is_not_logged_is_replaced_and_said(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 0.3)
    only = Log(log.time, {n: v for n, v in log.columns.items() if "command" not in n}, 2, "measured only")
    _, notes = read_driving_inputs(arm, only, "command")
    assert "No command is logged for joint 1: motor_current_1 drives the model" in notes[0]
    commands = Log(log.time, {n: v for n, v in log.columns.items() if not n.startswith("motor_current_1")}, 2, "x")
    assert "has no measured current" in read_driving_inputs(arm, commands, "measured")[1][0]
    strong = Log(log.time, {**log.columns, "motor_current_command_1": np.full(300, 11.0)}, 2, "strong")
    assert (
        "exceeds the robot file's max_current of 10 A in 300 row(s)"
        in read_driving_inputs(arm, strong, "command")[1][0]
    )


def test_a_log_that_begins_in_motion_is_said_to(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm)
    rested = replay(arm, log)
    assert not any("begins in motion" in note for note in rested.notes) and rested.guessed_starts == ()
    fast = int(np.argmax(np.abs(np.gradient(log["joint_position_1"][300:900])))) + 300
    moving = replay(arm, log.rows(fast, fast + 250))
    assert any("begins in motion" in note for note in moving.notes) and moving.guessed_starts == (0,)
    kept = np.r_[0 : fast - 300, fast:1000]  # over a pause nothing carries on
    paused = Log(log.time[kept], {n: v[kept] for n, v in log.columns.items()}, 2, "paused")
    assert replay(arm, paused).guessed_starts == (fast - 300,)


def test_a_log_of_another_robot_is_refused(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 0.3)
    one = Log(log.time, {n: v for n, v in log.columns.items() if not n.endswith("_2")}, 1, "one joint")
    with pytest.raises(LogError, match="1 joint\\(s\\), the robot 2"):
        replay(arm, one)
    blind = Log(log.time, {n: v for n, v in log.columns.items() if "position_2" not in n}, 2, "blind")
    with pytest.raises(LogError, match="joint 2 has no position"):
        replay(arm, blind)
    with pytest.raises(PlantError, match="command or measured, not guess"):
        replay(arm, log, input="guess")


def test_a_position_that_no_channel_says_follows_from_the_other_side(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm)
    state = Readings.from_log(arm, log).state_at(arm, 0)
    motor = Log(log.time, {n: v for n, v in log.columns.items() if not n.startswith("joint_position")}, 2, "motor")
    guessed = Readings.from_log(arm, motor).state_at(arm, 0)
    assert guessed == pytest.approx(state, abs=2e-3)
    assert guessed[arm.index("joint_position_1")] == pytest.approx(-np.pi / 2, abs=1e-5)  # at rest: gravity's torsion
