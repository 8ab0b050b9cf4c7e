"""Compliance laws, each as one tick: impedance (25) and admittance (26) at the tip and at the joints, and positions.

Legend: x tip position, x_d desired, x_e = x − x_d; M, B, K the wanted mass, damping, stiffness; F_e force of the
world on the tip; Λ = (J M_q⁻¹ Jᵀ)⁻¹ the tip's inertia (the paper's m); q joint angle; h period.

The outer laws ask for a joint acceleration, which the inner loops of `gen.model.control_loop` give to a sticking
drive, flexible or rigid. The laws of a tip in space are those of `gen.model.tip_laws_in_space`.
Sources: paper (20)–(26) corrected; Khatib, IEEE J. Robot. Autom. 3 (1987) 43 for Λ.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from gen.model.arm_model import Model
from gen.model.control_loop import ControlLoop, Law
from gen.model.impedance_terms import find_tip_inertia, held_force, list_impedance_gains
from gen.model.symmetric_matrices import solve_symmetric
from gen.model.tip_laws_in_space import admittance_in_space, impedance_in_space

SX = ca.SX


def position_law(model: Model, c: Any) -> Law:
    """PD on the motors about a joint trajectory, with the motion's torque fed forward."""
    loop = ControlLoop(model, "position", (), "joint", ())
    seen, memory = loop.estimate_arm()
    q, v, a = loop.split_reference()
    M_q, bias, J, _ = loop.arm_terms(q, v)
    torque = M_q @ a + bias - J.T @ seen.force
    return loop.make_law(c, loop.position_loop(seen, q, v, a, torque), memory, [])


def impedance_cartesian(model: Model, c: Any) -> Law:
    """(25): F = (Λ/M − 1) F_e + Λ ẍ_d − Λ/M (B ẋ_e + K x_e), with Coriolis and gravity compensated."""
    loop = ControlLoop(
        model,
        "impedance_cartesian",
        list_impedance_gains(("x", "y"), ("kg", "N s/m", "N/m"), (2.0, 45.0, 500.0)),
        "cartesian",
        (),
    )
    seen, memory = loop.estimate_arm()
    x_d, v_d, a_d = loop.split_reference()
    M_q, bias, J, turn = loop.arm_terms(seen.q, seen.v)
    seen, memory = loop.observe_rigid_drives(seen, memory, M_q, bias, J.T @ seen.force)
    M, B, K = loop.mass_damping_stiffness("xy")
    x_e = loop.model.chain.tip_position(seen.q, model.chain_parameters()) - x_d
    v_e = J @ seen.v - v_d
    L = find_tip_inertia(loop, M_q, J)
    F = L @ (a_d - turn + (seen.force - B * v_e - K * x_e) / M) - seen.force
    push = J.T @ F
    idle = -loop.g["posture_damping"] * (M_q @ seen.v)  # without the part that the tip feels
    push = push + idle - J.T @ (L @ (J @ solve_symmetric(M_q, idle)))
    acceleration = solve_symmetric(M_q, push + J.T @ seen.force)
    return loop.make_law(c, loop.torque_loop(seen, push + bias, acceleration), memory, [])


def impedance_joint(model: Model, c: Any) -> Law:
    """(23): M q̈_e + B q̇_e + K q_e = Jᵀ F_e at each joint."""
    axes = tuple(str(j) for j in model.joints)
    loop = ControlLoop(
        model,
        "impedance_joint",
        list_impedance_gains(axes, ("kg m²", "N m s/rad", "N m/rad"), (0.2, 3.0, 30.0)),
        "joint",
        (),
    )
    seen, memory = loop.estimate_arm()
    q_d, v_d, a_d = loop.split_reference()
    M_q, bias, J, _ = loop.arm_terms(seen.q, seen.v)
    seen, memory = loop.observe_rigid_drives(seen, memory, M_q, bias, J.T @ seen.force)
    M, B, K = loop.mass_damping_stiffness(axes)
    outside = J.T @ seen.force
    acceleration = a_d + (outside - B * (seen.v - v_d) - K * (seen.q - q_d)) / M
    torque = M_q @ acceleration + bias - outside
    return loop.make_law(c, loop.torque_loop(seen, torque, acceleration), memory, [])


