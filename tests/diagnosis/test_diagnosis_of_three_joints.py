"""An arm of more joints than two: what one of them lacks is named there."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import arms
import numpy as np
import pytest
from compiled import Compiled
from replayed import simulated

from hdagen.__main__ import main
from hdagen.arm.compiled_arm import Arm
from hdagen.log.measured_log import write

ARM = arms.arm("RRR", drive="torque_constant = 0.05\nmax_current = 20.0")


@pytest.mark.campaign
@pytest.mark.parametrize("joint", [1, 3])
def test_what_one_of_three_joints_lacks_is_named(joint: int, build: Callable[..., Compiled], tmp_path: Path) -> None:
    """Twice the Coulomb friction that the robot file states."""
    robot = tmp_path / "robot.toml"
    robot.write_text(ARM)
    machine = Arm(build(ARM).folder)
    machine.parameters[f"coulomb_friction_{joint}"] *= 2.0
    log = simulated(machine, 8.0)
    assert all(np.ptp(log[f"joint_position_{j}"]) > 0.1 for j in (1, 2, 3))
    write(log, tmp_path / "log.parquet")
    assert main(["diagnose", str(robot), str(tmp_path / "log.parquet"), "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert found["verdict"] == [f"coulomb_friction@{joint}"]
    assert found["gap"]["after"] < 0.1 * found["gap"]["before"]
    assert (
        found["where"][0]["joint"] == joint and len({j for j in range(1, 4) if f"mass_{j}" in found["parameters"]}) == 3
    )
