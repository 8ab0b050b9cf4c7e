"""Kinematics, dynamics, energy and outputs of the arm as functions to emit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from gen.effects.effect import Port, Signals
from gen.model import harmonic_drive
from gen.model.arm_model import Model
from gen.model.carried_rotors import CarriedRotor
from gen.model.drive_equations import DriveOutputs, keep_friction_positive
from gen.model.emitted_function import EmittedFunction, make_dense_function
from gen.model.equations_of_motion import ArmMotion

SX = ca.SX


def emit_kinematics(model: Model, c: Any) -> list[EmittedFunction]:
    """Write the functions of positions and velocities alone, with the closed inverse where there is one.

    Args:
        model: The model.
        c: The symbols of its constants.

    Returns:
        The functions to emit.

    """
    chain, p = model.chain, model.chain_parameters()
    q, v = SX.sym("q", model.n), SX.sym("v", model.n)
    J = chain.tip_jacobian(q, p)
    slip = ca.jtimes(J @ v, q, v)
    out = [
        EmittedFunction(
            make_dense_function("points", {"q": q, "c": c}, {"points": chain.joint_origins(q, p).T}),
            "origins of the joints and the tip, m, (x, y) each",
        ),
        EmittedFunction(
            make_dense_function(
                "tip_jacobian", {"q": q, "v": v, "c": c}, {"J": J, "tip_velocity": J @ v, "Jdot_v": slip}
            ),
            "∂tip/∂q (2 × n, column by column), velocity of the tip, and dJ/dt q̇",
        ),
    ]
    if chain.in_space:
        pose = {"position": chain.tip_position(q, p), "rotation": chain.tip_rotation(q)}
        meaning = "position of the tip, m, and its rotation, column by column: components in the base frame"
        out.append(EmittedFunction(make_dense_function("tip_pose", {"q": q, "c": c}, pose), meaning))
    a = SX.sym("a", model.n)
    angle, rate = encoder_readings(model, q, v, a)
    out.append(
        EmittedFunction(
            make_dense_function(
                "encoders", {"q": q, "v": v, "a": a, "c": c}, {"joint_position": angle, "joint_velocity": rate}
            ),
            "what the joints' encoders read, rad, and how fast that changes",
        )
    )
    out.append(_emit_torsion(model, c))
    if chain.has_closed_inverse:
        point = SX.sym("point", 2)
        both = chain.inverse_branches(point, p)
        out.append(
            EmittedFunction(
                make_dense_function(
                    "inverse_kinematics", {"point": point, "c": c}, {"q_positive": both[:, 0], "q_negative": both[:, 1]}
                ),
                "joint angles that reach a point, for both signs of the elbow; NaN out of reach",
            )
        )
    return out


def _emit_torsion(model: Model, c: Any) -> EmittedFunction:
    """The torsion of the springs under a joint torque, 0 in rigid drives."""
    load = SX.sym("joint_torque", model.n)
    twist = [SX(0)] * model.n
    for j in model.flexible:
        twist[j - 1] = harmonic_drive.spring_torsion(
            load[j - 1], harmonic_drive.spring_constants(model.joint_parameters(j))
        )
    return EmittedFunction(
        make_dense_function("torsion", {"joint_torque": load, "c": c}, {"torsion": ca.vertcat(*twist)}),
        "torsion of the springs under a torque, rad",
    )


def emit_positions(model: Model, c: Any) -> EmittedFunction:
    """Write the readings of the encoders of motors and joints in state x, none of them read late.

    A log of positions needs no more of x, and this costs a small part of `outputs`.

    Args:
        model: The model.
        c: The symbols of its constants.

    Returns:
        The function to emit.

    """
    q, v, a = (SX.sym(name, model.n) for name in "qva")
    angle, _ = encoder_readings(model, q, v, a)
    still = ca.substitute(angle, ca.vertcat(q, v, a), ca.vertcat(model.q, SX.zeros(2 * model.n)))
    motors = []
    for j in model.joints:
        if j in model.rigid:
            motors.append(model.joint_parameters(j)["ratio"] * model.q[j - 1])
        else:
            motors.append(model.state_symbol(f"motor_position_{j}"))
    shown = {"motor_position": ca.vertcat(*motors), "joint_position": still}
    return EmittedFunction(
        make_dense_function("positions", {"x": model.x, "c": c}, shown),
        "what encoders show that are not read late, rad",
    )


def emit_dynamics(model: Model, c: Any) -> list[EmittedFunction]:
    """Write mass matrix, Coriolis matrix, gravity, inverse dynamics, energy and outputs.

    Args:
        model: The model.
        c: The symbols of its constants.

    Returns:
        The functions to emit.

    """
    chain, p = model.chain, model.chain_parameters()
    n, q, a = model.n, model.q, SX.sym("a", model.n)
    x, u = model.x, model.u
    qs, vs = SX.sym("q", n), SX.sym("v", n)
    drives = {j: model.drive_outputs(j, model.joint_parameters(j)) for j in model.joints}
    kinetic, potential = arm_energy(model, drives)
    xc, qvc = {"x": x, "c": c}, {"q": qs, "v": vs, "c": c}
    force = SX.sym("tip_force", model.wrench.numel())
    torque = chain.newton_euler(qs, vs, a, p, chain.gravity(p), ca.vertsplit(force))
    return [
        EmittedFunction(
            make_dense_function(
                "mass_matrix", {"q": qs, "c": c}, {"M": ca.substitute(model.total_mass_matrix(), q, qs)}
            ),
            "mass matrix of the links and the rotors of rigid drives (n × n)",
        ),
        EmittedFunction(
            make_dense_function("coriolis_matrix", qvc, {"C": chain.coriolis_matrix(qs, vs, p)}),
            "Christoffel matrix C with Ṁ − 2C skew (n × n)",
        ),
        EmittedFunction(
            make_dense_function("gravity_torque", {"q": qs, "c": c}, {"g": chain.gravity_torque(qs, p)}),
            "torque that holds the arm at rest, N m",
        ),
        EmittedFunction(
            make_dense_function(
                "inverse_dynamics",
                {"q": qs, "v": vs, "a": a, "tip_force": force, "c": c},
                {"joint_torque": torque, "motor_torque": _motor_torque(model, qs, vs, a, torque)},
            ),
            "joint torque, and motor torque with the gear taken as rigid, that give the acceleration a",
        ),
        EmittedFunction(
            make_dense_function("energy", xc, {"kinetic": kinetic, "potential": potential}),
            "kinetic and potential energy, J",
        ),
        EmittedFunction(
            make_dense_function("outputs", {"x": x, "u": u, "c": c}, sensor_outputs(model, drives)),
            "what a complete set of exact sensors reads",
        ),
    ]


def _sum_effects(model: Model, port: Port, j: int, signals: Signals) -> Any:
    """The sum of the effects without states at a port of joint j; effects with states stand where they began."""
    p = model.joint_parameters(j)
    return sum((e.equation(signals, p) for e in model.effects_at(port, j) if not e.states), SX(0))


def _motor_torque(model: Model, q: Any, v: Any, a: Any, joint_torque: Any) -> Any:
    """Torque at each motor when θ = N q: J_m N a + viscous + dry friction − other motor effects + τ/N (n)."""
    rotors = model.find_rotors(model.chain, model.chain.sines_and_cosines(q), ca.vertsplit(v))
    out = []
    for j in model.joints:
        p = model.joint_parameters(j)
        omega = p["ratio"] * v[j - 1]
        direction = ca.tanh(omega / p["friction_smoothing"])
        signals = Signals(
            current=SX(0),
            motor_position=p["ratio"] * q[j - 1],
            motor_velocity=omega,
            direction=direction,
            joint_torque=joint_torque[j - 1],
            joint_position=q[j - 1],
            joint_velocity=v[j - 1],
            ratio=p["ratio"],
        )
        level = _sum_effects(model, Port.FRICTION, j, signals)
        level = keep_friction_positive(level, model.effects_at(Port.FRICTION, j))
        other = _sum_effects(model, Port.MOTOR, j, replace(signals, friction_level=level))
        link = _sum_effects(model, Port.LINK, j, signals)
        own = p["motor_inertia"] * _rotor_acceleration(p["ratio"] * a[j - 1], rotors.get(j), a)
        out.append(own + level * direction - other + (joint_torque[j - 1] - link) / p["ratio"])
    torque = ca.vertcat(*out)
    for j, rotor in rotors.items():  # the rotor of a later joint pulls on the links that carry it
        p = model.joint_parameters(j)
        push = p["motor_inertia"] * _rotor_acceleration(p["ratio"] * a[j - 1], rotor, a)
        spin = p["motor_inertia"] * (p["ratio"] * v[j - 1] + rotor.find_turn(v))
        pulls = [rotor.row[k] * push + rotor.twist[k] * spin for k in range(model.n)]
        torque = torque + ca.vertcat(*(pull / model.joint_parameters(k)["ratio"] for k, pull in enumerate(pulls, 1)))
    return torque


def _rotor_acceleration(own: Any, rotor: CarriedRotor | None, accelerations: Any) -> Any:
    """The acceleration of a rotor about its axis: its own, and that which its link gives it."""
    if rotor is None:
        return own + 0
    return own + rotor.find_acceleration(accelerations)


def arm_energy(model: Model, drives: dict[int, DriveOutputs]) -> tuple[Any, Any]:
    """Write the energy of links, rotors, springs and of a base that turns.

    Args:
        model: The model.
        drives: The drive of each joint by its number.

    Returns:
        Kinetic and potential energy, J.

    """
    motion, p = ArmMotion(model), model.chain_parameters()
    kinetic = motion.v.T @ motion.mass_matrix() @ motion.v / 2
    potential = SX(0)
    for j in model.flexible:
        own, speed = model.joint_parameters(j), motion.rotor_speed(j)
        kinetic = kinetic + own["motor_inertia"] * speed * speed / 2
        potential = potential + own["stiffness_level"] * harmonic_drive.spring_energy(
            drives[j].spring_torque, harmonic_drive.spring_constants(own)
        )
    moments = motion.chain.mass_moments(motion.q, p)
    for link in range(motion.first, motion.chain.n):
        for axis, field in enumerate(motion.chain.gravity(p)):
            potential = potential - field * moments[link, axis]
    if motion.base is not None:
        moving, stored = motion.base.find_energy()
        kinetic, potential = kinetic + moving, potential + stored
    return kinetic, potential


def sensor_outputs(model: Model, drives: dict[int, DriveOutputs]) -> dict[str, Any]:
    """Write the readings of a complete set of exact sensors.

    Args:
        model: The model.
        drives: The drive of each joint by its number.

    Returns:
        The readings by name (n each; 2 at the tip).

    """
    out: dict[str, list[Any]] = {
        k: [] for k in ("motor_position", "motor_velocity", "torsion", "beyond_law", "joint_torque")
    }
    for j in model.joints:
        p, d = model.joint_parameters(j), drives[j]
        torque = d.transmitted_torque
        for e in model.effects_at(Port.TORQUE_SENSOR, j):
            torque = torque + e.equation(Signals(joint_torque=d.transmitted_torque), p)
        if j in model.rigid:
            q, v = model.state_symbol(f"joint_position_{j}"), model.state_symbol(f"joint_velocity_{j}")
            row = [p["ratio"] * q, p["ratio"] * v, SX(0), SX(0), torque]
        else:
            beyond = ca.fabs(d.effective_torsion) > harmonic_drive.spring_constants(p).law_torsion
            row = [
                model.state_symbol(f"motor_position_{j}"),
                model.state_symbol(f"motor_velocity_{j}"),
                d.torsion,
                beyond,
                torque,
            ]
        for name, value in zip(out, row, strict=True):
            out[name].append(value)
    chain, p = model.chain, model.chain_parameters()
    joined = {name: ca.vertcat(*values) for name, values in out.items()}
    tip = {"tip": chain.tip_position(model.q, p), "tip_velocity": chain.tip_jacobian(model.q, p) @ model.v}
    angle, rate = _encoder_outputs(model, drives)
    return {**joined, "joint_position": angle, "joint_velocity": rate, "joint_angle": model.q, **tip}


def _encoder_outputs(model: Model, drives: dict[int, DriveOutputs]) -> tuple[Any, Any]:
    """The readings of the joints' encoders in state x (n), and their rates (n)."""
    a = SX.sym("a", model.n)
    angle, rate = encoder_readings(model, model.q, model.v, a)
    if not ca.depends_on(ca.vertcat(angle, rate), a):
        return angle, rate
    rate_of_x, _ = ArmMotion(model).equations_of_motion(drives)
    first = [s.name for s in model.x_slots].index("joint_velocity_1")
    angle, rate = ca.substitute([angle, rate], [a], [rate_of_x[first : first + model.n]])
    return angle, rate


def encoder_readings(model: Model, q: Any, v: Any, a: Any) -> tuple[Any, Any]:
    """Write the readings of the joints' encoders, and their rates without the part of the jerk.

    Args:
        model: The model.
        q: Joint positions (n), rad or m.
        v: Joint velocities (n).
        a: Joint accelerations (n).

    Returns:
        The readings (n), rad or m, and their rates (n).

    """
    angles, rates = [], []
    for j in model.joints:
        p, (at, speed, change) = model.joint_parameters(j), (w[j - 1] for w in (q, v, a))
        signals = Signals(joint_position=at, joint_velocity=speed, joint_acceleration=change, ratio=p["ratio"])
        error = sum((SX(e.equation(signals, p)) for e in model.effects_at(Port.SENSOR, j)), SX(0))
        angles.append(at + error)
        rates.append(speed + ca.jacobian(error, at) * speed + ca.jacobian(error, speed) * change)
    return ca.vertcat(*angles), ca.vertcat(*rates)
