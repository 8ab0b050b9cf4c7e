"""The least motion that an arm's encoders see, and the limits that it takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.control.reference_motion import Reference
from hdagen.diagnosis.data.split import Mask
from hdagen.excitation.motion_limits import MotionLimits, find_limit_units, narrow_limits
from hdagen.excitation.motion_shapes import MotionShape
from hdagen.excitation.safe_motion import (
    LIMIT_MARGIN,
    compute_limit_shares,
    count_encoder_steps,
    follow_reference,
    scale_motion,
)
from hdagen.simulation.simulator import Simulation

LEAST_ENCODER_STEPS = 3  # steps of its finer encoder by which a joint has to move: fewer are as good as rest
GENTLE_MOTIONS, MOST_DOUBLINGS = (
    3,
    12,
)  # motions that are run, and how often they are doubled, to find the least visible one


def count_run_steps(arm: Arm, run: Simulation) -> Array:
    """Count by how many steps of its finer encoder each joint moves in a run.

    Args:
        arm: The arm, with the robot file's sensors.
        run: A run of it.

    Returns:
        Steps of each joint, (n,).

    """
    return count_encoder_steps(arm, run.state[:, [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]])


def find_resting_joints(
    arm: Arm, limits: MotionLimits, shapes: Sequence[MotionShape], center: Array, period: float
) -> Mask:
    """Find the joints that no motion within the limits moves visibly, without a run.

    Range, speed, torque and inertia draw each motion of such a joint too small, or dry friction holds its motor against
    all current and gravity.

    Args:
        arm: The arm.
        limits: The limits.
        shapes: The motions that are tried.
        center: The middle posture, (n,) rad or m.
        period: Time from row to row, s.

    Returns:
        Whether each joint rests, (n,).

    """
    largest = np.max(
        [count_encoder_steps(arm, scale_motion(arm, limits, m, center, period, 1.0).position) for m in shapes], axis=0
    )
    dry = np.array([arm.parameters[f"coulomb_friction_{j}"] for j in range(1, arm.n + 1)])
    ratio = np.array([arm.parameters[f"ratio_{j}"] for j in range(1, arm.n + 1)])
    pull = np.abs(arm.evaluate("gravity_torque", q=center)["g"].ravel() / ratio)
    held = LIMIT_MARGIN * compute_torque_per_input(arm) * limits.current + pull < dry
    return np.asarray((largest < LEAST_ENCODER_STEPS) | held)


def find_least_shares(
    arm: Arm, limits: MotionLimits, shapes: Sequence[MotionShape], center: Array, period: float, joints: Sequence[int]
) -> dict[str, float]:
    """Shares of the limits, by name, that it takes to move one of ``joints`` (from 0) visibly: the gentlest motions are
    run within the robot file's limits alone, each ever twice as large, as dry friction holds small ones."""
    file, found = narrow_limits(arm), []
    for motion in sorted(shapes, key=lambda m: np.abs(np.diff(m.shape, axis=0)).max() / np.ptp(m.shape))[
        :GENTLE_MOTIONS
    ]:
        wave = LEAST_ENCODER_STEPS * motion.shape / max(count_encoder_steps(arm, motion.shape)[joints])
        for k in range(MOST_DOUBLINGS):
            v = np.gradient(2**k * wave, period, axis=0)
            reference = Reference("joint", period, center + 2**k * wave, v, np.gradient(v, period, axis=0))
            run, _ = follow_reference(arm, arm, reference, file)
            if run is not None and max(count_run_steps(arm, run)[joints]) >= LEAST_ENCODER_STEPS:
                found.append(compute_limit_shares(arm, limits, run, run.torque / compute_torque_per_input(arm)))
                break
    return min(found, key=lambda one: max(one.values()), default={})


def explain_narrow_limits(
    arm: Arm,
    limits: MotionLimits,
    shapes: Sequence[MotionShape],
    center: Array,
    period: float,
    joints: Sequence[int],
    whys: Sequence[str] = (),
) -> str:
    """Explain which limits admit no motion, and how wide they have to be for the least visible one.

    Args:
        arm: The arm.
        limits: The limits.
        shapes: The motions that are tried.
        center: The middle posture, (n,) rad or m.
        period: Time from row to row, s.
        joints: Numbers of the joints, from 0, of which one has to move.
        whys: Reasons for which motions were dropped.

    Returns:
        One sentence.

    """
    takes = []
    for name, share in find_least_shares(arm, limits, shapes, center, period, joints).items():
        if LIMIT_MARGIN < share < np.inf:
            noun, span, unit = _describe_limit(arm, limits, center, name)
            takes.append(f"{noun} of at least {span * share / LIMIT_MARGIN:.2g} {unit} ({span:.2g} is given)")
    if not takes:
        return f"the limits admit no motion ({'; '.join(whys)}); widen them, or move elsewhere."
    return (
        f"the limits admit no motion: one that moves joint {' or '.join(str(j + 1) for j in joints)} by"
        f" {LEAST_ENCODER_STEPS} steps of its encoder takes {' and '.join(takes)}; widen the limits."
    )


def _describe_limit(arm: Arm, limits: MotionLimits, center: Array, name: str) -> tuple[str, float, str]:
    """A limit in words, its size and its unit."""
    kind, _, number = name.rpartition("_")
    if kind == "tip":
        k = "xyz".index(number)
        low, high = limits.tip[k]
        if np.isfinite(high - low):
            return f"a range of {name}", high - low, "m"
        away = np.abs(limits.tip[k] - arm.evaluate("points", q=center)["points"][k - arm.dimensions]).min()
        return f"a way to the limit of {name}", float(away), "m"
    j = int(number) - 1
    unit = find_limit_units(arm, j)[kind]
    if kind == "position":
        low, high = limits.position[j]
        return f"a range of {name}", high - low, unit
    return name, {"speed": limits.speed, "torque": limits.torque, "current": limits.current}[kind][j], unit
