"""Simulated runs: repeatable, logged by contract, with the sensors' errors that were asked for; and the command."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compiled import Compiled
from robots import chain

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference, circle
from hdagen.log.measured_log import read
from hdagen.simulation.ideal_admittance import simulate_ideal_admittance
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push, Simulation, run, simulate

ROOT = Path(__file__).resolve().parents[2]
PATH = circle(0.05, (0.2, 0.0), 5.0, 1.5)
PUSHES = (Push(0.5, 1.0, (6.0, -3.0)),)
COARSE = Sensors((2e-3, 3e-3), (1e-5, 2e-5), (0.05, 0.1), 0.5)


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build("paper").folder)


@pytest.fixture(scope="module")
def coarse(arm: Arm) -> Simulation:
    return run(arm, Controller(arm, "impedance_cartesian", Guard(Safe.ZERO)), PATH, PUSHES, COARSE, seed=3)


def stacked(result: Simulation, name: str) -> np.ndarray:
    return np.column_stack([result.log.columns[f"{name}_{j}"] for j in (1, 2)])


def test_a_seed_gives_the_same_run_to_the_bit(arm: Arm, coarse: Simulation) -> None:
    controller = Controller(arm, "impedance_cartesian", Guard(Safe.ZERO))
    for _ in range(2):  # a controller that has run before begins anew
        again = run(arm, controller, PATH, PUSHES, COARSE, seed=3)
        for name, values in coarse.log.columns.items():
            assert np.array_equal(values, again.log.columns[name]), name
        assert np.array_equal(coarse.state, again.state)
    other = simulate(arm, controller, PATH, PUSHES, COARSE, seed=4)
    assert not np.array_equal(other.columns["tip_force_x"], coarse.log.columns["tip_force_x"])


def test_the_log_keeps_its_contract(arm: Arm, coarse: Simulation) -> None:
    """Row k holds what was sampled at t_k and the command held from there on; its current shows row k − 1's command."""
    command, current = stacked(coarse, "motor_current_command"), stacked(coarse, "motor_current")
    noise = current[1:] - command[:-1]
    assert np.abs(noise.mean(axis=0)).max() < 5 * 0.1 / np.sqrt(len(noise))
    assert noise.std(axis=0) == pytest.approx([0.05, 0.1], rel=0.1)
    assert np.abs(np.corrcoef(noise[:, 0], noise[:, 1])[0, 1]) < 0.1
    u = np.hstack([command, coarse.push])
    x = coarse.state[0]
    for k in range(200):  # the states follow from the commands of their own row
        assert np.array_equal(x, coarse.state[k])
        for _ in range(2):
            x = arm.step(x, u[k], 5e-4, exact=True)
    assert arm.step_size == 5e-4
    constants = [arm.parameters[f"torque_constant_{j}"] for j in (1, 2)]
    assert np.allclose(coarse.torque, command * constants, rtol=1e-15)
    assert np.allclose(coarse.log.time, np.arange(1500) * 1e-3)


def test_encoders_round_and_nothing_else(arm: Arm, coarse: Simulation) -> None:
    for name, steps, first in (("motor_position", (2e-3, 3e-3), 0), ("joint_position", (1e-5, 2e-5), 2)):
        seen, true = stacked(coarse, name), coarse.state[:, first : first + 2]
        counts = seen / np.array(steps)
        assert np.abs(counts - np.round(counts)).max() < 1e-6
        assert (np.abs(seen - true) <= np.array(steps) * (0.5 + 1e-9)).all()
        assert (np.abs(seen - true).max(axis=0) > 0.4 * np.array(steps)).all()


def test_the_force_sensor_has_its_noise(coarse: Simulation) -> None:
    noise = np.column_stack([coarse.log.columns[f"tip_force_{axis}"] for axis in "xy"]) - coarse.push
    assert noise.std(axis=0) == pytest.approx([0.5, 0.5], rel=0.1) and np.abs(noise.mean(axis=0)).max() < 0.07
    assert np.array_equal(coarse.push[:, 0] != 0, (coarse.log.time >= 0.5) & (coarse.log.time < 1.0))


def test_exact_sensors_add_nothing(arm: Arm) -> None:
    controller = Controller(arm, "admittance_joint", Guard(Safe.ZERO))
    result = run(arm, controller, PATH, PUSHES, Sensors.exact(2))
    assert np.array_equal(stacked(result, "motor_position"), result.state[:, :2])
    assert np.array_equal(stacked(result, "joint_position"), result.state[:, 2:4])
    assert np.array_equal(stacked(result, "motor_current")[1:], stacked(result, "motor_current_command")[:-1])
    assert not stacked(result, "motor_current")[0].any()
    assert np.array_equal(result.log.columns["tip_force_x"], result.push[:, 0])
    assert {"joint_position_reference_1", "joint_position_reference_2"} <= set(result.log.columns)


