"""The planar arm from its Lagrangian, in SymPy: the second opinion on the graph of ``gen.model.chain_dynamics``.

Legend: q coordinates, v = q̇, M mass matrix, C Coriolis matrix, g gravity, T and V kinetic and potential energy,
θ motor angle, φ torsion, U(φ) energy stored in a drive's springs, τ = U′(φ) joint torque.

    L = T − V   gives   M(q) q̈ + C(q, q̇) q̇ + g(q) + s(τ) = torques applied along q

Nothing is shared with ``gen.model.chain_dynamics``: there forces are passed from link to link in link frames, here the
positions of the centres of mass in the base frame are differentiated and nothing else. No code is made from this file.

Source: Spong, Hutchinson, Vidyasagar, Robot Modeling and Control (2006), ch. 7, for the Christoffel symbols;
Spong, Modeling and control of elastic joint robots, J. Dyn. Syst. Meas. Control 109 (1987), for rotors and springs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

KINDS = ("revolute", "prismatic")
DRIVES = ("flexible", "rigid")
MOST_JOINTS = 3

Numeric = Callable[[ArrayLike, ArrayLike, Mapping[str, float]], NDArray[np.float64]]


@dataclass(frozen=True)
class Lagrangian:
    """The arm's equations of motion. Matrices are immutable; n is the number of coordinates, SI units.

    Without drives, and with rigid ones, the coordinates are the joints' (rad, m). A flexible drive adds a motor angle;
    these stand first, in the order of the joints, as in the state vector of docs/project/design.md.
    """

    kinds: tuple[str, ...]
    drives: tuple[str, ...]  # () for the bare links
    q: tuple[sp.Symbol, ...]
    v: tuple[sp.Symbol, ...]
    parameters: tuple[sp.Symbol, ...]
    joint_torques: tuple[sp.Symbol, ...]  # τ_j = U_j′(φ_j) of the flexible drives
    mass_matrix: sp.ImmutableMatrix  # M, n × n
    coriolis_matrix: sp.ImmutableMatrix  # C, n × n, by Christoffel symbols
    gravity: sp.ImmutableMatrix  # g, n × 1
    spring_torques: sp.ImmutableMatrix  # s, n × 1, linear in the joint torques
    tip: sp.ImmutableMatrix  # 2 × 1, base frame
    jacobian: sp.ImmutableMatrix  # ∂tip/∂q, 2 × n
    kinetic_energy: sp.Expr
    potential_energy: sp.Expr  # gravity, and U_j(φ_j) of the flexible drives


@dataclass(frozen=True)
class NumericLagrangian:
    """The same as NumPy functions f(q, v, parameters by name) -> array."""

    mass_matrix: Numeric
    coriolis_matrix: Numeric
    gravity: Numeric
    tip: Numeric
    jacobian: Numeric
    kinetic_energy: Numeric
    potential_energy: Numeric


@cache
def derive_lagrangian(kinds: tuple[str, ...], drives: tuple[str, ...] = ()) -> Lagrangian:
    """Derive the equations of motion of a chain.

    Args:
        kinds: Kind of each joint, base first: ``revolute`` or ``prismatic``.
        drives: Drive of each joint: ``flexible`` or ``rigid``; none for bare links.

    Returns:
        The equations of motion.

    Raises:
        ValueError: The chain is none, with one sentence for each problem.

    """
    _check_arguments(kinds, drives)
    n = len(kinds)
    joints = _joint_symbols("joint_position", range(n))
    rates = _joint_symbols("joint_velocity", range(n))
    flexible = [j for j in range(n) if drives and drives[j] == "flexible"]
    motors, motor_rates = _joint_symbols("motor_position", flexible), _joint_symbols("motor_velocity", flexible)
    q, v = motors + joints, motor_rates + rates

    kinetic, height, tip = _link_energies(kinds, joints, rates)
    if drives:
        theta_rate = {j: _joint_symbol("ratio", j) * rates[j] for j in range(n)}
        theta_rate |= dict(zip(flexible, motor_rates, strict=True))
        kinetic += sum(_joint_symbol("motor_inertia", j) * theta_rate[j] ** 2 for j in range(n)) / 2
    springs, torques, spring_torques = _spring_terms(flexible, joints, motors, q)

    M = sp.hessian(kinetic, v)
    return Lagrangian(
        kinds=kinds,
        drives=drives,
        q=q,
        v=v,
        parameters=_parameter_symbols(n, bool(drives)),
        joint_torques=torques,
        mass_matrix=sp.ImmutableMatrix(M),
        coriolis_matrix=_christoffel_matrix(M, q, v),
        gravity=_energy_gradient(height, q),
        spring_torques=spring_torques,
        tip=sp.ImmutableMatrix(tip),
        jacobian=sp.ImmutableMatrix(tip.jacobian(q)),
        kinetic_energy=kinetic,
        potential_energy=height + springs,
    )


@cache
def make_numeric(model: Lagrangian) -> NumericLagrangian:
    """Make NumPy functions of a model.

    Args:
        model: The equations of motion, without flexible drives.

    Returns:
        Functions of q, v and the parameters by name.

    Raises:
        ValueError: A drive is flexible: its springs are symbols without numbers.

    """
    if "flexible" in model.drives:
        raise ValueError("a flexible drive's spring energy is a symbol without a number: give rigid drives or none")
    names = [str(parameter) for parameter in model.parameters]

    def numeric(expression: Any) -> Numeric:
        if expression is model.tip or expression is model.gravity:
            expression = list(expression)  # vectors come back as (n,), matrices as (rows, columns)
        function = sp.lambdify([model.q, model.v, model.parameters], expression, modules="numpy", cse=True)
        return lambda q, v, p: np.asarray(function(q, v, [p[name] for name in names]), dtype=float)

    return NumericLagrangian(**{field.name: numeric(getattr(model, field.name)) for field in fields(NumericLagrangian)})


def _check_arguments(kinds: tuple[str, ...], drives: tuple[str, ...]) -> None:
    problems = []
    if not 1 <= len(kinds) <= MOST_JOINTS:
        problems.append(f"the Lagrangian is derived for 1 to {MOST_JOINTS} joints, not for {len(kinds)}")
    if drives and len(drives) != len(kinds):
        problems.append(f"{len(drives)} drives are given for {len(kinds)} joints: give one per joint, or none")
    for noun, given, possible in (("kind", kinds, KINDS), ("drive", drives, DRIVES)):
        problems += [
            f"{noun} of joint {j} is {one!r}: possible are {', '.join(possible)}"
            for j, one in enumerate(given, start=1)
            if one not in possible
        ]
    if problems:
        raise ValueError("\n".join(problems))


def _joint_symbol(name: str, joint: int) -> sp.Symbol:
    """The symbol of a joint's quantity under its name in docs/project/design.md; joints count from 1 there."""
    return sp.Symbol(f"{name}_{joint + 1}", real=True)


