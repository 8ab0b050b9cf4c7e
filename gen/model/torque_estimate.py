"""Joint torque without a torque sensor, from motor angle, joint angle and motor torque.

Legend: θ, ω, α motor angle, speed, acceleration; q joint angle; τ_m motor torque; τ_w torque on the wave generator;
τ_fs level of dry friction; φ torsion; N ratio. Signs: θ and q count in the same direction, so the paper's Δθ of (12)
is θ/N − q here.

Three estimates that share (14), the torsion less the kinematic error:

- series: both springs in series, the exact inverse of (11); needs no motor torque;
- quasi_static: (15)–(17) corrected: the wave generator's torque from the motor's, less friction; between ±τ_fs the
  joint sticks and the series estimate gives τ_w = τ/N by (2);
- dynamic: (15), (16) with τ_w from (18) corrected, in motion.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from gen.effects.effect import Port, Signals
from gen.model import harmonic_drive
from gen.model.arm_model import Model

SX = ca.SX


def measured_torsion(model: Model, j: int, theta: Any, q: Any) -> Any:
    """Write the torsion of a joint less the kinematic error, (12) and (14).

    Args:
        model: The model.
        j: The joint's number from 1.
        theta: Motor angle, rad.
        q: Joint position, rad or m.

    Returns:
        The torsion, rad at the joint.

    """
    p = model.joint_parameters(j)
    error = sum(
        e.equation(Signals(motor_position=theta, ratio=p["ratio"]), p) for e in model.effects_at(Port.TORSION, j)
    )
    return theta * (1 / p["ratio"]) + error - q


def torque_from_torsion(model: Model, j: int, phi: Any) -> Any:
    """Write the springs' torque of a joint.

    Args:
        model: The model.
        j: The joint's number from 1.
        phi: Torsion, rad.

    Returns:
        The torque, N m at the joint.

    """
    p = model.joint_parameters(j)
    return p["stiffness_level"] * harmonic_drive.spring_torque(
        phi, harmonic_drive.spring_constants(p), p["inverse"], model.plan
    )


def estimate_torques(model: Model, theta: Any, q: Any, omega: Any, alpha: Any, motor_torque: Any) -> dict[str, Any]:
    """Write the three estimates of the joint torque.

    Args:
        model: The model.
        theta: Motor angles (n), rad.
        q: Joint positions (n), rad or m.
        omega: Motor speeds (n), rad/s.
        alpha: Motor accelerations (n), rad/s².
        motor_torque: Motor torques (n), N m.

    Returns:
        The estimates by name (n each), N m at the joint; NaN at a rigid drive, which has no torsion to read.

    """
    out: dict[str, list[Any]] = {"series": [], "quasi_static": [], "dynamic": []}
    for j in model.joints:
        if j in model.rigid:
            for values in out.values():
                values.append(SX(float("nan")))
            continue
        p = model.joint_parameters(j)
        phi = measured_torsion(model, j, theta[j - 1], q[j - 1])
        series = torque_from_torsion(model, j, phi)
        friction = p["coulomb_friction"]
        torque = motor_torque[j - 1]
        sliding = torque - ca.sign(torque) * friction
        held = ca.if_else(ca.fabs(torque) > friction, sliding, series / p["ratio"])
        moving = (
            torque
            - p["motor_inertia"] * alpha[j - 1]
            - p["viscous_friction"] * omega[j - 1]
            - friction * ca.sign(omega[j - 1])
        )
        out["series"].append(series)
        for name, wave_generator in (("quasi_static", held), ("dynamic", moving)):
            out[name].append(p["stiffness_level"] * _flexspline_torque(p, phi, wave_generator / p["stiffness_level"]))
    return {name: ca.vertcat(*values) for name, values in out.items()}


def _flexspline_torque(p: dict[str, Any], phi: Any, wave_generator: Any) -> Any:
    """(15), (16): torque of the flexspline from the torsion less the wave generator's own, (6) corrected; from
    `law_torque` on along the tangent, as the springs themselves."""
    c_w, stiffness = p["wave_generator_stiffening"], p["wave_generator_stiffness"]
    wound = ca.sign(wave_generator) * (1 - ca.exp(-c_w * ca.fabs(wave_generator))) / (c_w * stiffness)
    law = harmonic_drive.spring_constants(p)
    angle = (phi - wound / p["ratio"]) * law.scale
    inside = ca.fmin(ca.fabs(angle), law.law_psi)
    t, last = ca.tan(inside), law.c_f * law.law_torque
    return ca.sign(angle) * (t + (1 + last * last) * (ca.fabs(angle) - inside)) / law.c_f
