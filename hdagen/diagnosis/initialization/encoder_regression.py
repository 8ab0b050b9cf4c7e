"""Initial guesses from the difference between both encoders of a joint: backlash where the torque changes its sign, the
joint encoder's bias, eccentricity and delay, the kinematic error, and walls that push the link back.

The difference is regressed on the torque of the inverse dynamics, with outlying rows given less weight. Signs: the
spring holds against whatever pushes the link back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arm_parameters import Parameter
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_rated_torque, compute_torque_per_input
from hdagen.diagnosis.data.required_torque import compute_required_torque
from hdagen.diagnosis.data.split import LogPortion, Mask
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.diagnosis.inference.bounded_least_squares import Bounds, solve_box_qp
from hdagen.diagnosis.initialization.encoder_regression_settings import ENCODER_REGRESSION
from hdagen.log.channel_statistics import UniformGrid

MOTOR_WAVE_ORDERS = ((1, "once"), (2, "twice"), (4, "four"))  # waves of the motor angle, with the words of their terms
WAVE_TERMS = (
    *("joint_sine", "joint_cosine"),
    *(f"motor_{part}_{word}" for part in ("sine", "cosine") for _, word in MOTOR_WAVE_ORDERS),
)
WALL_TAIL_GRID = np.geomspace(*ENCODER_REGRESSION.wall_tail_ends, ENCODER_REGRESSION.wall_tail_count)


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The motion of one joint at T instants: motor angle, joint angle and speed, and the required torque."""

    motor_angle: Array
    angle: Array
    speed: Array
    torque: Array


@dataclass(frozen=True)
class EncoderEstimate:
    """Estimates of one joint by parameter: ``seen``, amplitudes, and ``shapes``, each in its unit."""

    sizes: dict[str, float]
    shapes: dict[str, float]


@dataclass(frozen=True, eq=False)
class EncoderDifference:
    """The difference between the encoders of joint j at T instants.

    ``twist``: motor angle over the ratio less the joint encoder's reading; ``terms`` (T, P): change of it for a unit of
    each of the ``parameters``; ``borne`` (T, B): change by the required torque; ``driven`` (T, D): change by the torque
    that the motor sends into the gear. ``shown``: instants that the fit may use; ``loaded``: those of them with a
    certain sign of torque; ``angle`` and ``torque`` of the joint.
    """

    joint: int
    parameters: tuple[Parameter, ...]
    twist: Array
    terms: Array
    load_terms: Array
    motor_terms: Array
    loaded_rows: Mask
    visible_rows: Mask
    angle: Array
    torque: Array

    def regress_terms(self, which: Mask, rows: Mask) -> Array:
        """Regress the twist on some of the terms and on torque.

        Args:
            which: mask of the parameters (P).
            rows: mask of the instants (T) to use.

        Returns:
            Coefficients (P + B); 0 for the other parameters, and for all of them where there is no row, as for a joint
            that never bears a torque.

        """
        columns = np.concatenate([self.terms[:, which], self.load_terms], 1)
        some = [q for q, one in zip(self.parameters, which, strict=True) if one]
        found = np.zeros(len(which) + self.load_terms.shape[1])
        if not rows.any():
            return found
        chosen = np.append(which, np.ones(self.load_terms.shape[1], bool))
        found[chosen] = _regress_robustly(columns[rows], self.twist[rows], _coefficient_bounds(some, columns))
        return found

    def subtract_terms(self, values: Array, rows: Mask) -> Array:
        """Subtract the regressed terms from the twist.

        Args:
            values: coefficients (P + B).
            rows: mask of the instants (T).

        Returns:
            The residual in these instants.

        """
        explained = np.concatenate([self.terms[rows], self.load_terms[rows]], 1) @ values
        return np.asarray(self.twist[rows] - explained)