def test_the_file_gives_resolution_and_noise_where_nothing_is_said(arm: Arm) -> None:
    result = run(arm, Controller(arm, "position", Guard(Safe.ZERO)), PATH)
    step = arm.robot["joints"][0]["sensor"]["motor_encoder_resolution"]
    counts = stacked(result, "motor_position")[:, 0] / step
    assert step > 0 and np.abs(counts - np.round(counts)).max() < 1e-6


@pytest.mark.parametrize("delay", [1, 3, 8])
def test_a_delay_shifts_what_the_controller_sees(arm: Arm, delay: int) -> None:
    """The same torques come out where the same samples are fed late by hand."""
    controller = Controller(arm, "admittance_cartesian", Guard(Safe.ZERO))
    result = run(arm, controller, PATH, PUSHES, Sensors(delay=delay))
    assert result.status.min() >= 0
    theta, q = stacked(result, "motor_position"), stacked(result, "joint_position")
    force = np.column_stack([result.log.columns[f"tip_force_{axis}"] for axis in "xy"])
    fed, rows = Controller(arm, "admittance_cartesian", Guard(Safe.ZERO)), PATH.rows()
    for k in range(1200):
        late = max(0, k - delay)
        fed.tick(k * 1e-3, rows[k], motor_position=theta[late], joint_position=q[late], tip_force=force[late])
        assert np.array_equal(fed.torque, result.torque[k]), k


def test_the_plant_may_differ_from_what_the_controller_knows(arm: Arm, build: Callable[..., Compiled]) -> None:
    plant = Arm(build("paper").folder)
    plant.parameters["coulomb_friction_1"] *= 1.1
    runs = [
        run(body, Controller(arm, "position", Guard(Safe.ZERO)), PATH, (), Sensors.exact(2)) for body in (arm, plant)
    ]
    assert not np.array_equal(runs[0].state, runs[1].state)
    assert np.abs(runs[0].tip - runs[1].tip).max() < 1e-3


def test_the_drives_report_a_speed(arm: Arm) -> None:
    """Differences of their encoders: what a controller that is to damp after a fault stands on."""
    controller = Controller(arm, "position", Guard(Safe.DAMPING, safe_damping=(2e-3, 2e-3)))
    result = run(arm, controller, circle(0.05, (0.2, 0.0), 2.0, 0.8), (), Sensors())
    theta = stacked(result, "motor_position")
    assert np.allclose(controller.motor_velocity, (theta[-1] - theta[-2]) / 1e-3, rtol=1e-12)
    assert np.allclose(controller.motor_velocity, result.state[-1, 4:6], atol=2 * 1.6)
    assert np.abs(result.state[-1, 4:6]).max() > 20


def test_a_robot_that_takes_torque_is_logged_as_torque(build: Callable[..., Compiled]) -> None:
    arm = Arm(build(chain("RR", 1)).folder)
    guard = Guard(Safe.ZERO, torque_limit=(50.0, 50.0), torque_rate=(1e5, 1e5))
    still = Reference("joint", 1e-3, np.full((50, 2), 0.6), *np.zeros((2, 50, 2)))
    result = run(arm, Controller(arm, "position", guard), still, (), Sensors.exact(2))
    assert np.array_equal(stacked(result, "motor_torque_command"), result.torque)


def test_ideal_is_the_step_response(arm: Arm) -> None:
    controller = Controller(arm, "impedance_cartesian", Guard(Safe.ZERO))
    moved = simulate_ideal_admittance(controller, np.tile([10.0, 0.0], (3000, 1)), 1e-3)
    M, B, K = (controller.gains[f"{what}_x"] for what in ("mass", "damping", "stiffness"))
    t, a, w = np.arange(3000) * 1e-3, B / (2 * M), np.sqrt(K / M - (B / (2 * M)) ** 2)
    closed = 10 / K * (1 - np.exp(-a * t) * (np.cos(w * t) + a / w * np.sin(w * t)))
    assert np.abs(moved[:, 0] - closed).max() < 1e-14 and not moved[:, 1].any()
    with pytest.raises(PlantError, match="position has no Cartesian mass"):
        simulate_ideal_admittance(Controller(arm, "position", Guard(Safe.ZERO)), moved, 1e-3)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"reference": circle(0.05, (0.4, 0.0), 5.0, 0.1)}, "does not reach"),
        ({"reference": circle(0.05, (0.2, 0.0), 5.0, 0.1, 2e-3)}, "make them equal"),
        ({"reference": Reference("tip", 1e-3, *np.zeros((3, 5, 3)))}, "2 entries a row"),
        ({"reference": Reference("joint", 1e-3, *np.full((3, 5, 2), np.nan))}, "finite"),
        ({"reference": Reference("tip", 1e-3, *np.zeros((3, 0, 2)))}, "at least one row"),
        ({"start": (0.6,)}, "2 joint positions"),
        ({"pushes": [Push(2.0, 1.0, (1.0, 0.0))]}, "a push lasts"),
        ({"pushes": [Push(0.0, 1.0, (np.nan, 0.0))]}, "a push lasts"),
        ({"sensors": Sensors(delay=-1)}, "delay is a whole number"),
        ({"sensors": Sensors(delay=0.5)}, "delay is a whole number"),  # type: ignore[arg-type]
        ({"sensors": Sensors(force_noise=np.nan)}, "force_noise"),
        ({"sensors": Sensors(joint_resolution=(1e-5,))}, "joint_encoder_resolution takes 2"),
        ({"sensors": Sensors(current_noise=(-1.0, 0.0))}, "current_noise takes 2"),
        ({"seed": -1}, "the seed is a whole number"),
    ],
)
def test_a_wrong_run_is_one_sentence(arm: Arm, change: dict[str, Any], words: str) -> None:
    controller = Controller(arm, "impedance_cartesian", Guard(Safe.ZERO))
    with pytest.raises(PlantError, match=words) as caught:
        run(**{"arm": arm, "controller": controller, "reference": replace(PATH), **change})
    assert len(str(caught.value).splitlines()) == 1