def _joint_symbols(name: str, joints: Sequence[int]) -> tuple[sp.Symbol, ...]:
    return tuple(_joint_symbol(name, j) for j in joints)


def _gravity_vector() -> sp.Matrix:
    return sp.Matrix(sp.symbols("gravity_x gravity_y", real=True))


def _parameter_symbols(n: int, driven: bool) -> tuple[sp.Symbol, ...]:
    names = ["length", "mass", "center_of_mass", "inertia"] + ["ratio", "motor_inertia"] * driven
    return tuple(_gravity_vector()) + tuple(_joint_symbol(name, j) for j in range(n) for name in names)


def _link_energies(
    kinds: tuple[str, ...], q: tuple[sp.Symbol, ...], v: tuple[sp.Symbol, ...]
) -> tuple[sp.Expr, sp.Expr, sp.Matrix]:
    """Kinetic energy, potential energy and tip of the links. A prismatic link slides along its x and has no length."""
    angle, kinetic, potential, origin = sp.S.Zero, sp.S.Zero, sp.S.Zero, sp.zeros(2, 1)
    for j, kind in enumerate(kinds):
        slide, length = q[j], 0
        if kind == "revolute":
            slide, length = 0, _joint_symbol("length", j)
            angle = angle + q[j]
        along = sp.Matrix([sp.cos(angle), sp.sin(angle)])
        center = origin + (slide + _joint_symbol("center_of_mass", j)) * along
        velocity = center.jacobian(q) * sp.Matrix(v)
        spin = sp.Matrix([sp.diff(angle, coordinate) for coordinate in q]).dot(v)
        kinetic += (_joint_symbol("mass", j) * velocity.dot(velocity) + _joint_symbol("inertia", j) * spin**2) / 2
        potential -= _joint_symbol("mass", j) * _gravity_vector().dot(center)
        origin = origin + (slide + length) * along
    return kinetic, potential, origin


def _spring_terms(
    flexible: list[int], joints: tuple[sp.Symbol, ...], motors: tuple[sp.Symbol, ...], q: tuple[sp.Symbol, ...]
) -> tuple[sp.Expr, tuple[sp.Symbol, ...], sp.ImmutableMatrix]:
    """Stored energy, joint torques and generalised spring torques: U any function of φ = θ/N − q, and τ its slope."""
    torques = _joint_symbols("joint_torque", flexible)
    stored, along = sp.S.Zero, sp.zeros(len(q), 1)
    for j, theta, torque in zip(flexible, motors, torques, strict=True):
        torsion = theta / _joint_symbol("ratio", j) - joints[j]
        stored += sp.Function(f"stored_energy_{j + 1}")(torsion)
        along += torque * sp.Matrix([sp.diff(torsion, coordinate) for coordinate in q])
    return stored, torques, sp.ImmutableMatrix(along)


def _energy_gradient(expression: sp.Expr, q: tuple[sp.Symbol, ...]) -> sp.ImmutableMatrix:
    return sp.ImmutableMatrix([sp.diff(expression, coordinate) for coordinate in q])


def _christoffel_matrix(M: sp.Matrix, q: tuple[sp.Symbol, ...], v: tuple[sp.Symbol, ...]) -> sp.ImmutableMatrix:
    """C_ij = Σ_k (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i) v_k / 2, for which Ṁ − 2C is skew."""
    slopes = [M.diff(coordinate) for coordinate in q]
    n = len(q)
    return sp.ImmutableMatrix(
        n, n, lambda i, j: sum((slopes[k][i, j] + slopes[j][i, k] - slopes[i][j, k]) * v[k] for k in range(n)) / 2
    )
