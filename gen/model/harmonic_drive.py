"""The harmonic drive: springs of wave generator and flexspline in series, and their exact inverse.

Legend (paper's letters): τ joint torque, N m; φ torsion, rad at the joint; N ratio; K_f0, c_f flexspline; K_w0, c_w
wave generator.

    φ(τ) = arctan(c_f τ)/(c_f K_f0) + sign τ (1 − exp(−c_w |τ|/N)) / (c_w N K_w0)              (11) with (2), one sign
    for all

The law saturates: its inverse exists below π/(2 c_f K_f0) + 1/(c_w N K_w0) only. From `law_torque` on it continues
along its tangent.

The inverse. With ψ = c_f K_f0 φ_f the flexspline's angle, t = tan ψ = c_f τ, y = c_f K_f0 |φ|,

    ψ + A (1 − exp(−B t)) = y,      A = c_f K_f0/(c_w N K_w0),   B = c_w/(N c_f).

t has a pole at y = π/2 + A that the law never reaches, so τ (π/2 + A − y)/y is a tame function of y, and its
polynomial through Chebyshev's points is the inverse. `prepare` makes its coefficients from the parameters, solving
the equation at the points; a step of the arm then costs one polynomial and one division. Degree and corrections are
chosen when the model is built, so that the error stays below 1e-12 rad for springs anywhere within `SPRING_SPREAD` of
the nominal (`plan`); a law too sharp for the polynomial alone is corrected by Householder's iteration of order four.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from gen.robot.description import Drive
from gen.robot.gear_catalogue import SPRING_KEYS

INVERSE_TOLERANCE = 1e-12  # rad, of the inverse
SPRING_SPREAD = 1.25  # factor about the nominal springs, each either way, over which the inverse keeps it
POLYNOMIAL_DEGREES = (15, 19, 23, 27, 31)  # as many coefficients as make full trees
NODE_CROWDING = 0.55  # κ
NODE_STEPS = 4  # corrections at a node of the polynomial, from afar
MOST_CORRECTIONS = 4


@dataclass(frozen=True)
class InversePlan:
    """The way in which the inverse is computed: degree of the polynomial, and corrections after it."""

    degree: int
    corrections: int


@dataclass(frozen=True)
class SpringConstants:
    """The constants of one drive's law; symbols or numbers."""

    scale: Any  # c_f K_f0, 1/rad
    pole: Any  # torsion at which the law would have its pole, rad
    c_f: Any
    A: Any
    B: Any
    law_torque: Any
    law_psi: Any  # ψ there
    law_torsion: Any  # φ there
    law_stiffness: Any  # dτ/dφ there


def spring_constants(p: Mapping[str, Any]) -> SpringConstants:
    """Work out the constants of the springs' law.

    Args:
        p: Symbols or numbers under the robot file's keys.

    Returns:
        The constants.

    """
    c_f, scale = p["flexspline_stiffening"], p["flexspline_stiffening"] * p["flexspline_stiffness"]
    soft = p["wave_generator_stiffening"] * p["ratio"] * p["wave_generator_stiffness"]
    A, B = scale / soft, p["wave_generator_stiffening"] / (p["ratio"] * c_f)
    last = c_f * p["law_torque"]
    faded, angle = ca.exp(-B * last), ca.atan(last)
    torsion_there = (angle + A * (1 - faded)) / scale
    stiffness_there = scale / (c_f * (1 / (1 + last * last) + A * B * faded))
    return SpringConstants(
        scale, (np.pi / 2 + A) / scale, c_f, A, B, p["law_torque"], angle, torsion_there, stiffness_there
    )


def spring_torsion(tau: Any, k: SpringConstants) -> Any:
    """Write the torsion of the springs under a torque, with its continuation beyond ``law_torque``.

    Args:
        tau: Joint torque, N m.
        k: The constants of the law.

    Returns:
        φ(τ), rad.

    """
    size = ca.fabs(tau)
    inside = ca.fmin(size, k.law_torque)
    t = k.c_f * inside
    return ca.sign(tau) * ((ca.atan(t) + k.A * (1 - ca.exp(-k.B * t))) / k.scale + (size - inside) / k.law_stiffness)


