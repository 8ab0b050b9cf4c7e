"""Whether a configuration fits a robot: what is refused before anything is built, one sentence a problem."""

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
    """One number for all, or one for each."""
    return [float(v) for v in value] if isinstance(value, tuple) else [float(value)] * count


def limits_of(robot: Mapping[str, Any], c: Configuration) -> dict[str, list[float]]:
    """Ranges, motor speeds and joint torques, from the configuration, else from the robot file."""
    joints = robot["joints"]
    stated = [joint["limits"] for joint in joints]
    out = {
        "joint_low": [-UNLIMITED if s["position"] is None else s["position"][0] for s in stated],
        "joint_high": [UNLIMITED if s["position"] is None else s["position"][1] for s in stated],
        "motor_speed": [
            UNLIMITED if s["speed"] is None else s["speed"] * abs(joint["drive"]["ratio"]["nominal"])
            for s, joint in zip(stated, joints, strict=True)
        ],
        "joint_torque": [UNLIMITED if s["torque"] is None else s["torque"] for s in stated],
    }
    given = {name: c[f"limits.{name}"] for name in out}
    return out | {name: each(value, len(joints)) for name, value in given.items() if value is not None}


def refusals(robot: Mapping[str, Any], c: Configuration) -> list[str]:
    """Why the configuration cannot be used with the robot (its description as a build's manifest holds it)."""
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
    joints = len(robot["joints"])
    axes = 2 if c["mpc.space"] == "tip" else joints
    for key in KEYS:
        count = {"axes": axes, "joints": joints}.get(key.kind)
        value = c[key.path] if count else None
        if isinstance(value, tuple) and len(value) != count:
            yield f"{key.path} has {len(value)} numbers and there are {count} {key.kind}; give one, or {count}."


def nearest(walls: Sequence[Wall]) -> float | None:
    """How near to the base the walls let the tip come, m; None where no point lies behind all of them. That point is
    the base itself, its foot on a wall, or where two walls cross."""
    lines = [(*wall.normal, wall.offset) for wall in walls]
    points = [(0.0, 0.0)] + [(x * offset, y * offset) for x, y, offset in lines]
    for (a, b, one), (p, q, other) in itertools.combinations(lines, 2):
        across = a * q - b * p
        if abs(across) > 1e-12:
            points.append(((one * q - other * b) / across, (other * a - one * p) / across))
    free = [math.hypot(x, y) for x, y in points if all(a * x + b * y <= offset + SLIGHT for a, b, offset in lines)]
    return min(free) if free else None
