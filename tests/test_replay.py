"""Replay: nothing measured inside a window counts, a true model meets the noise, and every refusal is a sentence."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path

import arms
import numpy as np
import pytest

from hdagen import closed_loop, replay_command, verdict
from hdagen.inverse import force_error
from hdagen.log import Log, LogError, read, write
from hdagen.plant import Arm, PlantError
from hdagen.readings import Readings
from hdagen.replay import Replay, driven_by, replay, window_starts

MOTOR, JOINT, NOISE = 2 * math.pi / 4096, 2 * math.pi / 2**20, 0.01  # rad, rad, A: the sensors of these tests
SENSORS = f"""[joint.sensor]
motor_encoder_resolution = {MOTOR}
joint_encoder_resolution = {JOINT}
current_noise = {NOISE}"""
FLEXIBLE = arms.arm("RR", drive=f"torque_constant = 0.05\nmax_current = 10.0\n{SENSORS}")
RIGID = arms.arm("RP", rigid="rr", drive=f"friction_smoothing = 1.0\n{SENSORS}")
MEMORY = ("presliding_friction", "transmission_hysteresis")
HYSTERESIS = {"hysteresis_torque_1": 2.0, "hysteresis_angle_1": 2e-4}
MEASURED = ("motor_position", "joint_position", "motor_velocity", "joint_velocity", "motor_current", "motor_torque")


@pytest.fixture(scope="module")
def made(build: Callable) -> Callable[..., Arm]:
    """made(text, effects=()) -> a fresh Arm."""
    return lambda robot, effects=(): Arm(build(robot, "portable", effects).folder)


def simulated(arm: Arm, seconds: float = 1.2, velocities: bool = False, seed: int = 0, even: bool = True) -> Log:
    """The log of ``arm`` under sums of sines, from rest, with the encoders' steps and the current's noise."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(
        np.full(round(seconds * 1000), 1e-3) if even else rng.uniform(0.5e-3, 1.5e-3, round(seconds * 1000))
    )
    swing = np.sin(2 * np.pi * np.outer(time, [1.7, 4.1]) + rng.uniform(0, 6, 2)) @ [[1.0, 0.5], [0.6, 1.0]]
    size = 0.25 * np.array([slot["bound"] for slot in arm.manifest["input"][: arm.n]])
    u = np.zeros((len(time), arm.nu))
    u[:, : arm.n] = size * swing[:, : arm.n]
    u[300:500, arm.index("tip_force_y")] = 8.0
    hanging = np.array([-np.pi / 2, *np.zeros(arm.n - 1)])
    x = arm.rollout(arm.rest(hanging), u[:-1], np.diff(time), exact=True)
    seen = arm.outputs(x, u)
    columns = {"tip_force_x": u[:, -2], "tip_force_y": u[:, -1]}
    for j in range(1, arm.n + 1):
        name = arm.input_names[j - 1]
        command = name.replace("motor_current", "motor_current_command").replace("motor_torque", "motor_torque_command")
        held = np.append(0.0, u[:-1, j - 1])
        columns |= {command: u[:, j - 1], name: held + NOISE * rng.standard_normal(len(time))}
        columns[f"motor_position_{j}"] = np.round(seen["motor_position"][:, j - 1] / MOTOR) * MOTOR
        columns[f"joint_position_{j}"] = np.round(seen["joint_position"][:, j - 1] / JOINT) * JOINT
        if velocities:
            columns |= {f"{side}_velocity_{j}": seen[f"{side}_velocity"][:, j - 1] for side in ("motor", "joint")}
    return Log(time, {name: np.ascontiguousarray(values) for name, values in columns.items()}, arm.n, "simulated")


def multiples(found: Replay, what: str) -> list[float]:
    """Errors of a quantity's channels in multiples of their noise."""
    return [found.errors[name] / found.noise[name] for name in found.errors if name.startswith(what)]


