"""Motions through waypoints of a table: of the tip or of the joints, at rest at every waypoint, smooth between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.pose_kinematics import POSE_SIZE, find_tip_pose
from hdagen.control.reference_motion import MOST_REFERENCE_ROWS, Reference, compute_smooth_step
from hdagen.log.csv_file import read_csv

TIME = "time"
POINT = ("x", "y", "z")
TURN = ("rx", "ry", "rz")


def read_waypoints(path: Path, arm: Arm, posture: Array, period: float = 1e-3) -> Reference:
    """Read a motion from a CSV file of waypoints.

    Args:
        path: The file: a column ``time``, s, and either those of the joints, ``joint_position_1`` and so on, rad or m,
            or those of the tip, ``x``, ``y``, in space ``z`` too, m, and there, if wanted, its rotation vector ``rx``,
            ``ry``, ``rz``, rad.
        arm: The arm.
        posture: (n), joint positions whose orientation the tip keeps where the file states none.
        period: The time between ticks, s.

    Returns:
        The motion, from time 0 to the last waypoint; before the first one it rests there.

    Raises:
        LogError: The file cannot be read.
        PlantError: The columns or their numbers make no motion of this arm.

    """
    joints = tuple(f"joint_position_{j}" for j in range(1, arm.n + 1))
    point = POINT[: 3 if arm.moves_in_space else 2]
    known = {TIME, *joints, *point, *(TURN if arm.moves_in_space else ())}
    table = read_csv(path, known.__contains__)
    forms = (joints, (*point, *TURN), point) if arm.moves_in_space else (joints, point)
    chosen = next((form for form in forms if {TIME, *form} == set(table.columns)), None)
    if chosen is None:
        possible = "; or ".join(", ".join((TIME, *form)) for form in forms)
        raise PlantError(f"{path}: found the columns {', '.join(table.names)}, possible are {possible}.")
    time, points = table.columns[TIME], np.column_stack([table.columns[name] for name in chosen])
    if not len(time) or not (np.isfinite(time).all() and np.isfinite(points).all()):
        raise PlantError(f"{path}: a waypoint is finite numbers, and there is one or more; fill or delete empty cells.")
    if time[0] < 0 or (np.diff(time) <= 0).any() or not 0.5 < time[-1] / period <= MOST_REFERENCE_ROWS:
        raise PlantError(
            f"{path}: times begin at 0 s or later, grow from row to row and end between one period ({period} s) and "
            f"{MOST_REFERENCE_ROWS:g} of them."
        )
    space = "joint" if chosen == joints else "tip"
    if arm.moves_in_space and chosen == point:
        points = np.hstack([points, np.tile(find_tip_pose(arm, posture)[3:], (len(points), 1))])
    return connect_waypoints(space, time, points, period)


def connect_waypoints(space: str, time: Array, points: Array, period: float = 1e-3) -> Reference:
    """Connect waypoints by minimum-jerk motions, at rest at each; a tip in space turns about one axis between two.

    Args:
        space: "tip" or "joint".
        time: (K), s, growing.
        points: (K, k), rad or m; of a tip in space k = 6, the last three numbers its rotation vector.
        period: The time between ticks, s.

    Returns:
        The motion, from time 0 to the last waypoint.

    """
    t = np.arange(round(time[-1] / period)) * period
    if len(time) == 1:
        time, points = np.array([0.0, time[0]]), np.repeat(points, 2, axis=0)
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 2)
    span = np.diff(time)[k]
    share, slope, bend = compute_smooth_step((t - time[k]) / span)
    steps = np.diff(points, axis=0)
    turns = space == "tip" and points.shape[1] == POSE_SIZE
    if turns:
        from scipy.spatial.transform import Rotation

        at = Rotation.from_rotvec(points[:, 3:])
        steps[:, 3:] = (at[1:] * at[:-1].inv()).as_rotvec()
    position = points[k] + share[:, None] * steps[k]
    if turns:
        position[:, 3:] = (Rotation.from_rotvec(share[:, None] * steps[k, 3:]) * at[k]).as_rotvec()
    velocity, acceleration = (slope / span)[:, None] * steps[k], (bend / span**2)[:, None] * steps[k]
    return Reference(space, period, position, velocity, acceleration)
