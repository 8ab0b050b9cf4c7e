"""`hdagen.excite`: the safe motion that separates effects best."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from hdagen.api.robot_loading import RobotSource, find_robot_file
from hdagen.arm.compiled_arm import load
from hdagen.excitation import optimal_motion
from hdagen.excitation.optimal_motion import Excitation


def excite(
    robot: RobotSource,
    separate: Sequence[str] = (),
    *,
    joint: int | str = 1,
    duration: float = 10.0,
    period: float = 1e-3,
    limits: Mapping[str, tuple[float, ...]] | None = None,
    on_motion: Callable[[str], None] | None = None,
) -> Excitation:
    """Design the safe motion whose log separates effects best.

    Args:
        robot: A preset, the path of a robot.toml, or a robot that `hdagen.load_robot` loaded.
        separate: Names of effects of ``joint``, or name@joint; none: every pair of the joint's effects.
        joint: Number of the joint, from 1, or its name.
        duration: Length of the motion, s.
        period: Time from row to row, s.
        limits: Narrower limits than the robot file's: ``{"speed": (0.5,), "position_1": (-0.5, 0.5)}``.
        on_motion: Is called with the name of each motion as it is tried.

    Returns:
        All motions that were tried, the best first, and the reference of the best one.

    Raises:
        PlantError: An argument is not possible, or no motion keeps the limits.

    """
    arm = load(find_robot_file(robot), "native", ("all",))
    return optimal_motion.excite(arm, separate, joint, duration, period, limits, on_motion or _ignore_motion)


def _ignore_motion(name: str) -> None:
    """Hear the name of a motion and do nothing."""
