"""The harmonic drive: springs of wave generator and flexspline in series, and their exact inverse.

Legend (paper's letters): τ joint torque, N m; φ torsion, rad at the joint; N ratio; K_f0, c_f flexspline; K_w0, c_w wave generator.

    φ(τ) = arctan(c_f τ)/(c_f K_f0) + sign τ (1 − exp(−c_w |τ|/N)) / (c_w N K_w0)              (11) with (2), one sign for all

The law saturates: its inverse exists below π/(2 c_f K_f0) + 1/(c_w N K_w0) only. From `law_torque` on it continues along its tangent.

The inverse. With ψ = c_f K_f0 φ_f the flexspline's angle, t = tan ψ = c_f τ, y = c_f K_f0 |φ|,

    ψ + A (1 − exp(−B t)) = y,      A = c_f K_f0/(c_w N K_w0),   B = c_w/(N c_f),

which is solved from the larger of two lower bounds by a fixed number of Householder steps of order four. The number is chosen when
the model is built, so that the error stays below 1e-12 rad wherever the springs may lie (`iterations`).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from gen.robot import Drive

ERROR = 1e-12  # rad, of the inverse
SPREAD = 1.5  # factor about the nominal springs over which the inverse keeps it
MOST = 6


@dataclass(frozen=True)
class Springs:
    """The constants of one drive's law; symbols or numbers."""

    scale: Any  # c_f K_f0, 1/rad
    c_f: Any
    A: Any
    B: Any
    law_torque: Any
    law_psi: Any  # ψ there
    law_torsion: Any  # φ there
    law_stiffness: Any  # dτ/dφ there


def springs(p: Mapping[str, Any]) -> Springs:
    """The law's constants from the robot file's keys."""
    c_f, scale = p["flexspline_stiffening"], p["flexspline_stiffening"] * p["flexspline_stiffness"]
    soft = p["wave_generator_stiffening"] * p["ratio"] * p["wave_generator_stiffness"]
    A, B = scale / soft, p["wave_generator_stiffening"] / (p["ratio"] * c_f)
    last = c_f * p["law_torque"]
    faded = np.exp(-B * last) if isinstance(last, float) else ca.exp(-B * last)
    angle = np.arctan(last) if isinstance(last, float) else ca.atan(last)
    return Springs(
        scale,
        c_f,
        A,
        B,
        p["law_torque"],
        angle,
        (angle + A * (1 - faded)) / scale,
        scale / (c_f * (1 / (1 + last * last) + A * B * faded)),
    )


def torsion(tau: Any, k: Springs) -> Any:
    """φ(τ), rad, with its continuation."""
    size = ca.fabs(tau)
    inside = ca.fmin(size, k.law_torque)
    t = k.c_f * inside
    return ca.sign(tau) * ((ca.atan(t) + k.A * (1 - ca.exp(-k.B * t))) / k.scale + (size - inside) / k.law_stiffness)


def compliance(tau: Any, k: Springs) -> Any:
    """dφ/dτ, rad/(N m), also at τ = 0 where differentiating `torsion` through |τ| would give 0."""
    t = k.c_f * ca.fmin(ca.fabs(tau), k.law_torque)
    return k.c_f * (1 / (1 + t * t) + k.A * k.B * ca.exp(-k.B * t)) / k.scale


def spring_torque(phi: Any, k: Springs, steps: int) -> Any:
    """τ(φ), N m: the inverse of `torsion` within `ERROR`."""
    size = ca.fabs(phi)
    inside = ca.fmin(size, k.law_torsion)
    y = k.scale * inside
    psi = ca.fmin(ca.fmax(y / (1 + k.A * k.B), y - k.A), k.law_psi)
    t = ca.tan(psi)
    for step in range(steps):
        d = householder(y, psi, t, k.A, k.B)
        if step < steps - 1:
            psi = psi + d
            t = ca.tan(psi)
        else:  # the last correction is tiny: tan(ψ + d) by the addition theorem, tan d by its series
            u = d + d * d * d / 3
            t = (t + u) / (1 - t * u)
    return ca.sign(phi) * (t / k.c_f + k.law_stiffness * (size - inside))


def householder(y: Any, psi: Any, t: Any, A: Any, B: Any) -> Any:
    """The step towards the root of g(ψ) = ψ + A (1 − exp(−B tan ψ)) − y, order four (Householder 1970), one division."""
    faded = A * ca.exp(-B * t)
    g = psi + A - faded - y
    secant2 = 1 + t * t
    slope = B * faded * secant2
    bend = 2 * t - B * secant2
    g1 = 1 + slope
    g2 = slope * bend
    g3 = slope * (bend * bend + 2 * secant2 - 2 * B * t * secant2)
    return -g * (g1 * g1 - g * g2 / 2) / (g1 * g1 * g1 - g * g1 * g2 + g * g * g3 / 6)


def energy(tau: Any, k: Springs) -> Any:
    """∫ τ dφ, J, of both springs at spring torque τ."""
    size = ca.fabs(tau)
    inside = ca.fmin(size, k.law_torque)
    t = k.c_f * inside
    flexspline = ca.log(1 + t * t) / (2 * k.c_f * k.scale)
    wave_generator = k.A * (1 - (1 + k.B * t) * ca.exp(-k.B * t)) / (k.B * k.c_f * k.scale)
    beyond = (size - inside) / k.law_stiffness
    return flexspline + wave_generator + (size + inside) * beyond / 2


def iterations(drive: Drive) -> int:
    """Householder steps that keep `spring_torque` within `ERROR` for springs within `SPREAD` of the nominal, each either way."""
    keys = ("flexspline_stiffness", "flexspline_stiffening", "wave_generator_stiffness", "wave_generator_stiffening")
    tau, c = ca.SX.sym("tau"), ca.SX.sym("c", 8)
    law = Springs(*(c[i] for i in range(8)))
    for steps in range(1, MOST + 1):
        error = ca.Function(
            "error", [tau, c], [torsion(spring_torque(torsion(tau, law), law, steps), law) - torsion(tau, law)]
        )
        worst = 0.0
        for factors in itertools.product((1 / SPREAD, 1.0, SPREAD), repeat=4):
            p = {key: getattr(drive, key).nominal * f for key, f in zip(keys, factors, strict=True)}
            p |= {"ratio": float(abs(drive.ratio.nominal)), "law_torque": float(drive.law_torque.nominal)}  # type: ignore[union-attr]
            k = springs(p)
            numbers = [k.scale, k.c_f, k.A, k.B, k.law_torque, k.law_psi, k.law_torsion, k.law_stiffness]
            grid = np.concatenate([[0.0], np.geomspace(1e-4, 1.5, 150)]) * p["law_torque"]
            found = np.abs(np.array(error(grid.reshape(1, -1), ca.DM(numbers)))).max()
            worst = max(worst, float(found)) if np.isfinite(found) else np.inf
        if worst <= ERROR:
            return steps
    raise ValueError(
        f"the spring law cannot be inverted to {ERROR:g} rad within {MOST} steps: its stiffening is too sharp for law_torque"
    )