def read_encoder_differences(arm: Arm, record: WindowedRecord) -> list[EncoderDifference]:
    """Compare the encoders of each flexible joint that has both.

    Args:
        arm: the compiled model.
        record: the log in windows.

    Returns:
        One difference a joint.

    """
    log, n, described = record.log, arm.n, arm.parameters.described
    if not arm.manifest["flexible"] or any(f"joint_position_{j}" not in log for j in range(1, n + 1)):
        return []
    motion = compute_required_torque(arm, record)
    grid, q, v, torque = motion.grid, motion.angle, motion.speed, motion.torque
    shown = LogPortion(log, record.visible_rows).covers(grid.time)
    found = []
    for j in arm.manifest["flexible"]:
        if f"motor_position_{j}" not in log:
            continue
        tau = torque[:, j - 1]
        theta, read = (np.interp(grid.time, log.time, log[f"{side}_position_{j}"]) for side in ("motor", "joint"))
        own = _list_encoder_parameters(arm, j)
        every = _encoder_terms(JointMotion(theta, q[:, j - 1], v[:, j - 1], tau))
        terms = {one.name: term for kind, term in every.items() for one in own if one.encoder_term == kind}
        loaded = shown & (np.abs(tau) > ENCODER_REGRESSION.least_load_share * float(np.sqrt(np.mean(tau[shown] ** 2))))
        twist = theta / arm.parameters[f"ratio_{j}"] - read
        borne = np.stack([np.interp(tau, *_torsion_law(arm, j)), tau, grid.differentiate(tau)], 1)
        parameters = tuple(described[name] for name in terms)
        columns = np.array([*terms.values()]).reshape(len(terms), len(tau)).T  # a model may have none of these effects
        sent = _torque_into_gear(arm, record, grid, j)
        driven = np.stack([np.interp(sent, *_torsion_law(arm, j)), sent], 1)
        found.append(EncoderDifference(j, parameters, twist, columns, borne, driven, loaded, shown, q[:, j - 1], tau))
    return found


def _torque_into_gear(arm: Arm, record: WindowedRecord, grid: UniformGrid, j: int) -> Array:
    """Compute the torque (T), at the joint, that motor j sends into its gear: the torque of its input, measured if it
    is logged, less the rotor's inertia and the robot file's friction."""
    log, p = record.log, arm.parameters
    name = arm.input_names[j - 1]
    drives = compute_torque_per_input(arm)[j - 1] * (log[name] if name in log else record.command[:, j - 1])
    speed = grid.differentiate(grid.smooth(log[f"motor_position_{j}"]))
    taken = p[f"motor_inertia_{j}"] * grid.differentiate(speed) + p[f"viscous_friction_{j}"] * speed
    taken += p[f"coulomb_friction_{j}"] * np.sign(speed)
    return np.asarray(p[f"ratio_{j}"] * (grid.smooth(drives) - taken))


def estimate_from_encoders(arm: Arm, record: WindowedRecord) -> list[EncoderEstimate]:
    """Estimate parameters from the difference between the encoders of each flexible joint that has both.

    Args:
        arm: the compiled model.
        record: the log in windows.

    Returns:
        The estimates of each joint.

    """
    found = []
    for one in read_encoder_differences(arm, record):
        j, law = one.joint, _torsion_law(arm, one.joint)
        values = one.regress_terms(np.ones(len(one.parameters), bool), one.loaded_rows)
        estimates = {q.name: float(value) for q, value in zip(one.parameters, values, strict=False)}
        borne = one.twist - one.terms @ values[: len(estimates)]
        untold = np.interp(borne, law[1], law[0]) - one.torque  # torque that pushes the link back
        sizes, shapes = _find_walls(arm, j, one.angle[one.visible_rows], untold[one.visible_rows])
        split = _split_encoder_bias(_list_encoder_parameters(arm, j), estimates)
        found.append(EncoderEstimate(estimates | split | sizes, shapes))
    return found


def _torsion_law(arm: Arm, j: int) -> tuple[Array, Array]:
    """Return rising torques at joint j and the torsion of each by the robot file's law."""
    torque = np.linspace(-1.0, 1.0, ENCODER_REGRESSION.torsion_law_points)[:, None] * compute_rated_torque(arm)
    return torque[:, j - 1], arm.evaluate("torsion", joint_torque=torque)["torsion"][:, j - 1]


def _find_walls(arm: Arm, j: int, angle: Array, torque: Array) -> tuple[dict[str, float], dict[str, float]]:
    """Find the stiffness and angle of each wall that explains most of the torque that pushes joint j back, if that
    stands out and the wall is stiffer than a typical one."""
    sizes, shapes = {}, {}
    for wall in (wall for traits in arm.effects.values() for wall in traits.walls):
        name, sign = f"{wall.stiffness}_{j}", float(wall.side)
        if name not in arm.parameters.described:
            continue
        usual = arm.parameters.described[name].typical or 0.0
        toward, pushed, most = sign * angle, sign * torque, float(np.abs(torque).sum())
        tried = np.quantile(toward, 1.0 - WALL_TAIL_GRID)
        best, *_ = _choose_wall_angle(tried, toward, pushed)
        between = np.linspace(
            tried[min(best + 1, len(tried) - 1)], tried[max(best - 1, 0)], ENCODER_REGRESSION.wall_refinement
        )
        best, stiffness, missed = _choose_wall_angle(
            between, toward, pushed
        )  # few rows tell of the way into a hard wall
        if missed < ENCODER_REGRESSION.largest_wall_misfit * most and stiffness > usual:
            sizes[name], shapes[f"{wall.edge}_{j}"] = stiffness, float(sign * between[best])
    return sizes, shapes


