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

from hdagen.channels import describe
from hdagen.log import Log
from hdagen.paper.prototype import PERIOD
from hdagen.plant import Arm, Array

Rows = NDArray[np.bool_]
PASSED = 0.6  # periods in a window of cubics, of an oscillation that they pass to 1 %
HAND = 10.0  # Hz, assumed: a hand's force has nothing faster
HALL_SMOOTHING = 0.201  # where a count of the motor is three times the torsion of the friction
CERTAIN = 1.0  # standard deviations from which a change of the torsion is taken for one
MOVING = 0.05  # rad/s of the joint: slower, dry friction has no known sign


@dataclass(frozen=True)
class Estimates:
    """Joint torques (T, n, N m); ``current`` is NaN where a joint hardly moves."""

    torsion: Array
    whole: Array
    current: Array


def estimated(
    model: Arm, log: Log, zero: Array | float = 0.0, smoothing: float = PASSED / HAND, certainly: float = CERTAIN
) -> Estimates:
    """The estimates by ``model``, which holds what is known of springs and kinematic torsion; ``zero`` (n, rad) is
    added to the disc's angles. Angles are smoothed over ``smoothing`` s; what of the torsion is less than
    ``certainly`` standard deviations of their noise winds no hysteresis."""
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
    width = certainly * noise(model, log, smoothing)
    wound = np.stack([hysteresis(followed(phi[:, j], width[j]), angle[j]) for j in range(model.n)], axis=1)
    whole = at + height * wound + damping * (omega / ratio - v)
    a = _smooth(raw[1], smoothing, 2)
    motor = constant * _smooth(current, smoothing) - ratio * (inertia * a + viscous * v) - friction * np.sign(v)
    return Estimates(springs, whole, np.where(np.abs(v) > MOVING, ratio * motor, np.nan))


def _columns(log: Log, name: str, n: int) -> Array:
    return np.stack([log[f"{name}_{j}"] for j in range(1, n + 1)], axis=1)


def _smooth(values: Array, seconds: float, derivative: int = 0) -> Array:
    from scipy.signal import savgol_filter

    return savgol_filter(values, _rows(seconds), 3, deriv=derivative, delta=PERIOD, axis=0)


def _rows(seconds: float) -> int:
    """Of a window, an odd number."""
    return 2 * int(seconds / PERIOD / 2) + 1


def _series(model: Arm, theta: Array, q: Array) -> Array:
    none = np.zeros_like(theta)
    found = model.evaluate(
        "torque_estimate", motor_position=theta, joint_position=q, motor_velocity=none, motor_acceleration=none,
        motor_torque=none,
    )  # fmt: skip
    return found["series"]


def noise(model: Arm, log: Log, smoothing: float) -> Array:
    """Standard deviation of φ (n, rad) by the noise of both encoders that the log shows, smoothed."""
    from scipy.signal import savgol_coeffs

    left = float(np.linalg.norm(savgol_coeffs(_rows(smoothing), 3)))
    found = []
    for j in range(1, model.n + 1):
        motor, joint = (describe(name, log[name]).noise for name in (f"motor_position_{j}", f"joint_position_{j}"))
        found.append(left * np.hypot(motor / model.parameters[f"ratio_{j}"], joint))
    return np.array(found)


def followed(phi: Array, width: float) -> Array:
    """φ (T,) less what moves by ``width`` and back: it rests until φ is farther off than that, and is then drawn
    along. Noise alone would unwind a hysteresis, for which every step counts."""
    out, now = np.empty(len(phi)), float(phi[0])
    for k, value in enumerate(phi.tolist()):
        now = min(max(now, value - width), value + width)
        out[k] = now
    return out


def hysteresis(phi: Array, angle: float) -> Array:
    """z of dz = (dφ − |dφ| z)/δ along φ (T,), exact from row to row; ``angle`` is δ (none: 0). It begins as if loaded
    once from nothing to the first φ."""
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


def rms(error: Array, rows: Rows | slice = slice(None)) -> Array:
    """Root mean square by column over rows, NaN left out."""
    found: Array = np.sqrt(np.nanmean(error[rows] ** 2, axis=0))
    return found
