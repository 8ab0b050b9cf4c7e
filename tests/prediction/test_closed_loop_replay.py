"""Closed-loop replay: the stated law around the model, against a loop written out here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from replayed import FLEXIBLE, JOINT, MOTOR, simulated

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction import closed_loop_replay


@pytest.fixture(scope="module")
def made(build: Callable) -> Callable[..., Arm]:
    """made(text, effects=()) -> a fresh Arm."""
    return lambda robot, effects=(): Arm(build(robot, "portable", effects).folder)


LAW = "[[joint]]\nkp = 8.0\nkv = 0.5\nvelocity_filter_samples = 2\ntorque_scale = 2.0\nlimit = 3.0\n"


def looped(arm: Arm, laws: tuple[closed_loop_replay.JointLaw, ...], rows: int = 900) -> Log:
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
    columns = dict[str, np.ndarray]()
    for j in (1, 2):
        columns |= {f"motor_position_{j}": motors[:, j - 1], f"joint_position_{j}": joints[:, j - 1]}
        columns |= {
            f"joint_position_reference_{j}": reference[:, j - 1],
            f"motor_current_command_{j}": commands[:, j - 1],
        }
    return Log(time, columns, 2, "looped")


def test_a_closed_loop_of_the_true_model_is_the_log_itself(made: Callable, tmp_path: Path) -> None:
    (tmp_path / "controller.toml").write_text(LAW + '[[joint]]\nkp = 9.0\nkv = 1.0\nencoder = "motor"\n')
    laws = closed_loop_replay.read_controller(tmp_path / "controller.toml")
    assert laws[1] == closed_loop_replay.JointLaw(9.0, 1.0, encoder="motor")
    arm = made(FLEXIBLE)
    log = looped(arm, laws)
    found = closed_loop_replay.replay_closed_loop(arm, log, laws)
    for j in (1, 2):
        assert np.ptp(log[f"joint_position_{j}"]) > 0.03
        assert found.columns[f"motor_current_command_{j}"] == pytest.approx(log[f"motor_current_command_{j}"], abs=1e-6)
        assert found.errors[f"joint_position_{j}"] < JOINT and found.errors[f"motor_position_{j}"] < MOTOR
    windows = closed_loop_replay.replay_closed_loop(arm, log, laws, 0.25)
    assert len(windows.starts) == 4 and windows.errors["motor_position_1"] < 3 * MOTOR


def test_a_wrong_controller_is_refused_with_all_its_problems(tmp_path: Path) -> None:
    path = tmp_path / "controller.toml"
    path.write_text(
        'gain = 1\n[[joint]]\nkp = "1"\nkv = -1.0\nki = 2.0\n[[joint]]\nvelocity_filter_samples = 1.5\nkp = inf\n'
    )
    with pytest.raises(PlantError) as caught:
        closed_loop_replay.read_controller(path)
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
            closed_loop_replay.read_controller(path)


def test_a_loop_that_cannot_be_closed_is_refused(made: Callable) -> None:
    arm = made(FLEXIBLE)
    law = closed_loop_replay.JointLaw(8.0, 0.5)
    with pytest.raises(LogError, match="joint_position_reference_1, joint_position_reference_2 is not logged"):
        closed_loop_replay.replay_closed_loop(arm, simulated(arm, 0.3), (law, law))
    log = looped(arm, (law, law), 50)
    with pytest.raises(PlantError, match=r"has 1 joint\(s\), the robot 2"):
        closed_loop_replay.replay_closed_loop(arm, log, (law,))
    wild = closed_loop_replay.JointLaw(1e6, 1e9, torque_scale=-1e6)
    with pytest.raises(PlantError, match="left all bounds"):
        closed_loop_replay.replay_closed_loop(arm, log, (wild, wild))
