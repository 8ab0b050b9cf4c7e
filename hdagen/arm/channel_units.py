"""The units of a log's channels, by the joints of a robot."""

from __future__ import annotations

from hdagen.arm.compiled_arm import Arm


def find_channel_unit(arm: Arm, name: str) -> str:
    """Return the unit of a channel.

    Args:
        arm: The robot, whose joints turn or slide.
        name: Of the channel's column, as joint_position_2.

    """
    quantity, _, j = name.rpartition("_")
    slides = arm.robot["joints"][int(j) - 1]["kind"] == "prismatic"
    if "current" in quantity:
        return "A"
    if "torque" in quantity:
        if slides and arm.parameters[f"ratio_{j}"] == 1.0:  # at 1 rad/m N m and N are the same number
            return "N"
        return "N m"
    if slides and quantity == "joint_position":
        return "m"
    return "rad"
