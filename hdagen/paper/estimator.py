"""Joint torque from a log, without a torque sensor, in the steps by which it gets better.

Legend: φ torsion, θ/N − q less the kinematic torsion; z hysteresis state; d torsional damping; k_t i motor torque.

- torsion: (14) to (16) corrected, both springs in series at the logged angles;
- whole: the same from angles smoothed by cubics, with the hysteresis that φ has wound up, rate-independent, and d φ̇;
- current: (18) corrected, N (k_t i − J_m N q̈ − r N q̇ − τ_fs sign q̇), from current and disc alone, in motion only.

Smoothing looks as far ahead as back: these are for logs. What a controller has at its tick is the Kalman filter of the
predictive one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.log import Log
from hdagen.paper.prototype import PERIOD
from hdagen.plant import Arm, Array

Rows = NDArray[np.bool_]
SMOOTHING = 0.061  # s of the cubics: a fifth of the period of the fastest motion here
HALL_SMOOTHING = 0.201  # where a count of the motor is three times the torsion of the friction
MOVING = 0.05  # rad/s of the joint: slower, dry friction has no known sign


@dataclass(frozen=True)
class Estimates:
    """Joint torques (T, n, N m); ``current`` is NaN where a joint hardly moves."""

    torsion: Array
    whole: Array
    current: Array


def estimated(model: Arm, log: Log, zero: Array | float = 0.0, smoothing: float = SMOOTHING) -> Estimates:
    """The estimates by ``model``, which holds what is known of springs and kinematic torsion; ``zero`` (n, rad) is
    added to the disc's angles."""
    raw = _columns(log, "motor_position", model.n), _columns(log, "joint_position", model.n) + zero
    current = _columns(log, "motor_current", model.n)
    p = model.parameters
    constant, ratio, inertia, viscous, friction, damping, height, angle = (
        np.array([p.get(f"{name}_{j}", 0.0) for j in range(1, model.n + 1)])
        for name in ("torque_constant", "ratio", "motor_inertia", "viscous_friction", "coulomb_friction",
                     "torsional_damping", "hysteresis_torque", "hysteresis_angle")
    )  # fmt: skip
    theta, q = (_smooth(values, smoothing) for values in raw)
    omega, v = (_smooth(values, smoothing, 1) for values in raw)
    springs, at = _series(model, *raw), _series(model, theta, q)
    phi = model.evaluate("torsion", joint_torque=at)["torsion"]
    wound = np.stack([hysteresis(phi[:, j], angle[j]) for j in range(model.n)], axis=1)
    whole = at + height * wound + damping * (omega / ratio - v)
    a = _smooth(raw[1], smoothing, 2)
    motor = constant * _smooth(current, smoothing) - ratio * (inertia * a + viscous * v) - friction * np.sign(v)
    return Estimates(springs, whole, np.where(np.abs(v) > MOVING, ratio * motor, np.nan))


def _columns(log: Log, name: str, n: int) -> Array:
    return np.stack([log[f"{name}_{j}"] for j in range(1, n + 1)], axis=1)


def _smooth(values: Array, seconds: float, derivative: int = 0) -> Array:
    from scipy.signal import savgol_filter

    rows = 2 * int(seconds / PERIOD / 2) + 1
    return savgol_filter(values, rows, 3, deriv=derivative, delta=PERIOD, axis=0)


def _series(model: Arm, theta: Array, q: Array) -> Array:
    none = np.zeros_like(theta)
    found = model.evaluate(
        "torque_estimate", motor_position=theta, joint_position=q, motor_velocity=none, motor_acceleration=none,
        motor_torque=none,
    )  # fmt: skip
    return found["series"]


def hysteresis(phi: Array, angle: float) -> Array:
    """z of dz = (dφ − |dφ| z)/δ along φ (T,), exact from row to row, from 0; ``angle`` is δ (none: 0)."""
    z = np.zeros(len(phi))
    if angle <= 0:
        return z
    steps = np.diff(phi)
    decay, signs = np.exp(-np.abs(steps) / angle).tolist(), np.sign(steps).tolist()
    now = 0.0
    for k, (left, sign) in enumerate(zip(decay, signs, strict=True), 1):
        now = sign + (now - sign) * left
        z[k] = now
    return z


def rms(error: Array, rows: Rows | slice = slice(None)) -> Array:
    """Root mean square by column over rows, NaN left out."""
    found: Array = np.sqrt(np.nanmean(error[rows] ** 2, axis=0))
    return found
