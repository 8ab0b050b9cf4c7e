"""What a log itself suggests before any search: walls at the ends of a range, and what the drive makes of its commands.

The linear model of an effect is a difference over the size by which its parameter is moved. Where an effect answers to
its size with a corner (a limit, a delay of whole rows, a wall) that size has to be near the one that reality has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.channels import even
from hdagen.diagnosis.record import Record
from hdagen.log import Log
from hdagen.plant import Arm, Array

BEYOND = (0.005, 0.03, 0.1, 0.25)  # shares of the rows that lie beyond a wall that is tried
SIZES = np.geomspace(0.1, 10.0, 25)  # of an input effect, in usual sizes
WORTH = 0.99  # of the error of the current without the effect, below which a size is suggested


@dataclass(frozen=True)
class Suggested:
    """``shapes``: values from which the search starts, by shape parameter, in place of the model's; ``sizes``: by how
    much an amplitude is moved for its column, in its unit."""

    shapes: dict[str, tuple[float, ...]]
    sizes: dict[str, float]


def suggested(arm: Arm, record: Record) -> Suggested:
    """All that the log suggests."""
    return Suggested(_walls(arm, record.log), _inputs(arm, record) | _skews(arm, record.log))


def _walls(arm: Arm, log: Log) -> dict[str, tuple[float, ...]]:
    found: dict[str, tuple[float, ...]] = {}
    for j in range(1, arm.n + 1):
        if f"contact_above_{j}" in arm.parameters.described:
            ratio = arm.parameters[f"ratio_{j}"]
            q = log[f"joint_position_{j}"] if f"joint_position_{j}" in log else log[f"motor_position_{j}"] / ratio
            found[f"contact_above_{j}"] = tuple(float(np.quantile(q, 1 - share)) for share in BEYOND)
            found[f"contact_below_{j}"] = tuple(float(np.quantile(q, share)) for share in BEYOND)
    return found


def _skews(arm: Arm, log: Log) -> dict[str, float]:
    """The age of each joint encoder's reading: the part of its difference to the motor's that goes with speed."""
    sizes: dict[str, float] = {}
    for j in range(1, arm.n + 1):
        name, both = f"sensor_delay_{j}", (f"motor_position_{j}", f"joint_position_{j}")
        if name not in arm.parameters.described or not all(channel in log for channel in both):
            continue
        grid = even(log.time)
        q = grid.smooth(log[both[1]])
        rate = grid.rate(q)
        twist = grid.smooth(log[both[0]] / arm.parameters[f"ratio_{j}"]) - q
        terms = [rate, grid.rate(rate), np.sign(rate), q, np.ones_like(q)]
        matrix = np.stack([term / max(float(np.abs(term).max()), 1e-300) for term in terms], 1)
        delay = float(np.linalg.lstsq(matrix, twist, rcond=1e-9)[0][0] / max(float(np.abs(rate).max()), 1e-300))
        described = arm.parameters.described[name]
        if abs(delay) > 0.1 * log.period and described.low <= delay <= described.high:
            sizes[name] = delay
    return sizes


def _inputs(arm: Arm, record: Record) -> dict[str, float]:
    """The size of each input effect with which the commands alone give the measured currents best."""
    sizes: dict[str, float] = {}
    names = [
        (f"{a}_{j}", j)
        for effect in arm.manifest["effects"]
        if effect["place"] == "input"
        for j in effect["joints"]
        for a in effect["amplitudes"]
    ]
    for name, j in names:
        if ("motor_current", j) not in record.outputs:
            continue
        measured, described = record.log[f"motor_current_{j}"], arm.parameters.described[name]
        tried = [described.nominal + float(s) * (described.typical or 0.0) for s in SIZES]
        tried = [value for value in tried if described.low <= value <= described.high]
        errors = [_error(arm, record, name, value, j, measured) for value in (described.nominal, *tried)]
        best = int(np.argmin(errors[1:]))
        if errors[1 + best] < WORTH * errors[0]:
            sizes[name] = tried[best] - described.nominal
    return sizes


def _error(arm: Arm, record: Record, name: str, value: float, j: int, measured: Array) -> float:
    kept = arm.parameters[name]
    arm.parameters[name] = value
    _, at = arm.acting(record.command[:, : arm.n], record.steps, record.before)
    arm.parameters[name] = kept
    return float(np.sqrt(np.mean((at[:, j - 1] - measured) ** 2)))