def admittance_cartesian(model: Model, c: Any) -> Law:
    """(26): the tip follows x_d + x_e with x_e moved by F_e; the joints follow by the inverse of J along the way."""
    n = model.n
    names = (
        *(f"yield_{w}_{a}" for w in ("position", "velocity") for a in "xy"),
        *(f"posture_{j}" for j in model.joints),
    )
    loop = ControlLoop(
        model,
        "admittance_cartesian",
        list_impedance_gains(("x", "y"), ("kg", "N s/m", "N/m"), (2.0, 45.0, 500.0)),
        "cartesian",
        names,
    )
    seen, memory = loop.estimate_arm()
    x_d, v_d, a_d = loop.split_reference()
    M, B, K = loop.mass_damping_stiffness("xy")
    x_e, v_e, q = (
        loop.memory_part("yield_position_x", 2),
        loop.memory_part("yield_velocity_x", 2),
        loop.memory_part("posture_1", n),
    )
    h = loop.g["period"]
    a_e = (seen.force - B * v_e - K * x_e) / M
    M_q, _, J, _ = loop.arm_terms(q, SX.zeros(n))
    weighted = solve_symmetric(M_q, J.T) @ find_tip_inertia(
        loop, M_q, J
    )  # the inverse of J that asks least of the motors
    gap = x_d + x_e - model.chain.tip_position(q, model.chain_parameters())
    v = weighted @ (v_d + v_e + gap / (4 * h))
    turn = loop.arm_terms(q, v)[3]
    a = weighted @ (a_d + a_e - turn)
    bias = loop.arm_terms(q, v)[1]
    torque = M_q @ a + bias - J.T @ seen.force
    moved = [held_force(M[k], B[k], K[k], h, x_e[k], v_e[k], seen.force[k]) for k in range(2)]
    later = [ca.vertcat(*(m[0] for m in moved)), ca.vertcat(*(m[1] for m in moved)), q + h * v]
    T = loop.position_loop(seen, q, v, a, torque)
    # it begins with yielding as far as the arm is from its reference, so that the start needs no jump
    began = loop.measured[n : 2 * n]
    return loop.make_law(
        c, T, [*memory, *later], [model.chain.tip_position(began, model.chain_parameters()) - x_d, -v_d, began]
    )


def admittance_joint(model: Model, c: Any) -> Law:
    """(23) as an admittance: each joint follows q_d + q_e with q_e moved by Jᵀ F_e."""
    n, axes = model.n, tuple(str(j) for j in model.joints)
    names = tuple(f"yield_{w}_{j}" for w in ("position", "velocity") for j in model.joints)
    loop = ControlLoop(
        model,
        "admittance_joint",
        list_impedance_gains(axes, ("kg m²", "N m s/rad", "N m/rad"), (0.2, 3.0, 30.0)),
        "joint",
        names,
    )
    seen, memory = loop.estimate_arm()
    q_d, v_d, a_d = loop.split_reference()
    M, B, K = loop.mass_damping_stiffness(axes)
    q_e, v_e = loop.memory_part("yield_position_1", n), loop.memory_part("yield_velocity_1", n)
    _, _, J, _ = loop.arm_terms(seen.q, seen.v)
    outside = J.T @ seen.force
    a_e = (outside - B * v_e - K * q_e) / M
    q, v, a = q_d + q_e, v_d + v_e, a_d + a_e
    M_q, bias, J_there, _ = loop.arm_terms(q, v)
    T = loop.position_loop(seen, q, v, a, M_q @ a + bias - J_there.T @ seen.force)
    moved = [held_force(M[k], B[k], K[k], loop.g["period"], q_e[k], v_e[k], outside[k]) for k in range(n)]
    later = [ca.vertcat(*(m[0] for m in moved)), ca.vertcat(*(m[1] for m in moved))]
    return loop.make_law(c, T, [*memory, *later], [seen.q - q_d, -v_d])


LAW_BUILDERS = (position_law, impedance_cartesian, impedance_joint, admittance_cartesian, admittance_joint)
SPACE_LAW_BUILDERS = (position_law, impedance_in_space, impedance_joint, admittance_in_space, admittance_joint)


def make_laws(model: Model, c: Any) -> tuple[Law, ...]:
    """Write every controller of the arm.

    Args:
        model: The model.
        c: The symbols of its constants.

    Returns:
        The controllers, in the order of `LAW_BUILDERS`; of a chain in space those of `SPACE_LAW_BUILDERS`.

    """
    builders: tuple[Callable[[Model, Any], Law], ...] = LAW_BUILDERS
    if model.chain.in_space:
        builders = SPACE_LAW_BUILDERS
    return tuple(law(model, c) for law in builders)
