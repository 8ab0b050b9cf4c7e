"""Inverse kinematics of a tip in space, and the posture at which its motions begin.

A pose is six numbers: the tip's position, m, and the rotation vector of its orientation, rad, both from the base frame.
An arm with fewer than six joints is brought to the position alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm

POSE_SIZE = 6
POSE_TOLERANCE = 1e-9  # m and rad, of the inverse kinematics
MOST_POSE_STEPS = 100
LARGEST_JOINT_STEP = 0.3  # rad or m
DRAWN_POSTURES = 512
WIDEST_HALF_RANGE = {"revolute": 1.5, "prismatic": 0.2}  # rad and m about the middle of a joint's range
SHARE_OF_HALF_RANGE = 0.8


def find_tip_pose(arm: Arm, q: ArrayLike) -> Array:
    """Find the pose of the tip.

    Args:
        arm: An arm in space.
        q: (n) or (T, n), joint positions.

    Returns:
        (6) or (T, 6), position and rotation vector.

    """
    from scipy.spatial.transform import Rotation

    found = arm.evaluate("tip_pose", q=q)
    turned = Rotation.from_matrix(_stack_matrices(found["rotation"])).as_rotvec()
    return np.concatenate([found["position"], turned], axis=-1)


def _stack_matrices(columns: Array) -> Array:
    """Rotations (…, 9), column by column, as matrices (…, 3, 3)."""
    return np.swapaxes(columns.reshape(*columns.shape[:-1], 3, 3), -1, -2)


def find_rotation_gap(wanted: ArrayLike, columns: Array) -> Array:
    """Find the turn from orientations to wanted ones.

    Args:
        wanted: (3) or (T, 3), rotation vectors.
        columns: (9) or (T, 9), the orientations' matrices column by column, as the compiled `tip_pose` gives them.

    Returns:
        (3) or (T, 3), rotation vectors in the base frame.

    """
    from scipy.spatial.transform import Rotation

    return (Rotation.from_rotvec(wanted) * Rotation.from_matrix(_stack_matrices(columns)).inv()).as_rotvec()


def add_turns(turn: ArrayLike, first: ArrayLike) -> Array:
    """Turn orientations further.

    Args:
        turn: (…, 3), rotation vectors in the base frame.
        first: (…, 3), rotation vectors of the orientations.

    Returns:
        (…, 3), rotation vectors.

    """
    from scipy.spatial.transform import Rotation

    shape = np.shape(first)
    one, other = (Rotation.from_rotvec(np.reshape(vectors, (-1, 3))) for vectors in (turn, first))
    return (one * other).as_rotvec().reshape(shape)


def solve_tip_pose(arm: Arm, pose: ArrayLike, near: ArrayLike) -> Array:
    """Solve the inverse kinematics of a pose by damped least squares, with bounded steps.

    Args:
        arm: An arm in space.
        pose: (6), the pose.
        near: (n), joint positions next to the solution.

    Returns:
        (n), the joint positions, rad (m where prismatic).

    Raises:
        PlantError: The tip does not reach the pose, or a number is not finite.

    Source:
        Sugihara, IEEE Trans. Robot. 27 (2011) 984, for damping by the squared error.

    """
    goal, q = np.asarray(pose, float), np.array(near, float)
    if goal.shape != (POSE_SIZE,) or q.shape != (arm.n,) or not (np.isfinite(goal).all() and np.isfinite(q).all()):
        raise PlantError(f"a posture takes a finite pose (x, y, z, rx, ry, rz) and {arm.n} finite joint positions.")
    rows = count_followed_directions(arm)
    for _ in range(MOST_POSE_STEPS):
        found = arm.evaluate("tip_pose", q=q)
        gap = np.concatenate([goal[:3] - found["position"], find_rotation_gap(goal[3:], found["rotation"])])[:rows]
        if np.abs(gap).max() < POSE_TOLERANCE:
            return q
        J = find_tip_jacobian(arm, q)[:rows]
        step = J.T @ np.linalg.solve(J @ J.T + (1e-3 * gap @ gap + 1e-12) * np.eye(rows), gap)
        q = q + step * min(1.0, LARGEST_JOINT_STEP / max(np.abs(step).max(), 1e-300))
    raise PlantError(
        f"the tip does not reach {np.round(goal[:rows], 4).tolist()} (m, rad) from joint positions "
        f"{np.round(np.asarray(near), 3).tolist()}; choose a pose within reach, or start nearer."
    )


def count_followed_directions(arm: Arm) -> int:
    """Count the directions in which a tip in space can follow a pose.

    Args:
        arm: An arm in space.

    Returns:
        6, or 3 with fewer than six joints.

    """
    return POSE_SIZE if arm.n >= POSE_SIZE else 3


def find_tip_jacobian(arm: Arm, q: ArrayLike) -> Array:
    """Find the Jacobian of a tip in space.

    Args:
        arm: An arm in space.
        q: (n) or (T, n), joint positions.

    Returns:
        (6, n) or (T, 6, n).

    """
    columns = arm.evaluate("tip_jacobian", q=q, v=np.zeros(np.shape(q)))["J"]
    return np.swapaxes(columns.reshape(*columns.shape[:-1], arm.n, POSE_SIZE), -1, -2)


def choose_open_posture(arm: Arm) -> Array:
    """Choose a posture far from singular ones and within the joints' ranges: the best of many that a fixed seed draws.

    Args:
        arm: An arm in space.

    Returns:
        (n), the posture with the largest least singular value of the Jacobian, turns weighted by the usual reach.

    """
    middle, half = np.zeros(arm.n), np.empty(arm.n)
    for j, joint in enumerate(arm.robot["joints"]):
        half[j] = WIDEST_HALF_RANGE[joint["kind"]]
        if joint["limits"]["position"]:
            low, high = joint["limits"]["position"]
            middle[j], half[j] = (low + high) / 2, min(half[j], SHARE_OF_HALF_RANGE * (high - low) / 2)
    drawn = middle + half * np.random.default_rng(0).uniform(-1, 1, (DRAWN_POSTURES, arm.n))
    reach = np.linalg.norm(arm.evaluate("tip_pose", q=drawn)["position"], axis=1).mean()
    J = find_tip_jacobian(arm, drawn)[:, : count_followed_directions(arm)]
    J[:, 3:] *= reach
    return np.asarray(drawn[np.argmax(np.linalg.svd(J, compute_uv=False)[:, -1])])