def spring_compliance(tau: Any, k: SpringConstants) -> Any:
    """Write the slope of the torsion.

    It holds at τ = 0 too, where differentiating `spring_torsion` through |τ| would give 0.

    Args:
        tau: Joint torque, N m.
        k: The constants of the law.

    Returns:
        dφ/dτ, rad/(N m).

    """
    t = k.c_f * ca.fmin(ca.fabs(tau), k.law_torque)
    return k.c_f * (1 / (1 + t * t) + k.A * k.B * ca.exp(-k.B * t)) / k.scale


def _solve_from_afar(y: Any, k: SpringConstants) -> Any:
    """t at y from the larger of two lower bounds, by `NODE_STEPS` corrections."""
    psi = ca.fmin(ca.fmax(y / (1 + k.A * k.B), y - k.A), k.law_psi)
    for _ in range(NODE_STEPS):
        psi = psi + householder_step(y, psi, ca.tan(psi), k.A, k.B)
    return ca.tan(psi)


def inverse_coefficients(k: SpringConstants, degree: int) -> Any:
    """Write the coefficients of the springs' inverse: of the polynomial for τ (π/2 + A − y)/y over `_crowd_nodes`.

    Args:
        k: The constants of the law.
        degree: Degree of the polynomial.

    Returns:
        The coefficients (degree + 1), N m, lowest power first.

    """
    count = degree + 1
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    shares = []
    for node in nodes:
        roots = np.roots([NODE_CROWDING, 0.0, 1.0, -(1.0 + NODE_CROWDING) * 0.5 * (node + 1.0)])
        shares.append(float(roots[np.abs(roots.imag).argmin()].real))  # the other two are complex
    y = k.scale * k.law_torsion * ca.DM(shares)
    values = _solve_from_afar(y, k) / k.c_f * (np.pi / 2 + k.A - y) / y
    rows = 2.0 / count * np.polynomial.chebyshev.chebvander(nodes, degree).T
    rows[0] /= 2.0
    monomials = np.zeros((count, count))  # column m: Chebyshev's polynomial m in powers
    for m in range(count):
        monomials[: m + 1, m] = np.polynomial.chebyshev.cheb2poly(np.eye(count)[m])[: m + 1]
    # in two steps: Chebyshev's coefficients decay, and only so do the large integers of their powers do no harm
    return ca.sparsify(ca.DM(monomials)) @ (ca.DM(rows) @ values)


def _crowd_nodes(size: Any, k: SpringConstants) -> Any:
    """From −1 at φ = 0 to 1 at law_torsion, by s + κ s³, s = φ/law_torsion: where the law is steep Chebyshev's points
    stand closer, which saves a quarter of them."""
    first, third = 2 / (1 + NODE_CROWDING) / k.law_torsion, 2 * NODE_CROWDING / (1 + NODE_CROWDING) / k.law_torsion**3
    return size * (first + third * (size * size)) - 1


def evaluate_polynomial(coefficients: Any, x: Any) -> Any:
    """Σ a_k x^k by Estrin's scheme: the depth is that of a tree, which is what a processor waits for."""
    terms = [coefficients[k] for k in range(coefficients.numel())]
    power = x
    while len(terms) > 1:
        pairs = [terms[k] + power * terms[k + 1] for k in range(0, len(terms) - 1, 2)]
        terms = pairs + terms[2 * len(pairs) :]  # a term without a partner is kept
        power = power * power
    return terms[0]


def spring_torque(phi: Any, k: SpringConstants, coefficients: Any, plan: InversePlan) -> Any:
    """Write the torque of the springs: the inverse of `spring_torsion` within `INVERSE_TOLERANCE`.

    Args:
        phi: Torsion, rad.
        k: The constants of the law.
        coefficients: Coefficients of `inverse_coefficients`.
        plan: Degree and corrections of the inverse.

    Returns:
        τ(φ), N m.

    """
    inside = ca.fmax(ca.fmin(phi, k.law_torsion), -k.law_torsion)
    size = ca.fabs(inside)
    tau = inside * (1 / (k.pole - size)) * evaluate_polynomial(coefficients, _crowd_nodes(size, k))
    if plan.corrections:
        y, t = k.scale * size, k.c_f * ca.fabs(tau)
        for _ in range(plan.corrections):
            d = householder_step(y, ca.atan(t), t, k.A, k.B)
            u = d + d * d * d / 3
            t = (t + u) / (1 - t * u)  # tan(ψ + d)
        tau = ca.sign(phi) * t / k.c_f
    return tau + k.law_stiffness * (phi - inside)