def test_a_controller_of_another_arm_is_refused(arm: Arm, build: Callable[..., Compiled]) -> None:
    other = Arm(build(chain("RPR", 1)).folder)
    with pytest.raises(PlantError, match="of an arm with 2 joints and the plant has 3"):
        run(other, Controller(arm, "impedance_cartesian", Guard(Safe.ZERO)), PATH)


# -- the command ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def command(build: Callable[..., Compiled], tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    environment = {**os.environ, "HDAGEN_BUILD": str(build("paper").folder.parent), "PYTHONPATH": str(ROOT)}
    work = tmp_path_factory.mktemp("command")

    def started(*arguments: str) -> subprocess.CompletedProcess[str]:
        line = [sys.executable, "-m", "hdagen", "simulate", *arguments]
        return subprocess.run(line, cwd=work, env=environment, capture_output=True, text=True, timeout=60, check=False)

    return started


def test_the_command_writes_a_log_and_says_what_came_out(command: Callable[..., Any], tmp_path: Path) -> None:
    out = tmp_path / "circle.csv"
    push = ["--push", "0.5", "0.8", "6", "0"]
    done = command("--seconds", "1", *push, "--gain", "stiffness_x=800", "--json", "--out", str(out))
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["rows"] == 1000 == len(read(out)) and figures["ticks_refused"] == 0
    assert figures["largest_gap"] < 0.1 * figures["largest_ideal_displacement"]


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--gain", "stiffness_z=1"], "no gain named stiffness_z; there are stiffness_x"),
        (["--gain", "stiffness_x"], "NAME=VALUE"),
        (["--gain", "stiffness_x=nan"], "gain stiffness_x is nan"),
        (["--radius", "0.9"], "does not reach"),
        (["--turn", "0"], "found turn 0.0"),
        (["--seed", "-1", "--seconds", "1"], "seed"),
        (["no_such_robot"], "no_such_robot"),
    ],
)
def test_wrong_command_lines_are_one_sentence(command: Callable[..., Any], arguments: list[str], words: str) -> None:
    done = command(*arguments)
    assert done.returncode == 2 and words in done.stderr
    assert "Traceback" not in done.stderr and not done.stdout


def test_encoders_have_the_noise_that_is_given_and_nothing_else_changes(arm: Arm) -> None:
    """Before counting; the noise of current and force of the same seed stays what it was."""
    controller = Controller(arm, "impedance_cartesian", Guard(Safe.ZERO))
    still, exact = run(arm, controller, PATH, (), Sensors.exact(2), 4), Sensors.exact(2)
    noisy = replace(exact, motor_noise=(1e-3, 1e-3), joint_noise=(0.0, 2e-6), current_noise=(0.1, 0.1))
    found = run(arm, controller, PATH, (), noisy, 4)
    again = run(arm, controller, PATH, (), replace(noisy, motor_noise=(0.0, 0.0), joint_noise=(0.0, 0.0)), 4)
    truth = arm.outputs(found.state, np.zeros((len(found.state), 4)))["joint_position"][:, 1]
    wobble = found.log["joint_position_2"] - truth
    assert np.std(wobble) == pytest.approx(2e-6, rel=0.1)
    assert np.array_equal(again.state, still.state)
    with pytest.raises(PlantError, match="motor_encoder_noise takes 2"):
        run(arm, controller, PATH, (), Sensors(motor_noise=(1e-3,)), 4)