def spoilt(log: Log, after: int, keep: tuple[str, ...] = (), seed: int = 1) -> Log:
    """``log`` with all measurements after row ``after`` replaced by noise of their own spread, but for ``keep``."""
    rng = np.random.default_rng(seed)
    columns = {}
    for name, values in log.columns.items():
        columns[name] = values.copy()
        if name.rpartition("_")[0] in MEASURED and name.rpartition("_")[0] not in keep:
            columns[name][after + 1 :] = values.mean() + values.std() * rng.standard_normal(len(log) - after - 1)
    return Log(log.time, columns, log.n_joints, log.source)


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
    first = int(window_starts(log.time, 0.25)[2])
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
    added = replay(made(FLEXIBLE, ("transmission_hysteresis",)), log)
    for name, values in replay(plain, log).columns.items():
        assert added.columns[name].tobytes() == values.tobytes()


def test_a_wrong_model_hardly_bends_the_state_at_the_starts(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 3.0, velocities=True)
    blind = Log(log.time, {n: v for n, v in log.columns.items() if "velocity" not in n}, 2, "no velocities")
    arm.parameters.update(coulomb_friction_1=0.05, mass_2=3.5, viscous_friction_2=4e-4)
    states = replay(arm, blind).states
    starts = window_starts(log.time, 0.25)[1:]
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
    time = 3.0 + 0.1 * np.arange(11)
    assert window_starts(time, 0.25).tolist() == [0, 3, 5, 8, 10]
    assert window_starts(time, 0.3).tolist() == [0, 3, 6, 9]  # though 3 · 0.1 is above 0.3 by a rounding error
    assert window_starts(time, math.inf).tolist() == [0]
    assert window_starts(np.array([0.0, 0.1, 5.0, 5.1]), 0.25).tolist() == [0, 2]  # a gap skips windows
    for wrong in (0.0, -1.0, math.nan):
        with pytest.raises(PlantError, match="window"):
            window_starts(time, wrong)


def test_a_command_is_held_and_a_measurement_belongs_to_the_row_before(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 0.3)
    commanded, notes = driven_by(arm, log, "command")
    assert np.array_equal(commanded[:, 0], log["motor_current_command_1"]) and not notes
    assert np.array_equal(commanded[:, 3], log["tip_force_y"])
    measured, _ = driven_by(arm, log, "measured")
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
        driven_by(made(RIGID), log, "command")


def test_what_is_not_logged_is_replaced_and_said(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm, 0.3)
    only = Log(log.time, {n: v for n, v in log.columns.items() if "command" not in n}, 2, "measured only")
    _, notes = driven_by(arm, only, "command")
    assert "No command is logged for joint 1: motor_current_1 drives the model" in notes[0]
    commands = Log(log.time, {n: v for n, v in log.columns.items() if not n.startswith("motor_current_1")}, 2, "x")
    assert "has no measured current" in driven_by(arm, commands, "measured")[1][0]
    strong = Log(log.time, {**log.columns, "motor_current_command_1": np.full(300, 11.0)}, 2, "strong")
    assert "exceeds the robot file's max_current of 10 A in 300 row(s)" in driven_by(arm, strong, "command")[1][0]


def test_a_log_that_begins_in_motion_is_said_to(made: Callable) -> None:
    arm = made(FLEXIBLE)
    log = simulated(arm)
    assert not any("begins in motion" in note for note in replay(arm, log).notes)
    fast = int(np.argmax(np.abs(np.gradient(log["joint_position_1"][300:900])))) + 300
    assert any("begins in motion" in note for note in replay(arm, log.rows(fast, fast + 250)).notes)


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
    state = Readings.of(arm, log).state(arm, 0)
    motor = Log(log.time, {n: v for n, v in log.columns.items() if not n.startswith("joint_position")}, 2, "motor")
    guessed = Readings.of(arm, motor).state(arm, 0)
    assert guessed == pytest.approx(state, abs=2e-3)
    assert guessed[arm.index("joint_position_1")] == pytest.approx(-np.pi / 2, abs=1e-5)  # at rest: gravity's torsion


# -- diagnosis --------------------------------------------------------------------------------------------------------


