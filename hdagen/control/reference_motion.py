"""Reference motions: a path of the tip or of the joints, sampled once a tick, as a control law takes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.pose_kinematics import count_followed_directions, solve_tip_pose

MOST_REFERENCE_ROWS = 10**8
TIP_TOLERANCE = 1e-10  # m, of the inverse kinematics
MOST_KINEMATICS_STEPS = 60  # Newton steps of the inverse kinematics


@dataclass(frozen=True)
class Reference:
    """A motion at every tick, of the tip (k = 2, m) or of the joints (k = n, rad or m).

    Of a tip in space k = 6: its position, m, and the rotation vector of its orientation, rad; velocity and
    acceleration hold the angular ones, rad/s and rad/s², all in the base frame.

    Attributes:
        space: "tip" or "joint".
        period: The time between ticks, s.
        position: (T, k).
        velocity: (T, k), a second.
        acceleration: (T, k), a second squared.

    """

    space: str
    period: float
    position: Array
    velocity: Array
    acceleration: Array

    @property
    def time(self) -> Array:
        """The instants of the ticks (T), s."""
        return np.arange(len(self.position), dtype=float) * self.period

    def rows(self) -> Array:
        """Position, velocity and acceleration side by side (T, 3 k), as a law takes them."""
        return np.ascontiguousarray(np.hstack([self.position, self.velocity, self.acceleration]))


def compute_smooth_step(share: ArrayLike) -> tuple[Array, Array, Array]:
    """Compute the minimum-jerk step: from 0 at 0 to 1 at 1 without a jump in acceleration.

    Args:
        share: Where on the step, of any shape; clipped to 0 … 1.

    Returns:
        The step, its first and its second derivative by ``share``.

    Source:
        Flash, Hogan, The coordination of arm movements, J. Neurosci. 5 (1985) 1688.

    """
    s = np.clip(np.asarray(share, float), 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)


def check_sizes(sizes: Mapping[str, float], motion: str) -> None:
    """Check the numbers of a motion: positive, finite, and together a possible number of rows.

    Args:
        sizes: The numbers by name, ``seconds`` and ``period`` among them.
        motion: The motion's name in a sentence.

    Raises:
        PlantError: A number is not possible.

    """
    if wrong := [f"{name} {value}" for name, value in sizes.items() if not 0 < value < np.inf]:
        raise PlantError(f"{motion} needs positive, finite numbers; found {', '.join(wrong)}.")
    seconds, period = sizes["seconds"], sizes["period"]
    if not 0.5 < seconds / period <= MOST_REFERENCE_ROWS:
        raise PlantError(f"{seconds} s in periods of {period} s make no motion of 1 to {MOST_REFERENCE_ROWS:g} rows.")


def advance_phase(turn: float, seconds: float, period: float, start: float = 1.0) -> tuple[Array, Array, Array]:
    """Advance a phase from rest to full speed without a jump in acceleration.

    Args:
        turn: The time of one turn at full speed, s.
        seconds: The length of the motion, s.
        period: The time between ticks, s.
        start: The time until full speed, s.

    Returns:
        (T) each, the phase, rad, and its first and second derivative by time.

    """
    t = np.arange(round(seconds / period)) * period
    s = np.clip(t / start, 0, 1)
    w = 2 * np.pi / turn
    angle = w * np.where(t < start, start * (2.5 * s**4 - 3 * s**5 + s**6), t - start / 2)
    share, slope, _ = compute_smooth_step(s)
    return angle, w * share, w * slope / start


def circle(
    radius: float, center: tuple[float, float], turn: float, seconds: float, period: float = 1e-3, start: float = 1.0
) -> Reference:
    """Make a motion of the tip on a circle, from rest to full speed without a jump in acceleration.

    Args:
        radius: m.
        center: The circle's center (x, y), m.
        turn: The time of one turn at full speed, s.
        seconds: The length of the motion, s.
        period: The time between ticks, s.
        start: The time until full speed, s.

    Returns:
        The motion of the tip.

    Raises:
        PlantError: A number is not positive and finite, or the motion has no row or far too many.

    """
    sizes = {"radius": radius, "turn": turn, "seconds": seconds, "period": period, "start": start}
    check_sizes(sizes, "a circle")
    if np.shape(center) != (2,) or not np.isfinite(center).all():
        raise PlantError(f"the circle's center is a finite point (x, y), m, not {center}.")
    angle, rate, change = advance_phase(turn, seconds, period, start)
    out, along = np.c_[np.cos(angle), np.sin(angle)], np.c_[-np.sin(angle), np.cos(angle)]
    velocity = radius * rate[:, None] * along
    acceleration = radius * (change[:, None] * along - rate[:, None] ** 2 * out)
    return Reference("tip", period, np.asarray(center) + radius * out, velocity, acceleration)


def solve_inverse_kinematics(arm: Arm, point: ArrayLike, near: ArrayLike) -> Array:
    """Solve the inverse kinematics of a point by Newton's method with bounded steps.

    Args:
        arm: The arm.
        point: (2), the point, m; in space (6), a pose (`hdagen.control.pose_kinematics`).
        near: (n), joint positions next to the solution.

    Returns:
        (n), the joint positions that bring the tip to the point, rad (m where prismatic).

    Raises:
        PlantError: The tip does not reach the point, or a number is not finite.

    """
    if arm.moves_in_space:
        return solve_tip_pose(arm, point, near)
    goal, q = np.asarray(point, float), np.array(near, float)
    if goal.shape != (2,) or q.shape != (arm.n,):
        raise PlantError(f"posture takes a point (x, y) and {arm.n} joint positions.")
    if not (np.isfinite(goal).all() and np.isfinite(q).all()):
        raise PlantError(f"the point {goal} or the joint positions {q} hold NaN or infinity; give finite numbers.")
    for _ in range(MOST_KINEMATICS_STEPS):
        gap = goal - arm.evaluate("points", q=q)["points"][-2:]
        if np.hypot(*gap) < TIP_TOLERANCE:
            return q
        J = arm.evaluate("tip_jacobian", q=q, v=np.zeros(arm.n))["J"].reshape(arm.n, 2).T
        step = np.linalg.lstsq(J, gap, rcond=1e-9)[0]
        q = q + step * min(1.0, 0.3 / max(np.abs(step).max(), 1e-300))
    start = np.round(np.asarray(near), 3).tolist()
    raise PlantError(
        f"the tip does not reach ({goal[0]:g}, {goal[1]:g}) m from joint positions {start}; choose a point within the "
        "links' reach, or start nearer."
    )


def convert_to_joint_motion(arm: Arm, reference: Reference, near: ArrayLike) -> Reference:
    """Convert a motion of the tip to the joints, acceleration included.

    Args:
        arm: The arm.
        reference: The motion of the tip.
        near: (n), joint positions next to the first ones; they choose the branch.

    Returns:
        The motion of the joints.

    Raises:
        PlantError: The tip does not reach a point of the motion.

    """
    positions = np.empty((len(reference.position), arm.n))
    q = np.asarray(near, float)
    for k, point in enumerate(reference.position):
        q = solve_inverse_kinematics(arm, point, q)
        positions[k] = q
    rows = count_followed_directions(arm) if arm.moves_in_space else 2
    at_rest = arm.evaluate("tip_jacobian", q=positions, v=np.zeros(arm.n))
    J = at_rest["J"].reshape(len(positions), arm.n, -1).transpose(0, 2, 1)[:, :rows]
    back = np.linalg.pinv(J)
    v = np.einsum("tij,tj->ti", back, reference.velocity[:, :rows])
    turn = arm.evaluate("tip_jacobian", q=positions, v=v)["Jdot_v"][:, :rows]
    a = np.einsum("tij,tj->ti", back, reference.acceleration[:, :rows] - turn)
    return Reference("joint", reference.period, positions, v, a)
