"""JSON: the joints' numbers by joint name, at the joint, with the conventions of the simulators that take them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import Exported
from hdagen.support.atomic_write import write_atomically

JSON_SCHEMA = 1


def write(robot: CorrectedRobot, out: Path) -> Exported:
    """Write the joints' numbers.

    Args:
        robot: The robot.
        out: The file.

    Returns:
        What was written.

    Raises:
        PlantError: The file cannot be written.

    """
    content = {"schema": JSON_SCHEMA, "robot": robot.file.robot["name"], "joints": _describe_joints(robot)}
    try:
        write_atomically(out, (json.dumps(content, indent=1) + "\n").encode())
    except OSError as error:
        raise PlantError(f"{out}: cannot be written ({error.strerror}); make room or name another place.") from None
    return Exported((out,))


def _describe_joints(robot: CorrectedRobot) -> dict[str, Any]:
    """Numbers of each joint, at the joint: a motor's are multiplied by the ratio or its square."""
    p = robot.corrected.parameters
    joints = {}
    for j, name in enumerate(robot.joint_names, 1):
        ratio = p[f"ratio_{j}"]
        joints[name] = {
            "armature": p[f"motor_inertia_{j}"] * ratio**2,
            "damping": p[f"viscous_friction_{j}"] * ratio**2,
            "frictionloss": p[f"coulomb_friction_{j}"] * ratio,
        }
    return joints