def diagnosis(**changes: object) -> dict:
    """A diagnosis.json's content."""
    hysteresis = {"hysteresis_torque": {"value": 2.0, "std": 0.1, "unit": "N m"}, "hysteresis_angle": {"value": 2e-4}}
    causes = [
        {"effect": "transmission_hysteresis", "joint": 1, "probability": 0.9, "parameters": hysteresis},
        {"effect": "coulomb_friction", "joint": 2, "parameters": {"coulomb_friction": {"value": 0.05, "std": 0.01}}},
    ]
    base = {"mass_1": {"value": 4.6, "std": 0.1}}
    return {"schema": 1, "verdict": ["transmission_hysteresis@1"], "causes": causes, "parameters": base} | changes


def test_the_verdict_closes_the_gap_and_without_the_effect_it_comes_back(made: Callable) -> None:
    truth = made(FLEXIBLE, MEMORY)
    truth.parameters.update(HYSTERESIS | {"mass_1": 4.6})
    log = simulated(truth, 3.0)
    arm = made(FLEXIBLE, ("transmission_hysteresis",))
    before = replay(arm, log).gap
    after = replay(arm, log, with_=diagnosis()).gap
    effect_out = replay(arm, log, with_=diagnosis(verdict=[])).gap
    assert after < 3.0 < effect_out / 3 and effect_out <= 1.2 * before
    assert arm.parameters["hysteresis_torque_1"] == 0.0 and arm.parameters["mass_1"] == 4.5  # a copy was changed


def test_base_parameters_stay_near_their_tolerance_and_effects_do_not(made: Callable) -> None:
    arm = made(FLEXIBLE)
    stated = diagnosis(
        verdict=["coulomb_friction@2", "unknown@1"],
        parameters={"mass_1": {"value": 9.0}, "coulomb_friction_2": {"value": 0.03}, "length_1": 0.3},
    )
    changed, notes = verdict.applied(arm, verdict.read(stated))
    assert changed.parameters["mass_1"] == pytest.approx(4.5 * 1.15)  # 3 times 5 %
    assert changed.parameters["coulomb_friction_2"] == 0.05 and changed.parameters["length_1"] == 0.3
    assert [note.split(":")[0] for note in notes] == ["unknown@1 has no equation", "mass_1"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"schema": 2}, "schema is 2, possible is 1"),
        ({"schema": True}, "schema is True"),
        ({"verdict": "stribeck"}, "possible is a list of effects"),
        ({"verdict": ["stribeck_friction"]}, "possible is name@joint"),
        ({"verdict": ["x; rm -rf@1"]}, "possible is name@joint"),
        ({"verdict": ["stribeck_friction@1"]}, "no parameters here"),
        ({"parameters": {"mass_1": {"value": math.nan}}}, "possible is a finite number"),
        ({"parameters": {"mass_1": {"value": 10**400}}}, "possible is a finite number"),
        ({"parameters": {"mass_1": {"value": True}}}, "possible is a finite number"),
        ({"parameters": {"Mass-1": 1.0}}, "no name of a parameter"),
        ({"verdict": [], "parameters": {"mass_7": 1.0}}, "no parameter mass_7"),
        ({"causes": [{"effect": 3}]}, "object with effect and joint"),
        ({"verdict": ["unknown@5"]}, "at a joint that test arm does not have"),
        ({}, "load it with hdagen.load"),
    ],
)
def test_a_diagnosis_that_does_not_fit_is_refused(changes: dict, words: str, made: Callable) -> None:
    with pytest.raises(PlantError, match=words):
        verdict.applied(made(FLEXIBLE), verdict.read(diagnosis(**changes)))


@pytest.mark.parametrize("text", ["", "[1]", "{", "nonsense", "[" * 100_000])
def test_a_file_that_is_no_diagnosis_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(PlantError, match=r"diagnosis\.json"):
        verdict.read(tmp_path / "diagnosis.json")
    with pytest.raises(PlantError, match="cannot be read"):
        verdict.read(tmp_path / "absent.json")


# -- closed loop ------------------------------------------------------------------------------------------------------

