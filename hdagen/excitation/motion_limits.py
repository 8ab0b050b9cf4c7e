"""The limits that a motion of an arm keeps: those of the robot file, narrowed by the user, and assumed where none are
stated; and the middle posture about which to move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.joint_names import list_joint_names, number_joint
from hdagen.arm.ratings import compute_rated_torque, compute_torque_per_input
from hdagen.support.messages import join_names

GRAVITY_SHARE = 0.6  # of torque and current that gravity may take in the middle posture
ASSUMED_LIMITS = {"revolute": (0.5, 1.0), "prismatic": (0.05, 0.2)}  # to each side of the start, rad (m); rad/s (m/s)
START_ANGLE = 0.6  # rad: where a joint without a range starts; of a prismatic one 0


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of a motion: position (n, 2) rad or m; speed (n); torque (n) at the joint, N m; current (n) in the motors'
    unit of input; tip (2, 2), or (3, 2) in space, m, of x, y and z in the base frame, infinite where there is none.
    ``notes``: the assumed ones, in sentences."""

    position: Array
    speed: Array
    torque: Array
    current: Array
    tip: Array
    notes: tuple[str, ...] = ()


def narrow_limits(arm: Arm, given: Mapping[str, tuple[float, ...]] | None = None) -> MotionLimits:
    """Take the robot file's limits and narrow them.

    Args:
        arm: The arm.
        given: Narrower limits by name: position[_j], tip_x, tip_y and in space tip_z (low, high; of the tip one of
            them may be infinite), speed[_j], torque[_j], current[_j] (one number), each of all joints or of joint j,
            which is a number or a name.

    Returns:
        The limits.

    Raises:
        PlantError: A limit does not exist, or is wider than the robot file's; the message has every problem.

    """
    stated, assumed = _read_stated_limits(arm)
    position, tip = stated.position.copy(), stated.tip.copy()
    most = {"speed": stated.speed.copy(), "torque": stated.torque.copy(), "current": stated.current.copy()}
    problems: list[str] = []
    tips = name_tip_limits(arm)
    for name, values in (given or {}).items():
        kind, number = _split_limit_name(arm, name)
        if kind not in ("position", "tip", *most) or (number and not 1 <= int(number) <= arm.n):
            problems.append(
                f"--limits {name}: no such limit; there are position, speed, torque, current (of all joints, or _1 to "
                f"_{arm.n} or _name of one), {join_names(tips)}."
            )
            continue
        ranged, possible = kind in ("position", "tip"), "one number"
        if ranged:
            possible = "LOW:HIGH, low first"
        is_finite = np.isfinite(values).sum() >= len(values) - (kind == "tip")  # a wall on one side is possible
        if len(values) != 1 + ranged or not is_finite or (ranged and not values[0] < values[1]):
            problems.append(f"--limits {name}: give {possible}.")
        elif not ranged and not values[0] > 0:
            problems.append(f"--limits {name}={values[0]:g}: admits no motion; give a number above 0.")
        elif kind == "tip":
            tip[tips.index(name)] = values
        else:
            chosen = list(range(arm.n))
            if number:
                chosen = [int(number) - 1]
            for j in chosen:
                problems += _narrow_joint_limit(arm, j, name, kind, values, position, most)
                assumed.pop((kind, j), None)
    if problems:
        raise PlantError("\n".join(problems))
    return MotionLimits(position, most["speed"], most["torque"], most["current"], tip, tuple(assumed.values()))


def name_tip_limits(arm: Arm) -> list[str]:
    """Name the limits of the tip's position, one an axis.

    Args:
        arm: The arm.

    Returns:
        The names.

    """
    return [f"tip_{axis}" for axis in "xyz"[: arm.dimensions]]


def _split_limit_name(arm: Arm, name: str) -> tuple[str, str]:
    """The kind of a limit and the number of its joint; empty where it is of all joints or of the tip."""
    if name in name_tip_limits(arm):
        return "tip", ""
    kind, _, joint = name.partition("_")
    number = number_joint(joint, list_joint_names(arm))
    return (kind, number) if number.isdecimal() else (name, "")


def _narrow_joint_limit(
    arm: Arm, j: int, name: str, kind: str, values: tuple[float, ...], position: Array, most: Mapping[str, Array]
) -> list[str]:
    """Set one limit of joint ``j`` (from 0), or say why it cannot be set."""
    joint = arm.robot["joints"][j]
    file = (joint["limits"] | {"current": joint["drive"]["max_current"]})[kind]
    if kind == "position":
        if file and (values[0] < file[0] or values[1] > file[1]):
            return [
                f"--limits {name}: wider than the robot file's {file[0]:g} to {file[1]:g}; it may be narrower only."
            ]
        position[j] = values
    elif file and values[0] > file:
        return [f"--limits {name}={values[0]:g}: above the robot file's {file:g}; it may be narrower only."]
    else:
        most[kind][j] = values[0]
    return []


