"""Compliance laws of a tip in space: impedance (25) and admittance (26) in position and orientation.

Legend: x tip position, R its orientation, x_d, R_d wanted; x_e = x − x_d, e rotation vector of R R_dᵀ; M, B, K wanted
mass, damping, stiffness along x, y, z and about them; F_e, m_e force of the world on the tip and its moment; D(e) left
Jacobian (`gen.model.rotation_vectors`); W mass matrix of the links with the reflected rotors; Λ = (J W⁻¹ Jᵀ + S)⁻¹
inertia of the tip, 6 × 6, damped by S; J⁺ = W⁻¹ Jᵀ Λ; q_0 wanted posture.

Both laws promise M ẍ_e + B ẋ_e + K x_e = F_e and M ë + B ė + K e = D(e)ᵀ m_e. As D(e)ᵀ m_e does the work of the moment,
(D(e)ᵀ m_e)·ė = m_e·(D(e) ė), the promise is passive for every M, B and K; about a fixed axis it is the linear one.

The joints move by q̈ = J⁺ (a − J̇ v) + (1 − J⁺ J)(−d v − k (q − q_0)), a the acceleration that the promise asks of the
tip: what does not move the tip is pulled to the posture. As Λ is damped, the directions that a singular posture or an
arm of fewer than six joints has lost are given up, and all torques stay finite.

Source: paper (25), (26); Khatib, IEEE J. Robot. Autom. 3 (1987) 43; Nakamura, Hanafusa, J. Dyn. Syst. Meas. Control 108
(1986) 163 for the damping; Caccavale et al., IEEE/ASME Trans. Mechatron. 8 (2003) 1 for impedance in orientation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen.effects.effect import Parameter
from gen.model.arm_model import Model
from gen.model.control_loop import ControlLoop, Law
from gen.model.impedance_terms import find_tip_inertia, held_force, list_impedance_gains
from gen.model.rotation_vectors import (
    find_angular_acceleration,
    find_left_jacobian,
    find_rotation_vector,
    invert_left_jacobian,
    make_rotation_matrix,
)
from gen.model.symmetric_matrices import solve_symmetric
from gen.robot.description import Joint

SX = ca.SX
TIP_DIRECTIONS = 6
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")  # of gains: along the axes of the base frame, and about them
ROTATION_DAMPING = (0.1, 100.0)  # 1/(kg m²): usual, and of fewer than six joints, which give up the turn first
SPEED_NORM = 8  # at half of a speed limit the joints of an admittance are slowed down by 0.05 %
RETURN_SPEED = (
    0.05,
    0.25,
)  # m/s and rad/s: the fastest return of an admittance's joints to a tip that they do not reach


@dataclass(frozen=True)
class WantedPose:
    """The reference of the tip, twists and their rates as (6): along the axes, then about them."""

    position: Any
    rotation: Any  # 3 × 3
    velocity: Any
    acceleration: Any


def list_space_gains(joints: Sequence[Joint]) -> tuple[Parameter, ...]:
    """List the gains of the laws of a tip in space.

    Args:
        joints: The joints of the arm.

    Returns:
        The gains: wanted impedance, damping of lost directions, and the posture of what does not move the tip.

    """
    along = list_impedance_gains(DIRECTIONS[:3], ("kg", "N s/m", "N/m"), (2.0, 45.0, 500.0))
    about = list_impedance_gains(DIRECTIONS[3:], ("kg m²", "N m s/rad", "N m/rad"), (0.1, 2.0, 20.0))
    meaning = "the same for turns of the tip; 100 for fewer than six joints"
    lost = ROTATION_DAMPING[len(joints) < TIP_DIRECTIONS]
    own = [
        Parameter("singularity", "1/kg", 1e-2, 1e-9, 1.0, "added to the tip's mobility along the axes"),
        Parameter("singularity_rotation", "1/(kg m²)", lost, 1e-9, 1e4, meaning),
        Parameter("posture_stiffness", "1/s²", 10.0, 0.0, 1e4, "pull to the posture of what does not move the tip"),
    ]
    for j, joint in enumerate(joints, 1):
        low, high = joint.limits.position or (0.0, 0.0)
        unit = "m" if joint.kind == "prismatic" else "rad"
        own.append(
            Parameter(f"posture_{j}", unit, (low + high) / 2, -1e3, 1e3, "posture; default the middle of its range")
        )
    return (*along, *about, *own)


def impedance_in_space(model: Model, c: Any) -> Law:
    """(25) in six directions: the tip's acceleration that M, B, K, F_e and m_e ask for, with Coriolis and gravity.

    Args:
        model: The model, of a chain in space.
        c: The symbols of its constants.

    Returns:
        The law.

    """
    loop = ControlLoop(model, "impedance_cartesian", list_space_gains(model.robot.joints), "cartesian", ())
    seen, memory = loop.estimate_arm()
    wanted = _read_reference(loop)
    M_q, bias, J, turn = loop.arm_terms(seen.q, seen.v)
    seen, memory = loop.observe_rigid_drives(seen, memory, M_q, bias, J.T @ seen.force)
    M, B, K = loop.mass_damping_stiffness(DIRECTIONS)
    twist = J @ seen.v
    E = model.chain.tip_rotation(seen.q) @ wanted.rotation.T
    e = find_rotation_vector(E)
    carried = E @ wanted.velocity[3:]
    x_e = ca.vertcat(model.chain.tip_position(seen.q, model.chain_parameters()) - wanted.position, e)
    v_e = ca.vertcat(twist[:3] - wanted.velocity[:3], invert_left_jacobian(e) @ (twist[3:] - carried))
    a_e = (_pull_on_displacement(e, seen.force) - B * v_e - K * x_e) / M
    follow = _invert_jacobian(loop, M_q, J)
    idle = -loop.g["posture_damping"] * seen.v - loop.g["posture_stiffness"] * (seen.q - _posture(loop))
    acceleration = follow @ (_carry_acceleration(wanted, E, e, v_e, a_e) - turn - J @ idle) + idle
    torque = M_q @ acceleration + bias - J.T @ seen.force
    return loop.make_law(c, loop.torque_loop(seen, torque, acceleration), memory, [])


def admittance_in_space(model: Model, c: Any) -> Law:
    """(26) in six directions: the tip follows the reference moved by x_e and e, the joints by the inverse of J.

    Args:
        model: The model, of a chain in space.
        c: The symbols of its constants.

    Returns:
        The law.

    """
    n, six = model.n, range(TIP_DIRECTIONS)
    names = (
        *(f"yield_{w}_{a}" for w in ("position", "velocity") for a in DIRECTIONS),
        *(f"posture_{w}_{j}" for w in ("position", "velocity") for j in model.joints),
    )
    loop = ControlLoop(model, "admittance_cartesian", list_space_gains(model.robot.joints), "cartesian", names)
    seen, memory = loop.estimate_arm()
    wanted, h = _read_reference(loop), loop.g["period"]
    M, B, K = loop.mass_damping_stiffness(DIRECTIONS)
    x_e, v_e = (loop.memory_part(f"yield_{w}_x", TIP_DIRECTIONS) for w in ("position", "velocity"))
    q, before = (loop.memory_part(f"posture_{w}_1", n) for w in ("position", "velocity"))
    e, rotation = x_e[3:], model.chain.tip_rotation
    E = make_rotation_matrix(e)
    force = _pull_on_displacement(e, seen.force)
    a_e = (force - B * v_e - K * x_e) / M
    M_q, _, J, _ = loop.arm_terms(q, SX.zeros(n))
    follow = _invert_jacobian(loop, M_q, J)
    moved = ca.vertcat(v_e[:3], find_left_jacobian(e) @ v_e[3:])
    velocity = moved + ca.vertcat(wanted.velocity[:3], E @ wanted.velocity[3:])
    away = wanted.position + x_e[:3] - model.chain.tip_position(q, model.chain_parameters())
    gap = ca.vertcat(away, find_rotation_vector(E @ wanted.rotation @ rotation(q).T)) / (4 * h)
    back = ca.vertcat(*(_limit_speed(gap[3 * i : 3 * i + 3], most) for i, most in enumerate(RETURN_SPEED)))
    k, d = loop.g["posture_stiffness"], loop.g["posture_damping"]
    idle = (before - h * k * (q - _posture(loop))) / (1 + h * d + h * h * k)  # implicit Euler
    v = follow @ (velocity + back - J @ idle) + idle
    slower = _scale_to_speed_limits(model, v)
    v = slower * v
    _, bias, _, turn = loop.arm_terms(q, v)
    idle = -d * v - k * (q - _posture(loop))
    a = follow @ (_carry_acceleration(wanted, E, e, v_e, a_e) - turn - J @ idle) + idle
    a = slower ** (SPEED_NORM + 1) * a  # as one joint's a where its v is slowed down
    T = loop.position_loop(seen, q, v, a, M_q @ a + bias - J.T @ seen.force)
    held = [held_force(M[i], B[i], K[i], h, x_e[i], v_e[i], force[i]) for i in six]
    later = [ca.vertcat(*(one[0] for one in held)), ca.vertcat(*(one[1] for one in held)), q + h * v, v]
    return loop.make_law(c, T, [*memory, *later], _begin_yielding(loop, wanted))


def _invert_jacobian(loop: ControlLoop, M_q: Any, J: Any) -> Any:
    """W⁻¹ Jᵀ Λ (n × 6): the damped inverse of J that asks least of links and rotors together."""
    drives = [loop.model.joint_parameters(j) for j in loop.model.joints]
    W = M_q + ca.diag(ca.vertcat(*(p["motor_inertia"] * p["ratio"] * p["ratio"] for p in drives)))
    return solve_symmetric(W, J.T) @ find_tip_inertia(loop, W, J)


def _scale_to_speed_limits(model: Model, v: Any) -> Any:
    """A factor that keeps the joints' speed limits, nearly 1 short of them: 1/‖(1, v/limits)‖ in a high norm."""
    limits = [joint.limits.speed for joint in model.robot.joints]
    shares = [(v[j] / limit) ** SPEED_NORM for j, limit in enumerate(limits) if limit]
    return (1 + sum(shares, SX(0))) ** (-1 / SPEED_NORM)