LAW = "[[joint]]\nkp = 8.0\nkv = 0.5\nvelocity_filter_samples = 2\ntorque_scale = 2.0\nlimit = 3.0\n"


def looped(arm: Arm, laws: tuple[closed_loop.Law, ...], rows: int = 900) -> Log:
    """The log of ``laws`` driving ``arm`` along a reference, written by a loop of its own."""
    time = 1e-3 * np.arange(rows)
    reference = np.stack([-np.pi / 2 + 0.3 * (1 - np.cos(4 * time)), 0.1 * (1 - np.cos(3 * time))], 1)
    x, ratio = arm.rest([-np.pi / 2, 0.0]), np.array([arm.parameters[f"ratio_{j}"] for j in (1, 2)])
    motors, joints, commands = np.empty((rows, 2)), np.empty((rows, 2)), np.empty((rows, 2))
    for k in range(rows):
        seen = arm.outputs(x, np.zeros(arm.nu))
        motors[k] = np.round(seen["motor_position"] / MOTOR) * MOTOR
        joints[k] = np.round(seen["joint_position"] / JOINT) * JOINT
        for j, law in enumerate(laws):
            y = (motors / ratio if law.encoder == "motor" else joints)[:, j]
            means = [np.mean([y[max(i - m, 0)] for m in range(law.velocity_filter_samples)]) for i in (k, k - 1)]
            demand = law.kv * (law.kp * (reference[k, j] - y[k]) - (means[0] - means[1]) / 1e-3)
            commands[k, j] = law.torque_scale * np.clip(demand, -law.limit, law.limit)
        for _ in range(2):
            x = arm.step(x, [*commands[k], 0.0, 0.0], 5e-4, exact=True)
    columns = {}
    for j in (1, 2):
        columns |= {f"motor_position_{j}": motors[:, j - 1], f"joint_position_{j}": joints[:, j - 1]}
        columns |= {
            f"joint_position_reference_{j}": reference[:, j - 1],
            f"motor_current_command_{j}": commands[:, j - 1],
        }
    return Log(time, columns, 2, "looped")


def test_a_closed_loop_of_the_true_model_is_the_log_itself(made: Callable, tmp_path: Path) -> None:
    (tmp_path / "controller.toml").write_text(LAW + '[[joint]]\nkp = 9.0\nkv = 1.0\nencoder = "motor"\n')
    laws = closed_loop.read_controller(tmp_path / "controller.toml")
    assert laws[1] == closed_loop.Law(9.0, 1.0, encoder="motor")
    arm = made(FLEXIBLE)
    log = looped(arm, laws)
    found = closed_loop.closed_loop(arm, log, laws)
    for j in (1, 2):
        assert np.ptp(log[f"joint_position_{j}"]) > 0.03
        assert found.columns[f"motor_current_command_{j}"] == pytest.approx(log[f"motor_current_command_{j}"], abs=1e-6)
        assert found.errors[f"joint_position_{j}"] < JOINT and found.errors[f"motor_position_{j}"] < MOTOR
    windows = closed_loop.closed_loop(arm, log, laws, 0.25)
    assert len(windows.starts) == 4 and windows.errors["motor_position_1"] < 3 * MOTOR


def test_a_wrong_controller_is_refused_with_all_its_problems(tmp_path: Path) -> None:
    path = tmp_path / "controller.toml"
    path.write_text(
        'gain = 1\n[[joint]]\nkp = "1"\nkv = -1.0\nki = 2.0\n[[joint]]\nvelocity_filter_samples = 1.5\nkp = inf\n'
    )
    with pytest.raises(PlantError) as caught:
        closed_loop.read_controller(path)
    said = str(caught.value)
    for words in (
        "'gain'",
        "joint 1, kp",
        "joint 1, kv",
        "'ki'",
        "joint 2, velocity_filter_samples",
        "joint 2, kp",
        "kv is missing",
    ):
        assert words in said
    for text in ("", "joint = 3", "[[joint]", "joint = []"):
        path.write_text(text)
        with pytest.raises(PlantError, match=r"controller\.toml"):
            closed_loop.read_controller(path)


