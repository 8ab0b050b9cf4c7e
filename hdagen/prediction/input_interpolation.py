"""Interpolation of a measured current or torque between the rows of a log: held, or on a straight line.

A loop that runs at the log's rate holds its output from row to row, and the value read in a row has acted since the row
before. A loop that runs faster than the log changes its output between rows, and the value read is one instant of it:
between two rows the mean of both acts, and a model driven by held values is half a period late. The motion tells the
case: the input is a sum of accelerations, speeds, directions and functions of angle, with any weights, and it is half a
period earlier in one case than in the other.

Legend: T rows, K even instants, F regressors; h time between rows, s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.log.channel_statistics import UniformGrid, estimate_noise, make_uniform_grid
from hdagen.log.measured_log import Log
from hdagen.prediction.measurement_model import read_joint_angles
from hdagen.prediction.prediction_settings import PREDICTION

COMMAND_CHANNELS = "motor_current_command", "motor_torque_command"


@dataclass(frozen=True)
class InputInterpolation:
    """The interpolation of a measured input between rows.

    Attributes:
        held: Whether the value of a row has acted since the row before; else it goes straight from row to row.
        reason: The reason, in words.
        uncertainty: Standard deviation of the input's mean from a row to the next, in its unit.

    """

    is_held: bool
    reason: str
    uncertainty: float

    def average_between_rows(self, values: Array) -> Array:
        """Compute the mean input from each row to the next.

        Args:
            values: (T,), the input as read in each row.

        Returns:
            (T,), the mean that acts from each row to the next, in the same unit.

        """
        following = np.append(values[1:], values[-1])
        if self.is_held:
            return following
        return (values + following) / 2

    @property
    def description(self) -> str:
        """The interpolation and its reason, in words."""
        if self.is_held:
            return f"taken as what acted before its row ({self.reason})"
        return f"taken on a straight line from row to row ({self.reason})"


def judge_interpolation(arm: Arm, log: Log, joint: int, values: Array) -> InputInterpolation:
    """Judge by the motion whether the measured input of a joint is held between rows.

    Args:
        arm: The arm; the torque that a motion requires comes from its robot file, not from its present parameters.
        log: The log with the positions.
        joint: The joint's number, from 1.
        values: (T,), the input as read in each row, A or N m (N where prismatic).

    Returns:
        Held where that is significant, else straight.

    """
    command = next((log[name] for kind in COMMAND_CHANNELS if (name := f"{kind}_{joint}") in log), None)
    if command is not None:
        is_held, reason = _shows_previous_command(values, command), "it does not show the command of the row before"
        if is_held:
            reason = "it shows the command of the row before"
    else:
        left = _compute_unexplained_shares(arm, log, joint, values)
        is_held, reason = _is_surely_held(left), "the log is too short to tell whether it was held"
        if len(left):
            shares = np.sqrt(np.mean(left, 0))
            reason = f"held, the motion leaves {100 * shares[0]:.2g} % of it, straight {100 * shares[1]:.2g} %"
    white, strayed = estimate_noise(values), 0.0
    if is_held:
        return InputInterpolation(is_held, reason, float(np.sqrt(white**2)))
    if len(values) > 2:  # a random path strays from the straight line by a 24th of its second difference's variance
        strayed = max(float(np.mean(np.diff(values, 2) ** 2)) - 6 * white**2, 0.0) / 24
    return InputInterpolation(is_held, reason, float(np.sqrt(white**2 / 2 + strayed)))


def _shows_previous_command(values: Array, command: Array) -> bool:
    """Whether the ``values`` (T,) read are the ``command`` (T,) of the row before.

    They must be nearer to it than to the command half a row earlier or later: the drive then reaches its command within
    a row and holds it.
    """
    read, size = values[2:-1], float(command @ values) / max(float(command @ command), np.finfo(float).tiny)
    before, at, after = (size * command[k : k + len(read)] for k in range(3))
    off = [float(np.sum((read - one) ** 2)) for one in ((before + at) / 2, at, (at + after) / 2)]
    return off[1] < min(off[0], off[2])


def _is_surely_held(left: Array) -> bool:
    """Whether a held input leaves significantly less unexplained than a straight one, ``left`` (BLOCKS, 2).

    Straight is the default: a loop that runs as slowly as it is logged is the exception.
    """
    if not len(left):
        return False
    better = left[:, 1] - left[:, 0]
    return bool(better.mean() > PREDICTION.held_standard_errors * np.std(better) / np.sqrt(len(better)))


def _compute_unexplained_shares(arm: Arm, log: Log, joint: int, values: Array) -> Array:
    """The share of the input's mean square that regressors of the motion leave, in blocks of time, (BLOCKS, 2).

    The columns are for a held and for a straight input; empty where the log is too short to tell.
    """
    grid = make_uniform_grid(log.time)
    grid = UniformGrid(grid.time, grid.time)
    inside = slice(
        PREDICTION.end_filter_widths * grid.window_rows,
        len(grid.time) - PREDICTION.end_filter_widths * grid.window_rows,
        max(1, grid.window_rows // 2, len(log) // PREDICTION.most_instants),
    )
    X = _build_regressors(arm, log, grid, joint)[inside]
    if len(X) < 4 * X.shape[1]:
        return np.empty((0, 2))
    smooth = grid.smooth(grid.smooth(np.interp(grid.time, log.time, values)))
    slope = grid.differentiate(smooth)
    half, basis = grid.period / 2, np.linalg.qr(X)[0]
    left = []
    for ahead in (half, 0.0):
        y = (smooth + ahead * slope + ahead**2 / 2 * grid.differentiate(slope))[inside]
        squares = (y - basis @ (basis.T @ y)) ** 2 / max(float(np.mean(y**2)), np.finfo(float).tiny)
        left.append([float(np.mean(block)) for block in np.array_split(squares, PREDICTION.time_blocks)])
    return np.array(left).T


def _build_regressors(arm: Arm, log: Log, grid: UniformGrid, joint: int) -> Array:
    """Build the regressors of a joint's input (K, F).

    They are the torque that the robot file's model requires, the joints' accelerations, the joint's own speeds and
    directions, and functions of its angle.
    """
    nominal = arm.with_parameters(np.array([q.nominal for q in arm.parameters.described.values()]))

    def once(values: Array) -> Array:
        return grid.smooth(np.interp(grid.time, log.time, values))

    q = np.stack([once(column) for column in read_joint_angles(nominal, log).T], 1)
    v = np.stack([grid.differentiate(column) for column in q.T], 1)
    a = np.stack([grid.differentiate(column) for column in v.T], 1)
    asked = nominal.evaluate("inverse_dynamics", q=q, v=v, a=a, tip_force=np.zeros(arm.nu - arm.n))
    columns = [np.ones(len(q)), asked["joint_torque"][:, joint - 1], np.sin(q[:, joint - 1]), np.cos(q[:, joint - 1])]
    columns += list(a.T)
    own = [name for side in ("motor", "joint") if (name := f"{side}_position_{joint}") in log]
    for name in own:
        speed = grid.differentiate(once(log[name]))
        slow = max(PREDICTION.slow_speed_share * float(np.std(speed)), np.finfo(float).tiny)
        columns += [speed, np.tanh(speed / slow), grid.differentiate(speed)]
    return np.column_stack([grid.smooth(column) / (float(np.std(column)) or 1.0) for column in columns])