def _limit_speed(speed: Any, most: float) -> Any:
    """A velocity (3) that is kept where it is slow and never faster than ``most``."""
    return speed / ca.sqrt(1 + ca.dot(speed, speed) / most**2)


def _begin_yielding(loop: ControlLoop, wanted: WantedPose) -> list[Any]:
    """Memory of an admittance that yields as far as the arm is from its reference, so that it starts without a jump."""
    chain, n = loop.model.chain, loop.model.n
    q = loop.measured[n : 2 * n]
    e = find_rotation_vector(chain.tip_rotation(q) @ wanted.rotation.T)
    turning = -invert_left_jacobian(-e) @ wanted.velocity[3:]  # the tip at rest: D(e) ė + E ω_d = 0
    away = chain.tip_position(q, loop.model.chain_parameters()) - wanted.position
    return [away, e, -wanted.velocity[:3], turning, q, SX.zeros(n)]


def _read_reference(loop: ControlLoop) -> WantedPose:
    """The wanted pose, whose orientation comes as a rotation vector from the base frame."""
    pose, velocity, acceleration = loop.split_reference()
    return WantedPose(pose[:3], make_rotation_matrix(pose[3:]), velocity, acceleration)


def _posture(loop: ControlLoop) -> Any:
    """The wanted posture (n)."""
    return ca.vertcat(*(loop.g[f"posture_{j}"] for j in loop.model.joints))


def _pull_on_displacement(e: Any, wrench: Any) -> Any:
    """What a force and a moment on the tip are for its displacement (6): the force, and D(e)ᵀ m."""
    return ca.vertcat(wrench[:3], find_left_jacobian(e).T @ wrench[3:])


def _carry_acceleration(wanted: WantedPose, E: Any, e: Any, v_e: Any, a_e: Any) -> Any:
    """Acceleration of the tip (6) that moves with its reference and from it, ω = D(e) ė + E ω_d in its turn."""
    carried = E @ wanted.velocity[3:]
    turning = find_left_jacobian(e) @ v_e[3:]
    about = find_angular_acceleration(e, v_e[3:], a_e[3:]) + E @ wanted.acceleration[3:] + ca.cross(turning, carried)
    return ca.vertcat(wanted.acceleration[:3] + a_e[:3], about)