def householder_step(y: Any, psi: Any, t: Any, A: Any, B: Any) -> Any:
    """The step towards the root of g(ψ) = ψ + A (1 − exp(−B tan ψ)) − y, of order four, with one division.

    Source: Householder, The Numerical Treatment of a Single Nonlinear Equation (1970).
    """
    faded = A * ca.exp(-B * t)
    g = psi + A - faded - y
    secant2 = 1 + t * t
    slope = B * faded * secant2
    bend = 2 * t - B * secant2
    g1 = 1 + slope
    g2 = slope * bend
    g3 = slope * (bend * bend + 2 * secant2 - 2 * B * t * secant2)
    return -g * (g1 * g1 - g * g2 / 2) / (g1 * g1 * g1 - g * g1 * g2 + g * g * g3 / 6)


def spring_energy(tau: Any, k: SpringConstants) -> Any:
    """Write the energy that both springs store.

    Args:
        tau: Torque of the springs, N m.
        k: The constants of the law.

    Returns:
        ∫ τ dφ, J.

    """
    size = ca.fabs(tau)
    inside = ca.fmin(size, k.law_torque)
    t = k.c_f * inside
    flexspline = ca.log(1 + t * t) / (2 * k.c_f * k.scale)
    wave_generator = k.A * (1 - (1 + k.B * t) * ca.exp(-k.B * t)) / (k.B * k.c_f * k.scale)
    beyond = (size - inside) / k.law_stiffness
    return flexspline + wave_generator + (size + inside) * beyond / 2


def plan_inverse(drives: Sequence[Drive]) -> InversePlan:
    """Choose the cheapest inverse that stays within `INVERSE_TOLERANCE` for springs within `SPRING_SPREAD` of each
    drive's nominal ones.

    Args:
        drives: The flexible drives of an arm.

    Returns:
        Degree of the polynomial, and the number of corrections after it.

    Raises:
        ValueError: The stiffening is too sharp for every way.

    """
    for degree, corrections in [
        *((d, 0) for d in POLYNOMIAL_DEGREES),
        *((POLYNOMIAL_DEGREES[0], c) for c in range(1, MOST_CORRECTIONS + 1)),
    ]:
        chosen = InversePlan(degree, corrections)
        if all(_largest_error(drive, chosen) <= INVERSE_TOLERANCE for drive in drives):
            return chosen
    raise ValueError(
        f"the spring law cannot be inverted to {INVERSE_TOLERANCE:g} rad: "
        "its stiffening is too sharp for law_torque; lower law_torque"
    )


@cache
def _make_inversion(chosen: InversePlan) -> tuple[Any, Any]:
    """Of any drive: the inverse's coefficients from springs, ratio and law_torque, and its errors, rad, at torques."""
    p = {key: ca.SX.sym(key) for key in (*SPRING_KEYS, "ratio", "law_torque")}
    tau, law, coefficients = ca.SX.sym("tau"), spring_constants(p), ca.SX.sym("a", chosen.degree + 1)
    phi = spring_torsion(tau, law)
    found = spring_torsion(spring_torque(phi, law, coefficients, chosen), law)
    make = ca.Function("make", list(p.values()), [inverse_coefficients(law, chosen.degree)])
    return make, ca.Function("error", [tau, coefficients, *p.values()], [ca.fabs(found - phi)])


def _largest_error(drive: Drive, chosen: InversePlan) -> float:
    """Largest error of the inverse, rad, over the corners of the springs' spread."""
    make, error = _make_inversion(chosen)
    fixed = [abs(drive.ratio.nominal), drive.law_torque.nominal]  # type: ignore[union-attr]
    grid = np.concatenate([np.geomspace(1e-6, 1e-2, 20), np.linspace(1e-2, 1.5, 130)]) * fixed[1]
    worst = 0.0
    corners = itertools.product((1.0, SPRING_SPREAD, 1 / SPRING_SPREAD), repeat=4)  # the nominal springs first
    for factors in corners:
        values = [getattr(drive, key).nominal * factor for key, factor in zip(SPRING_KEYS, factors, strict=True)]
        errors = np.array(error(grid.reshape(1, -1), make(*values, *fixed), *values, *fixed))
        if not np.isfinite(errors).all():
            return np.inf
        worst = max(worst, float(errors.max()))
        if worst > INVERSE_TOLERANCE:
            break
    return worst
