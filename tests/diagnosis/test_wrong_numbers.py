"""Numbers of the robot file that are wrong: put into a simulated machine they come back, with their factor."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdagen import diagnose
from hdagen.arm.compiled_arm import load
from hdagen.diagnosis import pipeline
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.log.measured_log import Log

RESOLUTION = 1e-5  # rad
ROBOT = f"""name = "wrist"
gravity = [0.0, -9.81]
step = 1e-3
tolerance = 0.1
[[joint]]
length = 0.3
mass = 2.0
center_of_mass = 0.15
inertia = 0.03
[joint.drive]
rigid = true
ratio = 1.0
motor_inertia = 0.0  # no rotor, and so no spring to look for
viscous_friction = 0.1
coulomb_friction = 0.2
friction_smoothing = 0.05
[joint.limits]
torque = 12.0
[joint.sensor]
joint_encoder_resolution = {RESOLUTION}
"""


def move_arm(robot: Path, factors: Mapping[str, float], seconds: float = 6.0) -> Log:
    """A log of the machine whose numbers are the file's times ``factors``."""
    arm = load(robot)
    arm.parameters.update({name: factor * arm.parameters[name] for name, factor in factors.items()})
    time = np.arange(0.0, seconds, 2e-3)
    waves = np.sin(2 * np.pi * np.outer(time, [0.37, 0.9, 2.1]) + [0.0, 1.0, 2.0])
    u = np.zeros((len(time), arm.nu))
    u[:, 0] = np.minimum(2.0 * time, 1.0) * (waves @ [2.0, 1.5, 1.5])
    x = arm.rollout(arm.rest([-np.pi / 2]), u[:-1], np.diff(time), exact=True)
    angle = arm.outputs(x, u)["joint_position"][:, 0]
    columns = {
        "motor_torque_command_1": u[:, 0].copy(),
        "joint_position_1": np.round(angle / RESOLUTION) * RESOLUTION,
    }
    return Log(time, columns, 1, "made")


def find_factors(found: Diagnosis) -> dict[str, tuple[float, float]]:
    """Factor and standard deviation of each number in the verdict."""
    causes: dict[str, Any] = {f"{c['effect']}@{c['joint']}": c["parameters"] for c in found.content["causes"]}
    return {
        name: (causes[name]["factor"]["value"], causes[name]["factor"]["std"])
        for name in found.verdict
        if "factor" in causes[name]
    }


@pytest.mark.parametrize(
    ("stated", "truth"),
    [
        ("inertia_about_joint = 0.045", {}),  # a point mass, whose inertia about itself is 0 up to rounding
        ("inertia = 0.03", {"inertia_1": 2.5}),
    ],
    ids=["right", "inertia"],
)
def test_a_wrong_number_comes_back_and_a_right_one_stays(
    tmp_path: Path, stated: str, truth: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the second search, as if the first had left many times the noise."""
    robot = tmp_path / "robot.toml"
    robot.write_text(ROBOT.replace("inertia = 0.03", stated))
    monkeypatch.setattr(pipeline._JudgedSearch, "is_file_in_doubt", True)
    found = diagnose(robot, [move_arm(robot, truth)])
    factors = find_factors(found)
    assert sorted(factors) == sorted(found.verdict)
    assert sorted(name.replace("@", "_") for name in factors) == sorted(truth)
    for name, (factor, std) in factors.items():
        assert abs(factor - truth[name.replace("@", "_")]) < max(0.02 * factor, 3.0 * std)
