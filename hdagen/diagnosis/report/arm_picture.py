"""The report's picture of an arm in space: its measured motion, with the joints that the verdict names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.report.effect_words import name_joint
from hdagen.log.measured_log import Log
from hdagen.pages.space_animation import animate_arm_in_space
from hdagen.prediction.measurement_model import read_joint_angles

CAPTION = "The arm as the log measured it; what the verdict names is marked. Drag to turn it."


def draw_arm_motion(arm: Arm, log: Log, content: Mapping[str, Any]) -> list[str]:
    """Draw the motion of a log.

    Args:
        arm: The arm.
        log: The log.
        content: Of diagnosis.json.

    Returns:
        The figure; none of an arm in the plane.

    """
    if not arm.moves_in_space:
        return []
    joints = content.get("joints", ())
    points = arm.evaluate("points", q=read_joint_angles(arm, log))["points"].reshape(len(log), arm.n + 1, 3)
    points = np.concatenate([np.zeros((len(log), 1, 3)), points], axis=1)
    names = ["base", *(name_joint(j, joints) for j in range(1, arm.n + 1)), "tip"]
    marked = sorted({int(entry.partition("@")[2]) for entry in content["verdict"]} - {0})
    gravity = np.array([component["nominal"] for component in arm.robot["gravity"]])
    up = -gravity if gravity.any() else np.array([0.0, 0.0, 1.0])
    return [
        animate_arm_in_space("The arm in the log", log.time, points, names=names, marked=marked, up=up, caption=CAPTION)
    ]
