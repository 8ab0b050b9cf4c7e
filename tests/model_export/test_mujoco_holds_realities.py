"""Twelve drivetrains of other formulas than ours, with an effect each: their export closes the gap in MuJoCo.

`hdagen.blind.realities` makes the logs; the verdict states the truth, so that only the export is judged.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compiled import Compiled

from hdagen.arm.compiled_arm import Arm
from hdagen.blind.realities.arm_reality import simulate_world
from hdagen.blind.realities.arm_world import ArmWorld
from hdagen.blind.realities.two_joint_motion import draw_rich_motion
from hdagen.log.measured_log import Log
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.mjcf_writer import write
from hdagen.model_export.mujoco_proof import ProofLog

SECONDS = 3.0
LEAST_SHARE = 0.9  # of the fall of our own gap
EFFECTS = (
    *("asymmetric_friction", "current_saturation", "current_loop_lag", "command_delay", "cable_spring"),
    *("gravity_tilt", "sensor_delay"),
)
CASES: dict[str, tuple[dict[str, dict[str, float]], dict[str, float]]] = {  # of joint 2: reality's words, and ours
    "coulomb_friction": ({"coulomb_friction": {"torque": 0.018}}, {"coulomb_friction_2": 0.055}),
    "viscous_friction": ({"viscous_friction": {"coefficient": 1e-4}}, {"viscous_friction_2": 1.4e-4}),
    "asymmetric_friction": ({"asymmetric_friction": {"torque": 0.01, "speed": 0.01}}, {"asymmetric_torque_2": 0.01}),
    "torque_constant": ({"torque_constant": {"factor": 1.15}}, {"torque_constant_2": 1.15 * 0.0525}),
    "current_bias": ({"current_bias": {"current": 0.2}}, {"bias_2": 0.2 * 0.0525}),
    "current_saturation": ({"current_saturation": {"limit": 2.0}}, {"saturation_inverse_2": 0.5}),
    "current_loop_lag": ({"current_loop_lag": {"time": 0.003}}, {"current_lag_2": 0.003}),
    "command_delay": ({"command_delay": {"time": 0.004}}, {"command_delay_2": 0.004}),
    "payload": ({"payload": {"mass": 0.3}}, {"payload_mass_2": 0.3}),
    "cable_spring": (
        {"cable_spring": {"stiffness": 4.0, "rest": 0.1}},
        {"cable_stiffness_2": 4.0, "cable_rest_2": 0.1},
    ),
    "stiffness": ({"stiffness": {"factor": 0.6}}, {"stiffness_level_2": 0.6}),
    "sensor_delay": ({"sensor_delay": {"time": 0.003}}, {"sensor_delay_2": 0.003}),
}


def make_world(arm: Arm, effects: dict[str, dict[str, float]]) -> ArmWorld:
    """The robot file's numbers, and the effects at joint 2."""
    return ArmWorld([describe_joint(arm, j) for j in (1, 2)], ({}, effects), {}, (0.0, 0.0))


def describe_joint(arm: Arm, j: int) -> dict[str, Any]:
    """The keys of a joint's tables in one, as realities take them."""
    drive, sensor = (arm.robot["joints"][j - 1][table] for table in ("drive", "sensor"))
    numbers = {name.removesuffix(f"_{j}"): value for name, value in arm.parameters.items() if name.endswith(f"_{j}")}
    return numbers | sensor | {"max_current": drive["max_current"]}


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build("paper", effects=EFFECTS).folder)


@pytest.mark.campaign
@pytest.mark.parametrize("name", CASES)
def test_an_export_closes_the_gap_of_a_reality_in_mujoco(arm: Arm, name: str, tmp_path: Path) -> None:
    effects, values = CASES[name]
    world = make_world(arm, effects)
    columns = simulate_world(world, [describe_joint(arm, j) for j in (1, 2)], draw_rich_motion(7, SECONDS), 3)
    time = columns.pop("time")
    log = Log(time, {key: np.ascontiguousarray(column) for key, column in columns.items()}, 2, "reality")
    true = arm.with_parameters(arm.p)
    true.parameters.update(values)
    proof = write(
        CorrectedRobot("robot.toml", arm, true), tmp_path / "robot.xml", prove=ProofLog(log, None, (), False)
    ).proof
    assert proof is not None
    print(f"{name}: MuJoCo {proof.gaps[0]:.4g} -> {proof.gaps[1]:.4g}, ours {proof.gaps[2]:.4g} -> {proof.gaps[3]:.4g}")
    assert proof.gaps[2] > 1.5 * proof.gaps[3]
    assert proof.closed_share is not None and proof.closed_share >= LEAST_SHARE