def test_a_loop_that_cannot_be_closed_is_refused(made: Callable) -> None:
    arm = made(FLEXIBLE)
    law = closed_loop.Law(8.0, 0.5)
    with pytest.raises(LogError, match="joint_position_reference_1, joint_position_reference_2 is not logged"):
        closed_loop.closed_loop(arm, simulated(arm, 0.3), (law, law))
    log = looped(arm, (law, law), 50)
    with pytest.raises(PlantError, match=r"has 1 joint\(s\), the robot 2"):
        closed_loop.closed_loop(arm, log, (law,))
    wild = closed_loop.Law(1e6, 1e9, torque_scale=-1e6)
    with pytest.raises(PlantError, match="left all bounds"):
        closed_loop.closed_loop(arm, log, (wild, wild))


# -- inverse dynamics -------------------------------------------------------------------------------------------------


def smooth(arm: Arm) -> Log:
    """A rigid arm's log of a slow motion, with exact encoders."""
    log = simulated(arm, 6.0)
    swing = np.sin(2 * np.pi * np.outer(log.time, [0.7, 1.1]))
    u = np.zeros((len(log), arm.nu))
    u[:, :2] = 0.4 * swing * [slot["bound"] for slot in arm.manifest["input"][:2]]
    x = arm.rollout(arm.rest([-np.pi / 2, 0.0]), u[:-1], np.diff(log.time))
    columns = {f"motor_torque_command_{j}": u[:, j - 1] for j in (1, 2)}
    columns |= {f"joint_position_{j}": np.ascontiguousarray(x[:, arm.index(f"joint_position_{j}")]) for j in (1, 2)}
    return Log(log.time, columns, 2, "smooth")


def test_the_force_error_of_a_true_model_is_small_and_grows_with_what_is_wrong(made: Callable) -> None:
    arm = made(RIGID)
    log = smooth(arm)
    inputs, _ = driven_by(arm, log, "command")
    true = force_error(arm, log, inputs)
    assert true.relative.max() < 0.02
    assert true.measured.shape == true.modelled.shape == (len(true.time), 2)
    assert np.interp(true.time, log.time, inputs[:, 0]) == pytest.approx(true.measured[:, 0], abs=0.01)
    arm.parameters.update(coulomb_friction_1=0.06)
    wrong = force_error(arm, log, inputs).relative
    assert wrong[0] > 5 * true.relative[0] and wrong[1] == pytest.approx(true.relative[1], rel=0.2)


def test_the_force_error_refuses_springs_and_slow_logs(made: Callable) -> None:
    with pytest.raises(PlantError, match="needs rigid drives"):
        force_error(flexible := made(FLEXIBLE), log := simulated(flexible, 0.3), driven_by(flexible, log, "command")[0])
    rigid = made(RIGID)
    log = smooth(rigid)
    slow = Log(log.time[::5], {n: v[::5] for n, v in log.columns.items()}, 2, "slow")
    with pytest.raises(LogError, match="at 200 Hz are too few"):
        force_error(rigid, slow, driven_by(rigid, slow, "command")[0])


# -- command ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def command(build: Callable, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """command(*arguments) -> exit code of `hdagen replay`, with the builds of this session."""
    monkeypatch.setenv("HDAGEN_BUILD", str(build(FLEXIBLE).folder.parent))

    def run(*arguments: str | Path) -> int:
        parser = argparse.ArgumentParser()
        replay_command.add_parser(parser.add_subparsers())
        try:
            return replay_command.run(parser.parse_args(["replay", *map(str, arguments)]))
        except PlantError as error:
            print(error)
            return 2
        except LogError as error:
            print(error)
            return 3

    return run


@pytest.fixture
def files(tmp_path: Path, made: Callable) -> Path:
    """A folder with robot.toml, rigid.toml and a log of each."""
    (tmp_path / "robot.toml").write_text(FLEXIBLE)
    (tmp_path / "rigid.toml").write_text(RIGID)
    write(simulated(made(FLEXIBLE)), tmp_path / "log.parquet")
    write(smooth(made(RIGID)), tmp_path / "rigid.csv")
    return tmp_path


