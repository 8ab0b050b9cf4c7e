"""Signs and sizes of inputs of arms in space: what a joint carries changes with the pose, which the model knows."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest
import space_robots

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_repair import repair_log
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log

pytest.importorskip("mujoco", reason="MuJoCo makes the logs: pip install 'hdagen[mujoco]'")

from hdagen.blind.realities.model_arms import ModelRobot, draw_space_motion
from hdagen.blind.realities.model_reality import simulate_space_arm

SEVEN = space_robots.seven_joint_arm()
LIMITS = "\n[joint.limits]\nposition = [-2.0, 2.0]\nspeed = 3.0\ntorque = 20.0\n"
TWO = re.sub(r"motor_inertia = \S+", "motor_inertia = 0.0", space_robots.chain("RR", 3)).replace(
    "coulomb_friction = 0.0", f"coulomb_friction = 0.0{LIMITS}"
)
INPUTS = ("motor_torque", "motor_torque_command")


def make_log(text: str, seed: int, rotor: float | None = None) -> Log:
    """MuJoCo's log of a multisine, by an arm as its file says but for its rotors, where others are given."""
    known, true = ModelRobot(text).table, ModelRobot(text).table
    for joint in true["joint"]:
        joint["drive"]["motor_inertia"] = joint["drive"]["motor_inertia"] if rotor is None else rotor
    rng = np.random.default_rng(seed)
    columns = simulate_space_arm(true, known, draw_space_motion(rng, known, 6.0), rng, {})
    return Log(columns.pop("time"), columns, len(known["joint"]), "made")


def scale_inputs(log: Log, joint: int, factor: float) -> Log:
    """The log with the inputs of a joint times a factor."""
    own = {f"{base}_{joint}": factor * log[f"{base}_{joint}"] for base in INPUTS}
    return Log(log.time, log.columns | own, log.n_joints, log.source)


@pytest.fixture(scope="module")
def seven(build: Callable) -> Arm:
    return Arm(build(SEVEN).folder)


@pytest.fixture(scope="module")
def two(build: Callable) -> Arm:
    return Arm(build(TWO).folder)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_right_log_of_seven_joints_passes(seed: int, seven: Arm) -> None:
    log = make_log(SEVEN, seed)
    assert repair_log(log, seven)[1] == []


@pytest.mark.parametrize("joint", [1, 3, 4, 7])
def test_a_reversed_input_of_seven_joints_is_refused(joint: int, seven: Arm) -> None:
    with pytest.raises(LogError, match=rf"_{joint} asks for -.* below zero: a sign is reversed"):
        repair_log(scale_inputs(make_log(SEVEN, 0), joint, -1.0), seven)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_right_log_of_a_panda_passes_and_a_reversed_one_is_refused(seed: int, build: Callable) -> None:
    from gen.presets import find_presets

    panda = Arm(build("panda").folder)
    log = make_log(find_presets()["panda"].read_text(), seed)
    assert repair_log(log, panda)[1] == []
    for joint in range(1, 8):
        with pytest.raises(LogError, match="below zero: a sign is reversed"):
            repair_log(scale_inputs(log, joint, -1.0), panda)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("rotor", [0.05, 0.3, 1.0])
def test_a_rotor_that_the_file_lacks_is_not_another_robot(rotor: float, seed: int, two: Arm) -> None:
    """It multiplies the inertia at the second joint by up to 40."""
    log = make_log(TWO, seed, rotor)
    assert repair_log(log, two)[1] == []
    with pytest.raises(LogError, match="below zero: a sign is reversed"):
        repair_log(scale_inputs(log, 2, -1.0), two)


def test_a_torque_in_another_unit_is_refused_beside_a_missing_rotor(two: Arm) -> None:
    with pytest.raises(LogError, match="a unit of motor_torque"):
        repair_log(scale_inputs(make_log(TWO, 1), 1, 1000.0), two)


def test_a_command_that_the_drive_does_not_follow_is_not_another_robot(two: Arm) -> None:
    """A drive at its limit, whose controller asks for ever more. Without a measured torque nobody could tell."""
    log = make_log(TWO, 0)
    asked = log["motor_torque_command_2"]
    asked = np.where(np.abs(asked) > 0.1 * np.abs(asked).max(), 60.0, 1.0) * asked
    wound = Log(log.time, log.columns | {"motor_torque_command_2": asked}, 2, log.source)
    assert repair_log(wound, two)[1] == []
    unmeasured = {name: values for name, values in wound.columns.items() if name != "motor_torque_2"}
    with pytest.raises(LogError, match=r"motor_torque_command_2 asks for .* times the inertia of joint 2"):
        repair_log(Log(log.time, unmeasured, 2, log.source), two)