def _choose_wall_angle(tried: Array, toward: Array, pushed: Array) -> tuple[int, float, float]:
    """Choose the angle of ``tried`` whose wall explains the torque best, with its stiffness and its misfit."""
    fits = [_fit_wall_stiffness(np.maximum(toward - at, 0.0), pushed) for at in tried]
    best = int(np.argmin([missed for _, missed in fits]))
    return best, *fits[best]


def _fit_wall_stiffness(depth: Array, torque: Array) -> tuple[float, float]:
    """Fit the stiffness that gives ``torque`` with the least sum of errors, which bounces in few rows hardly change."""
    within = depth > 0
    rates, weights = torque[within] / depth[within], depth[within]
    order = np.argsort(rates)
    half = np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())
    stiffness = 0.0
    if len(order):
        stiffness = max(float(rates[order][min(half, len(order) - 1)]), 0.0)
    return stiffness, float(np.abs(torque - stiffness * depth).sum())


def _list_encoder_parameters(arm: Arm, j: int) -> list[Parameter]:
    """The parameters that show between the encoders of joint j."""
    return [q for q in arm.parameters.described.values() if q.joint == j and q.encoder_term is not None]


def _split_encoder_bias(parameters: Sequence[Parameter], found: Mapping[str, float]) -> dict[str, float]:
    """Split the constant between the encoders: an eccentric encoder may cause it where it was set to zero."""
    constant = next((q.name for q in parameters if q.encoder_term == "constant" and q.name in found), None)
    zero_offset = next((q for q in parameters if q.encoder_term == "zero_offset"), None)
    if constant is None or zero_offset is None:
        return {}
    waves = [q.name for q in parameters if q.effect == zero_offset.effect and q is not zero_offset]
    most = math.hypot(*(found.get(name, 0.0) for name in waves))
    zero = float(np.clip(-found[constant], -most, most))
    if most > 0:
        return {constant: found[constant] + zero, zero_offset.name: zero}
    return {}


def _encoder_terms(motion: JointMotion) -> dict[str, Array]:
    """Return the change of the motor's angle over the ratio less the joint encoder's reading, for a unit of a
    parameter, by the parameter's `encoder_term`."""
    angle, theta = motion.angle, motion.motor_angle
    terms = {
        "constant": -np.ones_like(angle),
        "joint_sine": -np.sin(angle),
        "joint_cosine": -np.cos(angle),
        "joint_speed": motion.speed,
        "torque_sign": 0.5 * np.sign(motion.torque),
    }
    for k, word in MOTOR_WAVE_ORDERS:
        terms[f"motor_sine_{word}"] = -np.sin(k * theta)
        terms[f"motor_cosine_{word}"] = -np.cos(k * theta)
    return terms


def _coefficient_bounds(terms: Sequence[Parameter], columns: Array) -> Bounds:
    """Bound each column's coefficient; the first columns are those of ``terms``. A wave is held to a few typical sizes:
    a bias and an arc of a large wave form a parabola, which would explain the torque of a wall."""
    most = np.full(columns.shape[1], np.inf)
    low, high = -most, most
    for k, q in enumerate(terms):
        reach = np.inf
        if q.encoder_term in WAVE_TERMS:
            reach = ENCODER_REGRESSION.largest_wave * (q.typical or 0.0)
        low[k], high[k] = max(q.low, -reach), min(q.high, reach)
    return low, high


def _regress_robustly(matrix: Array, sought: Array, bounds: Bounds) -> Array:
    """Regress ``sought`` on the columns of ``matrix`` within ``bounds``, with outlying rows given less weight."""
    scale = np.maximum(np.abs(matrix).max(0), 1e-300)
    matrix, weight, (low, high) = matrix / scale, np.ones(len(sought)), bounds
    for _ in range(ENCODER_REGRESSION.regression_reweightings):
        weighed, weighed_target = matrix * weight[:, None], sought * weight
        free = np.asarray(np.linalg.lstsq(weighed, weighed_target, rcond=1e-9)[0], float)
        H = weighed.T @ weighed + ENCODER_REGRESSION.column_ridge * len(sought) * np.eye(len(scale))
        found = solve_box_qp(H, weighed.T @ weighed_target, free, (low * scale, high * scale))
        left = sought - matrix @ found
        weight = 1.0 / np.sqrt(1.0 + (left / max(2.0 * float(np.median(np.abs(left))), 1e-300)) ** 2)
    return np.asarray(found / scale)