def test_the_command_writes_what_replay_predicts(command: Callable, files: Path, made: Callable, capsys) -> None:  # noqa: ANN001
    out = files / "predicted.parquet"
    assert command(files / "robot.toml", files / "log.parquet", "--out", out) == 0
    shown = capsys.readouterr().out
    log = read(files / "log.parquet")
    found = replay(made(FLEXIBLE), log)
    written = read(out)
    for name, values in found.columns.items():
        assert written[name].tobytes() == values.tobytes()
    assert all(name in shown for name in found.errors) and f"written: {out}" in shown.replace("\n", "")
    assert command(files / "robot.toml", files / "log.parquet", "--json", "--window", "0.5") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["windows"] == 3 and figures["out"] is None and figures["force_error"] is None
    assert figures["errors"] == pytest.approx(replay(made(FLEXIBLE), log, 0.5).errors)


def test_the_command_prints_the_force_error_of_rigid_robots(command: Callable, files: Path, capsys) -> None:  # noqa: ANN001
    assert command(files / "rigid.toml", files / "rigid.csv", "--json") == 0
    assert max(json.loads(capsys.readouterr().out)["force_error"]) < 0.02


def test_the_command_adds_a_verdict(command: Callable, files: Path, capsys) -> None:  # noqa: ANN001
    (files / "diagnosis.json").write_text(json.dumps(diagnosis()))
    robot, log = files / "robot.toml", files / "log.parquet"
    assert command(robot, log, "--with", files / "diagnosis.json", "--json") == 0
    gap = json.loads(capsys.readouterr().out)["gap"]
    assert command(robot, log, "--json") == 0
    assert gap != json.loads(capsys.readouterr().out)["gap"]
    (files / "diagnosis.json").write_text(json.dumps(diagnosis(verdict=["no_such@1"], causes=[no_such()])))
    assert command(robot, log, "--with", files / "diagnosis.json") == 2
    assert "no model can be built with no_such" in capsys.readouterr().out


def no_such() -> dict:
    """A cause that no version knows."""
    return {"effect": "no_such", "joint": 1, "parameters": {"size": {"value": 1.0}}}


def test_the_command_refuses_in_sentences(command: Callable, files: Path, capsys) -> None:  # noqa: ANN001
    robot, log = files / "robot.toml", files / "log.parquet"
    before = (files / "log.parquet").read_bytes()
    for arguments, words in (
        (("--window", "0"), "a window is longer than 0 s"),
        (("--bandwidth", "-2"), "--bandwidth -2"),
        (("--closed-loop", "c.toml", "--input", "measured"), "exclude each other"),
        (("--out", files / "x.txt"), "possible: .parquet, .csv"),
        (("--out", files / "nowhere" / "x.csv"), "there is no folder"),
        (("--out", log), "is the log itself"),
        (("--with", files / "absent.json"), "absent.json"),
        (("--columns", files / "absent.toml"), "absent.toml"),
    ):
        assert command(robot, log, *arguments) == 2, arguments
        said = capsys.readouterr()
        assert words in said.out + said.err
    assert command(robot, files / "absent.parquet") == 3
    assert command(files / "absent.toml", log) == 2
    assert (files / "log.parquet").read_bytes() == before
    assert not list(files.glob("*x.*"))


def test_a_log_that_triage_refuses_is_refused(command: Callable, files: Path, capsys) -> None:  # noqa: ANN001
    log = read(files / "log.parquet")
    wrong = {
        **log.columns,
        "motor_position_1": log["motor_position_1"] / 100,
        "motor_position_2": log["motor_position_2"] / 100,
    }
    write(Log(log.time, wrong, 2, "joint scale"), files / "wrong.parquet")
    assert command(files / "robot.toml", files / "wrong.parquet", "--out", files / "out.parquet") == 3
    assert "motor_position_1" in capsys.readouterr().err
    assert not (files / "out.parquet").exists()
