"""What a log itself suggests before any search: walls at the ends of a range, what the drive makes of its commands, and
what the joints' torsion shows.

The linear model of an effect is a difference over the size by which its parameter is moved. Where an effect answers to
its size with a corner (a limit, a delay of whole rows, a wall) that size has to be near the one that reality has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hdagen.channels import even
from hdagen.diagnosis.record import Record, usual_torque
from hdagen.log import Log
from hdagen.plant import Arm, Array

BEYOND = (0.005, 0.03, 0.1, 0.25)  # shares of the rows that lie beyond a wall that is tried
SIZES = np.geomspace(0.1, 10.0, 25)  # of an input effect, in usual sizes
SIZED = ("sensor_delay", "backlash_angle")  # read off well enough to be tried at that size
TURNS = ((1, "once"), (2, "twice"), (4, "four"))  # of the kinematic error, with the words of its parameters
FRICTION = 0.5  # of the usual input, that dry friction is taken for where nothing else is known
LEAST = 0.1  # usual sizes, from which that is worth it
LOADED = 0.1  # of its usual torque, from which a joint's torque has a sign for certain
PASSES = 6  # of weighing rows anew
WORTH = 0.99  # of the error of the current without the effect, below which a size is suggested


@dataclass(frozen=True)
class Suggested:
    """``shapes``: values from which the search starts, by shape parameter, in place of the model's; ``sizes``: by how
    much an amplitude is moved for its column, in its unit; ``seen``: what can be read off the joints' torsion, from
    which every hypothesis starts as far as it tolerates that, by parameter; ``units``: what is usual of a torque at a
    motor, where the robot file gives no friction to go by, by parameter."""

    shapes: dict[str, tuple[float, ...]]
    sizes: dict[str, float]
    seen: dict[str, float]
    units: dict[str, float] = field(default_factory=dict)


def suggested(arm: Arm, record: Record) -> Suggested:
    """All that the log suggests."""
    seen = torsion(arm, record)
    least = {name: LEAST * (q.typical or np.inf) for name, q in arm.parameters.described.items()}
    sized = {name: size for name, size in seen.items() if name.startswith(SIZED) and abs(size) > least[name]}
    return Suggested(_walls(arm, record.log), _inputs(arm, record) | sized, seen, _units(arm, record))


def _units(arm: Arm, record: Record) -> dict[str, float]:
    """Usual torques at motors whose robot file has no dry friction, on which those in the manifest would be based: as
    if it were a share of the usual input."""
    described, usual = arm.parameters.described, usual_torque(arm, record)
    names = [
        (f"{a}_{j}", FRICTION * usual[j - 1])
        for effect in arm.manifest["effects"]
        if effect["place"] == "motor"
        for j in effect["joints"]
        if j and usual[j - 1] > 0 and not described[f"coulomb_friction_{j}"].nominal
        for a in effect["amplitudes"]
    ]
    torques = [(described[name], size) for name, size in names if name in described]
    return {q.name: size * q.typical for q, size in torques if q.typical and q.unit in ("N m", "N")}


def _walls(arm: Arm, log: Log) -> dict[str, tuple[float, ...]]:
    found: dict[str, tuple[float, ...]] = {}
    for j in range(1, arm.n + 1):
        if f"contact_above_{j}" in arm.parameters.described:
            ratio = arm.parameters[f"ratio_{j}"]
            q = log[f"joint_position_{j}"] if f"joint_position_{j}" in log else log[f"motor_position_{j}"] / ratio
            found[f"contact_above_{j}"] = tuple(float(np.quantile(q, 1 - share)) for share in BEYOND)
            found[f"contact_below_{j}"] = tuple(float(np.quantile(q, share)) for share in BEYOND)
    return found


def torsion(arm: Arm, record: Record) -> dict[str, float]:
    """What the difference of both encoders of a joint shows beside the torque that twists it: backlash where that
    changes sign, the joint encoder's bias, eccentricity and age, and the kinematic error; by parameter, in its unit.

    Least squares, rows that are out of line weighed less, on the torque of the inverse dynamics.
    """
    log, n, described = record.log, arm.n, arm.parameters.described
    if not arm.manifest["flexible"] or any(f"joint_position_{j}" not in log for j in range(1, n + 1)):
        return {}
    grid = even(log.time)
    q = np.stack([grid.smooth(log[f"joint_position_{j}"]) for j in range(1, n + 1)], 1)
    v = np.stack([grid.rate(column) for column in q.T], 1)
    a = np.stack([grid.rate(column) for column in v.T], 1)
    held = record.command[np.clip(np.searchsorted(log.time, grid.time, side="right") - 1, 0, None)]
    torque = arm.evaluate("inverse_dynamics", q=q, v=v, a=a, tip_force=held[:, n:])["joint_torque"]
    found: dict[str, float] = {}
    for j in arm.manifest["flexible"]:
        if f"motor_position_{j}" not in log:
            continue
        tau = torque[:, j - 1]
        theta, read = (np.interp(grid.time, log.time, log[f"{side}_position_{j}"]) for side in ("motor", "joint"))
        terms = {name: term for name, term in _terms(j, theta, q, v, tau).items() if name in described}
        loaded = np.abs(tau) > LOADED * float(np.sqrt(np.mean(tau**2)))
        twist = theta / arm.parameters[f"ratio_{j}"] - read
        values = _regressed([*terms.values(), tau, tau**3, grid.rate(tau)], twist, loaded)
        found |= {
            name: float(np.clip(value, described[name].low, described[name].high))
            for name, value in zip(terms, values, strict=False)
        }
    return found


def _terms(j: int, theta: Array, q: Array, v: Array, tau: Array) -> dict[str, Array]:
    """What a unit of each parameter adds to the motor's angle over the ratio less what the joint's encoder reads."""
    angle = q[:, j - 1]
    terms = {
        f"encoder_bias_{j}": -np.ones_like(angle),
        f"eccentricity_sine_{j}": -np.sin(angle),
        f"eccentricity_cosine_{j}": -np.cos(angle),
        f"sensor_delay_{j}": v[:, j - 1],
        f"backlash_angle_{j}": 0.5 * np.sign(tau),
    }
    for k, word in TURNS:
        terms[f"kinematic_sine_{word}_{j}"] = -np.sin(k * theta)
        terms[f"kinematic_cosine_{word}_{j}"] = -np.cos(k * theta)
    return terms


def _regressed(terms: Sequence[Array], measured: Array, rows: np.ndarray) -> Array:
    """Coefficients of ``terms`` that give ``measured`` best in ``rows``."""
    matrix, sought = np.stack(terms, 1)[rows], measured[rows]
    scale = np.maximum(np.abs(matrix).max(0), 1e-300)
    matrix, weight = matrix / scale, np.ones(len(sought))
    for _ in range(PASSES):
        found = np.linalg.lstsq(matrix * weight[:, None], sought * weight, rcond=1e-9)[0]
        left = sought - matrix @ found
        weight = 1.0 / np.sqrt(1.0 + (left / max(2.0 * float(np.median(np.abs(left))), 1e-300)) ** 2)
    return np.asarray(found / scale)


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
