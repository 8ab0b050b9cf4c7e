"""The path that `hdagen simulate` is asked for: of the tip or of the joints, and the posture where it begins."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hdagen.arm.arrays import Array
    from hdagen.arm.compiled_arm import Arm
    from hdagen.control.reference_motion import Reference

TIP_SHAPES = ("circle", "line", "lissajous")
JOINT_PATHS = ("swing", "multisine")


def add_path_arguments(p: argparse.ArgumentParser) -> None:
    """Add the arguments that state a path.

    Args:
        p: The parser of the command.

    """
    p.add_argument(
        "--path",
        choices=(*TIP_SHAPES, *JOINT_PATHS),
        help="of the tip or, swing and multisine, of the joints (default: circle; swing in space below six joints)",
    )
    p.add_argument(
        "--waypoints",
        type=Path,
        metavar="FILE.csv",
        help="columns time and x, y, z[, rx, ry, rz] (in the plane x, y) or joint_position_1 …; in place of --path",
    )
    p.add_argument("--radius", type=float, default=0.05, help="of the circle, and size of other paths of the tip, m")
    p.add_argument(
        "--center",
        nargs=2,
        type=float,
        metavar=("X", "Y"),
        help="of the circle in the plane, m (default: two thirds of the reach)",
    )
    p.add_argument(
        "--direction",
        nargs="+",
        type=float,
        metavar="NUMBER",
        help="X Y [Z]: of the line; in space also the axis of the circle (default: the last axis of the base)",
    )
    p.add_argument(
        "--posture",
        nargs="+",
        type=float,
        metavar="NUMBER",
        help="joint positions where a path of the tip begins, rad or m (default: in space one far from singular)",
    )
    p.add_argument("--turn", type=float, default=5.0, help="seconds a turn")


def choose_posture(arm: Arm, options: argparse.Namespace) -> Array:
    """Choose the joint positions near which a path of the tip begins.

    Args:
        arm: The arm.
        options: The parsed arguments.

    Returns:
        (n), rad (m where prismatic).

    Raises:
        PlantError: The stated posture is not of this arm.

    """
    import numpy as np

    from hdagen.arm.build_loader import PlantError
    from hdagen.control.pose_kinematics import choose_open_posture

    if options.posture is not None:
        stated = np.array(options.posture)
        if stated.shape != (arm.n,) or not np.isfinite(stated).all():
            raise PlantError(f"--posture takes {arm.n} finite numbers, one a joint, not {options.posture}.")
        return stated
    if arm.moves_in_space:
        return choose_open_posture(arm)
    return np.full(arm.n, 0.6)


def make_path(arm: Arm, options: argparse.Namespace, posture: Array, period: float) -> Reference:
    """Make the path that the arguments state.

    Args:
        arm: The arm.
        options: The parsed arguments.
        posture: (n), joint positions near which a path of the tip begins.
        period: The time between ticks, s.

    Returns:
        The motion.

    Raises:
        PlantError: An argument is not possible for this arm.
        LogError: The file of waypoints cannot be read.

    """
    from hdagen.arm.build_loader import PlantError
    from hdagen.control.joint_swing import SINES, swing_joints
    from hdagen.control.reference_motion import circle
    from hdagen.control.tip_paths import make_tip_path
    from hdagen.control.waypoints import read_waypoints

    if options.waypoints is not None:
        if options.path:
            raise PlantError("--waypoints stand in place of --path; leave one of them out.")
        return read_waypoints(options.waypoints, arm, posture, period)
    shape = options.path or _choose_shape(arm, options.controller)
    if options.center and (arm.moves_in_space or shape != "circle"):
        raise PlantError("--center is of the circle of an arm in the plane; other paths begin at the tip of --posture.")
    if shape in JOINT_PATHS:
        return swing_joints(arm, options.turn, options.seconds, period, 1 if shape == "swing" else SINES)
    if shape == "circle" and not arm.moves_in_space:
        reach = sum(joint["length"]["nominal"] for joint in arm.robot["joints"])
        center = tuple(options.center or (2 * reach / 3, 0.0))
        return circle(options.radius, center, options.turn, options.seconds, period)
    begin = find_tip(arm, posture)
    return make_tip_path(shape, begin, options.radius, options.turn, options.seconds, options.direction, period)


def find_tip(arm: Arm, posture: Array) -> Array:
    """Find the tip of a posture as a reference states it.

    Args:
        arm: The arm.
        posture: (n), joint positions.

    Returns:
        (2), the position, m; in space (6), after it the rotation vector, rad.

    """
    from hdagen.control.pose_kinematics import find_tip_pose

    if arm.moves_in_space:
        return find_tip_pose(arm, posture)
    return arm.evaluate("points", q=posture)["points"][-2:]


def _choose_shape(arm: Arm, controller: str | None) -> str:
    """The usual path: a circle, for which an arm in space needs six joints, or a law of the tip that is asked for."""
    if arm.moves_in_space and arm.n < 6 and not (controller or "").endswith("cartesian"):
        return "swing"
    return "circle"


def name_posture(arm: Arm, gains: tuple[str, ...], posture: Array) -> dict[str, float]:
    """Make a posture the one to which a law pulls the joints that leave the tip where it is.

    Args:
        arm: The arm.
        gains: Names of the law's gains.
        posture: (n), joint positions.

    Returns:
        The gains by name; none for a law without a posture.

    """
    names = [f"posture_{j}" for j in range(1, arm.n + 1)]
    return {name: float(value) for name, value in zip(names, posture, strict=True) if name in gains}
