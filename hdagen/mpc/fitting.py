"""Whether a configuration fits a robot: problems are found before anything is built, one sentence each."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hdagen.mpc.keys import KEYS

if TYPE_CHECKING:
    from hdagen.mpc.configuration import Configuration, Wall

UNLIMITED = 1e6
SLIGHT = 1e-9  # m


def each(value: Any, count: int) -> list[float]:
    """Give each joint or axis its number.

    Args:
        value: One number for all, or a tuple with one for each.
        count: Count of joints or axes.

    Returns:
        The numbers; a tuple keeps its own length.

    """
    if isinstance(value, tuple):
        return [float(v) for v in value]
    return [float(value)] * count


def gains_of(c: Configuration) -> dict[str, float]:
    """List the admittance by the names that a Cartesian law has for its gains.

    Args:
        c: The configuration.

    Returns:
        ``mass_x`` to ``stiffness_y``, SI.

    """
    out = dict[str, float]()
    for name in ("mass", "damping", "stiffness"):
        values = each(c[f"admittance.{name}"], 2)
        out |= {f"{name}_{axis}": value for axis, value in zip("xy", values, strict=False)}
    return out


def limits_of(robot: Mapping[str, Any], c: Configuration) -> dict[str, list[float]]:
    """Take the soft limits of the joints from the configuration, else from the robot file.

    Args:
        robot: Description of the robot, as the manifest of a build holds it.
        c: The configuration.

    Returns:
        ``joint_low`` and ``joint_high`` (rad or m), ``motor_speed`` (rad/s), ``joint_torque`` (N m or N), by joint;
        UNLIMITED where neither states a limit.

    """
    joints = robot["joints"]
    out: dict[str, list[float]] = {name: [] for name in ("joint_low", "joint_high", "motor_speed", "joint_torque")}
    for joint in joints:
        stated = joint["limits"]
        low, high = stated["position"] or (-UNLIMITED, UNLIMITED)
        speed, torque = UNLIMITED, UNLIMITED
        if stated["speed"] is not None:
            speed = stated["speed"] * abs(joint["drive"]["ratio"]["nominal"])
        if stated["torque"] is not None:
            torque = stated["torque"]
        for values, value in zip(out.values(), (low, high, speed, torque), strict=True):
            values.append(value)
    given = {name: c[f"limits.{name}"] for name in out}
    return out | {name: each(value, len(joints)) for name, value in given.items() if value is not None}


def refusals(robot: Mapping[str, Any], c: Configuration) -> list[str]:
    """Find the reasons why a configuration does not fit a robot.

    Args:
        robot: Description of the robot, as the manifest of a build holds it.
        c: The configuration.

    Returns:
        One sentence for each problem.

    """
    found = list(_counts(robot, c))
    if found:
        return found
    limits = limits_of(robot, c)
    found += [
        f"limits.joint_low is {low:g} and limits.joint_high {high:g} rad at joint {j}, the robot file's where the "
        f"configuration gives none, and nothing lies between them; correct them."
        for j, (low, high) in enumerate(zip(limits["joint_low"], limits["joint_high"], strict=True), 1)
        if low >= high
    ]
    if c["limits.motor_current"] is not None:
        lacking = [j for j, joint in enumerate(robot["joints"], 1) if joint["drive"]["torque_constant"] is None]
        if lacking:
            found.append(
                f"limits.motor_current needs a torque_constant in the robot file, which joint {lacking[0]} has not; "
                "give limits.motor_torque."
            )
    if all(joint["kind"] == "revolute" for joint in robot["joints"]):
        reach = sum(joint["length"]["nominal"] for joint in robot["joints"])
        away = nearest(c.walls)
        if away is not None and away > reach + SLIGHT:
            found.append(
                f"the walls leave only what is {away:.4g} m and more from the base, and the arm is {reach:.4g} m long; "
                "move one."
            )
    return found


def _counts(robot: Mapping[str, Any], c: Configuration) -> Iterator[str]:
    """Problems with the length of lists."""
    joints = len(robot["joints"])
    counts = {"axes": joints, "joints": joints}
    if c["mpc.space"] == "tip":
        counts["axes"] = 2
    for key in KEYS:
        if key.kind not in counts:
            continue
        value, count = c[key.path], counts[key.kind]
        if isinstance(value, tuple) and len(value) != count:
            yield f"{key.path} has {len(value)} numbers and there are {count} {key.kind}; give one, or {count}."


def nearest(walls: Sequence[Wall]) -> float | None:
    """Find how near to the base the walls let the tip come.

    The nearest point is the base itself, its foot on a wall, or a crossing of two walls.

    Args:
        walls: The walls.

    Returns:
        The distance, m; None where no point lies behind all walls.

    """
    lines = [(*wall.normal, wall.offset) for wall in walls]
    points = [(0.0, 0.0)] + [(x * offset, y * offset) for x, y, offset in lines]
    for (a, b, one), (p, q, other) in itertools.combinations(lines, 2):
        across = a * q - b * p
        if abs(across) > 1e-12:
            points.append(((one * q - other * b) / across, (other * a - one * p) / across))
    distances = []
    for x, y in points:
        if all(a * x + b * y <= offset + SLIGHT for a, b, offset in lines):
            distances.append(math.hypot(x, y))
    return min(distances, default=None)
