"""The fit of (13) to logs in which a joint was turned by a constant torque.

Legend: s turns of the output as the motor has it; y = θ/N − q, the angles' difference of (12), which holds the
kinematic torsion Σ a_k s^k, the springs' torsion under what turns the arm, and the hysteresis, whose sign is that of
the torque. The last two are fitted beside the first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.log import Log
from hdagen.paper.prototype import PERIOD, Bench, Driven, driven, fine_sensors
from hdagen.plant import Array

ORDER = 5
SMOOTH = 101  # rows of the parabola that gives the acceleration
INSIDE = 0.02  # rad from the ends of the turn, where the published torsion jumps, to where a motion begins
RISE = 0.05  # s in which the torque is brought up


@dataclass(frozen=True)
class Fit:
    """Coefficients (6, rad) of (13) with their covariance, and the rms of what is left, rad."""

    coefficients: Array
    covariance: Array
    rest: float
    residual: Array

    @property
    def errors(self) -> Array:
        """Standard errors."""
        return np.sqrt(np.diag(self.covariance))

    def off_by(self, published: Sequence[float]) -> Array:
        """How far each coefficient is from the published one, in standard errors (6)."""
        return (self.coefficients - np.asarray(published)) / self.errors

    def distance(self, published: Sequence[float]) -> float:
        """Squared distance of the published set in standard errors, all six together (chi-square with 6 degrees)."""
        off = self.coefficients - np.asarray(published)
        return float(off @ np.linalg.solve(self.covariance, off))


def turned(
    bench: Bench,
    j: int,
    above: float,
    direction: int,
    changes: Mapping[str, float],
    turns: float = 1.0,
    fine: bool = False,
    repeat: int = 0,
) -> Driven:
    """Joint j turned by a constant motor torque, ``above`` running friction, from one end of
    ``turns`` to the other; each ``repeat`` has noise of its own."""
    arm = bench.arm(changes=changes)
    torque = arm.parameters[f"coulomb_friction_{j}"] + above
    seconds = 1.5 + 3.2 * turns
    current = np.zeros((round(seconds / PERIOD), 2))
    begun = np.clip(np.arange(len(current)) * PERIOD / RISE, 0, 1)
    current[:, j - 1] = begun * direction * torque / arm.parameters[f"torque_constant_{j}"]
    q = np.zeros(2)
    q[j - 1] = INSIDE if direction > 0 else 2 * np.pi * turns - INSIDE
    # no two logs have the same noise
    seed = 10_000 * repeat + 1000 * j + round(1e4 * above) + (500 if direction > 0 else 0)
    return driven(arm, current, np.zeros((len(current), 2)), q, fine_sensors() if fine else None, seed)


def difference(log: Log, j: int, ratio: float) -> tuple[Array, Array]:
    """(turns of the output as the motor has it, angles' difference) of a log."""
    turn = log[f"motor_position_{j}"] / ratio
    return turn / (2 * np.pi), turn - log[f"joint_position_{j}"]


def acceleration(log: Log, j: int) -> Array:
    """Of the joint, rad/s², by parabolas."""
    from scipy.signal import savgol_filter

    return savgol_filter(log[f"joint_position_{j}"], SMOOTH, 2, deriv=2, delta=PERIOD)


def fit(logs: Sequence[tuple[Log, int, float]], j: int, ratio: float, turns: float = 1.0) -> Fit:
    """(13) by least squares from logs of (direction, torque), all together: the polynomial is theirs in common; a
    torsion by acceleration and, for each torque, one by direction stand beside it."""
    blocks, values = [], []
    levels = sorted({above for _, _, above in logs})
    for log, direction, above in logs:
        s, y = difference(log, j, ratio)
        inside = (s >= 0) & (s <= turns) & (log.time > 0.1)
        beside = np.zeros((len(s), 1 + len(levels)))
        beside[:, 0] = acceleration(log, j)
        beside[:, 1 + levels.index(above)] = direction
        blocks.append(np.hstack([np.vander(s, ORDER + 1, increasing=True), beside])[inside])
        values.append(y[inside])
    X, y = np.vstack(blocks), np.concatenate(values)
    scale = np.linalg.norm(X, axis=0)
    found = np.linalg.lstsq(X / scale, y, rcond=None)[0]
    residual = y - (X / scale) @ found
    inverse = np.linalg.inv((X / scale).T @ (X / scale))
    score = X / scale * residual[:, None]  # White: noise differs along the turn, and from row to row it is new
    covariance = (inverse @ (score.T @ score) @ inverse / np.outer(scale, scale))[: ORDER + 1, : ORDER + 1]
    rest = float(np.sqrt(np.mean(residual**2)))
    return Fit((found / scale)[: ORDER + 1], covariance, rest, residual)
