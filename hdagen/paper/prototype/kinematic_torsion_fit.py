"""The fit of (13) to logs in which a joint was turned by a constant torque.

Legend: s turns of the output by the motor's angle; y = θ/N − q, the angles' difference of (12). It holds the kinematic
torsion Σ a_k s^k, the springs' torsion under the torque that turns the arm, and the hysteresis, which has the sign of
the torque. The fit has a term for each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.log.measured_log import Log
from hdagen.paper.prototype.virtual_prototype import PERIOD, Bench, DrivenRun, drive_arm, encoders_of

POLYNOMIAL_ORDER = 5
PARABOLA_ROWS = 101  # rows of the parabolas whose curvature is the acceleration
END_MARGIN = 0.02  # rad from an end of the turn, where the published torsion jumps, to the first angle of a motion
TORSION_RISE_SECONDS = 0.05  # s in which the torque rises


@dataclass(frozen=True)
class TorsionFit:
    """Coefficients (6, rad) of (13) with their covariance (6, 6); the residual (rows,) and its rms ``rest``, rad."""

    coefficients: Array
    covariance: Array
    residual_rms: float
    residual: Array

    @property
    def standard_errors(self) -> Array:
        """Standard errors of the coefficients (6, rad)."""
        return np.sqrt(np.diag(self.covariance))

    def deviations_from(self, published: Sequence[float]) -> Array:
        """Compare each coefficient with the published one.

        Args:
            published: coefficients (6), rad.

        Returns:
            Found less published, in standard errors (6,).

        """
        return (self.coefficients - np.asarray(published)) / self.standard_errors

    def squared_distance_to(self, published: Sequence[float]) -> float:
        """Compare all coefficients with the published ones together.

        Args:
            published: coefficients (6), rad.

        Returns:
            Squared distance in standard errors: chi-square with 6 degrees of freedom.

        """
        off = self.coefficients - np.asarray(published)
        return float(off @ np.linalg.solve(self.covariance, off))


def turn_joint(
    bench: Bench,
    j: int,
    above: float,
    direction: int,
    changes: Mapping[str, float],
    turns: float = 1.0,
    fine: bool = False,
    repeat: int = 0,
) -> DrivenRun:
    """Turn a joint by a constant motor torque from one end of its turns to the other.

    Args:
        bench: arms and shared runs.
        j: the joint, from 1.
        above: motor torque above running friction, N m.
        direction: 1 or -1.
        changes: parameters of the arm that differ from the prototype's, SI.
        turns: how far the output turns.
        fine: encoders of 4096 counts in place of Hall sensors.
        repeat: each repeat has noise of its own.

    Returns:
        The run.

    """
    arm = bench.arm(changes=changes)
    torque = arm.parameters[f"coulomb_friction_{j}"] + above
    seconds = 1.5 + 3.2 * turns
    current = np.zeros((round(seconds / PERIOD), 2))
    begun = np.clip(np.arange(len(current)) * PERIOD / TORSION_RISE_SECONDS, 0, 1)
    current[:, j - 1] = begun * direction * torque / arm.parameters[f"torque_constant_{j}"]
    q = np.zeros(2)
    seed = 10_000 * repeat + 1000 * j + round(1e4 * above)  # no two logs have the same noise
    if direction > 0:
        q[j - 1] = END_MARGIN
        seed += 500
    else:
        q[j - 1] = 2 * np.pi * turns - END_MARGIN
    return drive_arm(arm, current, np.zeros((len(current), 2)), q, encoders_of(fine), seed)


def angle_difference(log: Log, j: int, ratio: float) -> tuple[Array, Array]:
    """Compute the angles' difference of (12).

    Args:
        log: motor and joint angles (T,), rad.
        j: the joint, from 1.
        ratio: gear ratio N.

    Returns:
        Turns of the output by the motor's angle (T,), and θ/N − q (T,), rad.

    """
    turn = log[f"motor_position_{j}"] / ratio
    return turn / (2 * np.pi), turn - log[f"joint_position_{j}"]


def joint_acceleration(log: Log, j: int) -> Array:
    """Acceleration of the joint (T,), rad/s², from parabolas."""
    from scipy.signal import savgol_filter

    return savgol_filter(log[f"joint_position_{j}"], PARABOLA_ROWS, 2, deriv=2, delta=PERIOD)


def fit_torsion(logs: Sequence[tuple[Log, int, float]], j: int, ratio: float, turns: float = 1.0) -> TorsionFit:
    """Fit (13) to logs by least squares, with a torsion by acceleration and, for each torque, one by direction.

    Args:
        logs: each log with the direction of its turn, 1 or -1, and its torque above running friction, N m.
        j: the joint, from 1.
        ratio: gear ratio N.
        turns: how far the output turns.

    Returns:
        The polynomial that all logs have in common.

    """
    blocks, values = [], []
    levels = sorted({above for _, _, above in logs})
    for log, direction, above in logs:
        s, y = angle_difference(log, j, ratio)
        inside = (s >= 0) & (s <= turns) & (log.time > 0.1)
        beside = np.zeros((len(s), 1 + len(levels)))
        beside[:, 0] = joint_acceleration(log, j)
        beside[:, 1 + levels.index(above)] = direction
        blocks.append(np.hstack([np.vander(s, POLYNOMIAL_ORDER + 1, increasing=True), beside])[inside])
        values.append(y[inside])
    X, y = np.vstack(blocks), np.concatenate(values)
    scale = np.linalg.norm(X, axis=0)
    found = np.linalg.lstsq(X / scale, y, rcond=None)[0]
    residual = y - (X / scale) @ found
    inverse = np.linalg.inv((X / scale).T @ (X / scale))
    score = X / scale * residual[:, None]  # White's covariance: independent noise whose size varies along the turn
    covariance = (inverse @ (score.T @ score) @ inverse / np.outer(scale, scale))[
        : POLYNOMIAL_ORDER + 1, : POLYNOMIAL_ORDER + 1
    ]
    rest = float(np.sqrt(np.mean(residual**2)))
    return TorsionFit((found / scale)[: POLYNOMIAL_ORDER + 1], covariance, rest, residual)