def find_limit_units(arm: Arm, j: int) -> dict[str, str]:
    """Name the units of a joint's limits.

    Args:
        arm: The arm.
        j: Number of the joint, from 0.

    Returns:
        The unit of each kind of limit.

    """
    length, effort = {"revolute": ("rad", "N m"), "prismatic": ("m", "N")}[arm.robot["joints"][j]["kind"]]
    return {
        "position": length,
        "speed": f"{length}/s",
        "torque": effort,
        "current": arm.manifest["input"][j]["unit"],
    }


def _read_stated_limits(arm: Arm) -> tuple[MotionLimits, dict[tuple[str, int], str]]:
    """The robot file's limits, and a sentence on each assumed one by (kind, joint from 0)."""
    n, assumed, full = arm.n, {}, compute_rated_torque(arm)
    position = np.empty((n, 2))
    most = {kind: np.empty(n) for kind in ("speed", "torque", "current")}
    for j, joint in enumerate(arm.robot["joints"]):
        own, drive, slot, unit = joint["limits"], joint["drive"], arm.manifest["input"][j], find_limit_units(arm, j)
        start = {"revolute": START_ANGLE, "prismatic": 0.0}[joint["kind"]]
        reach, fast = ASSUMED_LIMITS[joint["kind"]]
        position[j] = own["position"] or (start - reach, start + reach)
        if not own["position"]:
            low, high = position[j]
            taken = f"{low:.3g} to {high:.3g} {unit['position']}"
            assumed["position", j] = f"position of joint {j + 1}: no limit is stated; {taken} is assumed."
        for kind, stated, without in (
            ("speed", own["speed"], fast),
            ("torque", own["torque"], full[j]),
            ("current", drive["max_current"], slot["bound"]),
        ):
            most[kind][j] = stated or without
            if not stated:
                assumed[kind, j] = (
                    f"{kind} of joint {j + 1}: no limit is stated; {without:.3g} {unit[kind]} is assumed."
                )
    return MotionLimits(
        position, most["speed"], most["torque"], most["current"], np.array([[-np.inf, np.inf]] * arm.dimensions)
    ), assumed


def choose_middle_posture(arm: Arm, limits: MotionLimits) -> Array:
    """Choose the posture about which to move: nearest to the middle of the ranges among those that the motors hold
    against gravity, with the tip well within its workspace.

    Args:
        arm: The arm.
        limits: Its limits.

    Returns:
        Positions of the joints, (n,) rad or m.

    Raises:
        PlantError: There is no such posture.

    """
    center, half = limits.position.mean(1), np.diff(limits.position)[:, 0] / 2
    random = np.random.default_rng(0)
    tried = np.vstack([np.zeros(arm.n), random.uniform(-0.7, 0.7, (400, arm.n))]) * half + center
    held = np.abs(arm.evaluate("gravity_torque", q=tried)["g"])
    ratio = np.array([abs(arm.parameters[f"ratio_{j}"]) for j in range(1, arm.n + 1)])
    load = (
        np.maximum(held / limits.torque, held / (ratio * compute_torque_per_input(arm) * limits.current)).max(1)
        / GRAVITY_SHARE
    )
    tip = arm.evaluate("points", q=tried)["points"][:, -arm.dimensions :]
    inside = np.minimum(tip - limits.tip[:, 0], limits.tip[:, 1] - tip).min(1)
    able = np.flatnonzero((load < 1) & (inside > 0))
    if not len(able):
        tips = join_names(name_tip_limits(arm))
        why = f"in none of {len(tried)} postures within the joints' ranges is the tip inside {tips}"
        if (inside > 0).any():
            lightest = 100 * GRAVITY_SHARE * load[inside > 0].min()
            why = f"gravity alone takes {lightest:.0f} % of torque or current in the lightest posture"
        raise PlantError(f"the limits admit no motion: {why}; widen them.")
    away = np.linalg.norm((tried - center) / half, axis=1)
    room = np.zeros(len(tried))
    if np.isfinite(limits.tip).any():
        room = np.minimum(inside, 0.3 * inside[able].max())
    return tried[min(able, key=lambda k: (-room[k], away[k]))]
