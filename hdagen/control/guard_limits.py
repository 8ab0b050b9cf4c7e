"""Limits of a guard: given by the caller, else from the robot file, and packed for the compiled guard."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array, is_number
from hdagen.arm.compiled_arm import Arm

UNLIMITED_FORCE = 1e100
NEVER_TICKS = 2**31 - 1


class Safe(Enum):
    """The safe state of a controller after a fault; there is no default."""

    ZERO = 1  # no torque
    DAMPING = 2  # against the motors' speed
    HOLD = 3  # about the motors' positions at the fault


@dataclass(frozen=True)
class Guard:
    """Limits of a controller. None: from the robot file; where that states none, the limit must be given here.

    Torques are at the motors, jumps per tick. ``stale_*``: ticks after which an unchanged stamp, or unchanged bits, are
    a fault. ``torque_limit`` from the robot file is the motor's limit, not the flexspline's: behind a blocked output
    the joint takes ratio times as much. Where that counts, give limits.torque / ratio; fast motions then become slower,
    because the rotors' own inertia takes a part of the torque.
    """

    safe: Safe
    period: float = 1e-3  # s
    period_share: tuple[float, float] = (0.5, 2.0)  # shortest and longest tick, in periods
    watchdog: float = 0.02  # s
    torque_limit: tuple[float, ...] | None = None  # N m
    torque_rate: tuple[float, ...] | None = None  # N m/s
    force_limit: float = UNLIMITED_FORCE  # N, static, at the tip
    motor_jump: tuple[float, ...] | None = None  # rad; None: 2 x speed limit x period + an encoder's step
    joint_jump: tuple[float, ...] | None = None  # rad
    stale_stamp_ticks: int = 5
    stale_bits_ticks: int = NEVER_TICKS
    safe_damping: tuple[float, ...] = field(default=())  # N m s/rad, for DAMPING and HOLD
    safe_stiffness: tuple[float, ...] = field(default=())  # N m/rad, for HOLD


def pack_limits(arm: Arm, guard: Guard, problems: list[str]) -> Array:
    """Pack the guard's numbers in the order of hda_bridge.h.

    Args:
        arm: The arm, whose robot file gives the limits that the guard leaves open.
        guard: The guard.
        problems: A sentence on each wrong number is added here.

    Returns:
        The numbers, SI; none of them where there are problems.

    """
    if not isinstance(guard.safe, Safe):
        problems.append(f"safe is one of {', '.join(map(str, Safe))}, not {guard.safe}.")
    for name in ("stale_stamp_ticks", "stale_bits_ticks"):
        if not isinstance(getattr(guard, name), int) or not 1 <= getattr(guard, name) <= NEVER_TICKS:
            problems.append(f"{name} is a whole number from 1 to {NEVER_TICKS}, not {getattr(guard, name)}.")
    if np.shape(guard.period_share) != (2,):
        problems.append(f"period_share is two numbers, shortest and longest, not {guard.period_share}.")
    n = arm.n
    sources = {
        "torque_limit": "torque_constant and max_current in [joint.drive], or torque in [joint.limits]",
        "torque_rate": "motor_torque_rate in [joint.limits]",
    }
    stated = _find_stated_limits(arm, guard.period)
    values = []
    for name in (*stated, "safe_damping", "safe_stiffness"):
        given = getattr(guard, name)
        chosen = stated.get(name, [])
        if given is not None:
            chosen = list(np.atleast_1d(given)) or [0.0] * n
        if len(chosen) == n and all(is_number(value) for value in chosen):
            values += chosen
        elif given is None and name in sources:
            problems.append(
                f"{name}: the robot file does not state it for every joint; write {sources[name]} of each, or give "
                f"the guard {n} values."
            )
        elif given is not None or name not in stated:
            # a jump that the robot file gives is wrong only with its period, named above
            problems.append(f"{name} takes {n} numbers, one a joint, not {given}.")
    if problems:
        return np.empty(0)
    period = [guard.period, *(share * guard.period for share in guard.period_share)]
    return np.array([*period, guard.watchdog, guard.force_limit, *values], float)


def _find_stated_limits(arm: Arm, period: float) -> dict[str, list[Any]]:
    """The limits that the robot file states, by name, one a joint; None where it states none."""
    joints = arm.robot["joints"]
    drives = [joint["drive"] for joint in joints]
    limits = [joint["limits"] for joint in joints]
    sensors = [joint["sensor"] for joint in joints]
    return {
        "torque_limit": [_find_largest_torque(drive, limit) for drive, limit in zip(drives, limits, strict=True)],
        "torque_rate": [limit["motor_torque_rate"] for limit in limits],
        "motor_jump": [
            _find_largest_jump(limit["speed"], period, drive["ratio"]["nominal"], sensor["motor_encoder_resolution"])
            for limit, drive, sensor in zip(limits, drives, sensors, strict=True)
        ],
        "joint_jump": [
            _find_largest_jump(limit["speed"], period, 1.0, sensor["joint_encoder_resolution"])
            for limit, sensor in zip(limits, sensors, strict=True)
        ],
    }


def _find_largest_torque(drive: Mapping[str, Any], limit: Mapping[str, Any]) -> float | None:
    """The largest motor torque that the robot file allows, N m: that of the largest current, or, where the input is a
    torque, that of the joint's limit."""
    constant, current, torque = drive["torque_constant"], drive["max_current"], limit["torque"]
    if constant is None and torque:
        return torque / abs(drive["ratio"]["nominal"])
    if constant is not None and current:
        return constant["nominal"] * current
    return None


def _find_largest_jump(speed: float | None, period: float, ratio: float, resolution: float) -> float:
    """The largest plausible step of an encoder in a tick that comes as late as it may, with its own resolution."""
    if speed is None:
        return UNLIMITED_FORCE
    return 2 * abs(ratio) * speed * period + resolution
