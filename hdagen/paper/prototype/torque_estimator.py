"""Joint torque from a log, without a torque sensor, in steps of growing accuracy.

Legend: φ torsion, θ/N − q less the kinematic torsion; z hysteresis state; d torsional damping; k_t i motor torque.

- torsion: (14) to (16) corrected, both springs in series at the logged angles;
- whole: the same from angles smoothed by cubics, plus the rate-independent hysteresis that φ has wound up, and d φ̇;
- current: (18) corrected, N (k_t i − J_m N q̈ − r N q̇ − τ_fs sign q̇), from current and disc alone, in motion only.

Smoothing looks as far ahead as back, so these estimates are for logs. A controller has the Kalman filter of predictive
control at its tick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.log.channel_statistics import compute_channel_statistics
from hdagen.log.measured_log import Log
from hdagen.paper.prototype.virtual_prototype import PERIOD

Rows = NDArray[np.bool_]
PASSED_PERIODS = 0.6  # periods of an oscillation in a window of cubics that pass it to 1 %
HAND_FREQUENCY = 10.0  # Hz, assumed: a hand's force has no faster part
HALL_SMOOTHING = 0.201  # s, for Hall sensors, a count of which is three times the torsion of the friction
CERTAIN_DEVIATIONS = 1.0  # standard deviations of the noise above which the torsion counts as changed
LEAST_MOVING_SPEED = 0.05  # rad/s of the joint; the sign of dry friction is unknown below


@dataclass(frozen=True)
class Estimates:
    """Joint torques (T, n, N m); ``current`` is NaN where a joint hardly moves."""

    torsion: Array
    whole: Array
    current: Array


def estimate_torques(
    model: Arm,
    log: Log,
    zero: Array | float = 0.0,
    smoothing: float = PASSED_PERIODS / HAND_FREQUENCY,
    certainly: float = CERTAIN_DEVIATIONS,
) -> Estimates:
    """Estimate the joint torques of a log.

    Args:
        model: the arm with the known springs and kinematic torsion.
        log: motor and joint angles, rad, and motor currents, A.
        zero: angle to add to the discs' angles (n,) or (T, n), rad.
        smoothing: window over which angles are smoothed, s.
        certainly: changes of the torsion below this many standard deviations of its noise wind no hysteresis.

    Returns:
        The three estimates.

    """
    raw = _stack_columns(log, "motor_position", model.n), _stack_columns(log, "joint_position", model.n) + zero
    current = _stack_columns(log, "motor_current", model.n)
    names = (
        "torque_constant", "ratio", "motor_inertia", "viscous_friction", "coulomb_friction", "torsional_damping",
        "hysteresis_torque", "hysteresis_angle",
    )  # fmt: skip
    constant, ratio, inertia, viscous, friction, damping, height, angle = (by_joint(model, name) for name in names)
    theta, q = (_smooth_columns(values, smoothing) for values in raw)
    omega, v = (_smooth_columns(values, smoothing, 1) for values in raw)
    springs, at = _spring_torque(model, *raw), _spring_torque(model, theta, q)
    phi = model.evaluate("torsion", joint_torque=at)["torsion"]
    width = certainly * torsion_noise(model, log, smoothing)
    wound = np.stack(
        [integrate_hysteresis(follow_torsion(phi[:, j], width[j]), angle[j]) for j in range(model.n)], axis=1
    )
    whole = at + height * wound + damping * (omega / ratio - v)
    a = _smooth_columns(raw[1], smoothing, 2)
    motor = constant * _smooth_columns(current, smoothing) - ratio * (inertia * a + viscous * v) - friction * np.sign(v)
    return Estimates(springs, whole, np.where(np.abs(v) > LEAST_MOVING_SPEED, ratio * motor, np.nan))


def by_joint(model: Arm, name: str) -> Array:
    """Look up a parameter of all joints.

    Args:
        model: the arm.
        name: the parameter's name without the joint's number.

    Returns:
        Its value at each joint (n,), SI; 0 where a joint does not have it.

    """
    return np.array([model.parameters.get(f"{name}_{j}", 0.0) for j in range(1, model.n + 1)])


def _stack_columns(log: Log, name: str, n: int) -> Array:
    return np.stack([log[f"{name}_{j}"] for j in range(1, n + 1)], axis=1)


def _smooth_columns(values: Array, seconds: float, derivative: int = 0) -> Array:
    from scipy.signal import savgol_filter

    return savgol_filter(values, _window_rows(seconds), 3, deriv=derivative, delta=PERIOD, axis=0)


def _window_rows(seconds: float) -> int:
    """Rows of a window, an odd number."""
    return 2 * int(seconds / PERIOD / 2) + 1


def _spring_torque(model: Arm, theta: Array, q: Array) -> Array:
    none = np.zeros_like(theta)
    found = model.evaluate(
        "torque_estimate", motor_position=theta, joint_position=q, motor_velocity=none, motor_acceleration=none,
        motor_torque=none,
    )  # fmt: skip
    return found["series"]


def torsion_noise(model: Arm, log: Log, smoothing: float) -> Array:
    """Standard deviation of the smoothed φ (n, rad) from the noise of both encoders in the log."""
    from scipy.signal import savgol_coeffs

    left = float(np.linalg.norm(savgol_coeffs(_window_rows(smoothing), 3)))
    found = []
    for j in range(1, model.n + 1):
        motor, joint = (
            compute_channel_statistics(name, log[name]).noise for name in (f"motor_position_{j}", f"joint_position_{j}")
        )
        found.append(left * np.hypot(motor / model.parameters[f"ratio_{j}"], joint))
    return np.array(found)


def follow_torsion(phi: Array, width: float) -> Array:
    """φ (T,) without movements of up to ``width`` to and fro: it rests until φ is farther off, and is then drawn along.
    Noise would unwind a hysteresis, for which every step counts."""
    out, now = np.empty(len(phi)), float(phi[0])
    for k, value in enumerate(phi.tolist()):
        now = min(max(now, value - width), value + width)
        out[k] = now
    return out


def integrate_hysteresis(phi: Array, angle: float) -> Array:
    """Integrate dz = (dφ − |dφ| z)/δ along φ (T,), exact from row to row; return z. ``angle`` is δ, 0 without a
    hysteresis. z begins as if φ had risen from 0 to its first value."""
    z = np.zeros(len(phi))
    if angle <= 0:
        return z
    z[0] = np.sign(phi[0]) * -np.expm1(-abs(phi[0]) / angle)
    steps = np.diff(phi)
    decay, signs = np.exp(-np.abs(steps) / angle).tolist(), np.sign(steps).tolist()
    now = float(z[0])
    for k, (left, sign) in enumerate(zip(decay, signs, strict=True), 1):
        now = sign + (now - sign) * left
        z[k] = now
    return z


def column_rms(error: Array, rows: Rows | slice = slice(None)) -> Array:
    """Compute the root mean square of each column, without NaN.

    Args:
        error: values (T, n).
        rows: the rows that count.

    Returns:
        Root mean square (n,), in the unit of ``error``.

    """
    found: Array = np.sqrt(np.nanmean(error[rows] ** 2, axis=0))
    return found
