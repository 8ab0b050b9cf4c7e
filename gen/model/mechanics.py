"""Kinematics, dynamics, energy and outputs of the arm as functions to emit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from gen.effects.effect import Port, Signals
from gen.model import harmonic_drive
from gen.model.arm_model import Model
from gen.model.drive_equations import Drives, never_driving
from gen.model.emitted_function import Emitted, dense

SX = ca.SX


def kinematics(model: Model, c: Any) -> list[Emitted]:
    """Write the functions of positions and velocities alone, with the closed inverse where there is one.

    Args:
        model: The model.
        c: The symbols of its constants.

    Returns:
        The functions to emit.

    """
    chain, p = model.chain, model.chain_parameters()
    q, v = SX.sym("q", model.n), SX.sym("v", model.n)
    J = chain.jacobian(q, p)
    slip = ca.jtimes(J @ v, q, v)
    out = [
        Emitted(
            dense("points", {"q": q, "c": c}, {"points": chain.points(q, p).T}),
            "origins of the joints and the tip, m, (x, y) each",
        ),
        Emitted(
            dense("tip_jacobian", {"q": q, "v": v, "c": c}, {"J": J, "tip_velocity": J @ v, "Jdot_v": slip}),
            "∂tip/∂q (2 × n, column by column), velocity of the tip, and dJ/dt q̇",
        ),
    ]
    a = SX.sym("a", model.n)
    angle, rate = readings(model, q, v, a)
    out.append(
        Emitted(
            dense("encoders", {"q": q, "v": v, "a": a, "c": c}, {"joint_position": angle, "joint_velocity": rate}),
            "what the joints' encoders read, rad, and how fast that changes",
        )
    )
    load = SX.sym("joint_torque", model.n)
    twist = [SX(0)] * model.n
    for j in model.flexible:
        twist[j - 1] = harmonic_drive.torsion(load[j - 1], harmonic_drive.springs(model.of_joint(j)))
    out.append(
        Emitted(
            dense("torsion", {"joint_torque": load, "c": c}, {"torsion": ca.vertcat(*twist)}),
            "torsion of the springs under a torque, rad",
        )
    )
    if chain.kinds == ("revolute", "revolute"):
        point = SX.sym("point", 2)
        both = chain.branches(point, p)
        out.append(
            Emitted(
                dense(
                    "inverse_kinematics", {"point": point, "c": c}, {"q_positive": both[:, 0], "q_negative": both[:, 1]}
                ),
                "joint angles that reach a point, for both signs of the elbow; NaN out of reach",
            )
        )
    return out


def positions(model: Model, c: Any) -> Emitted:
    """Write the readings of the encoders of motors and joints in state x, none of them read late.

    A log of positions needs no more of x, and this costs a small part of `outputs`.

    Args:
        model: The model.
        c: The symbols of its constants.

    Returns:
        The function to emit.

    """
    q, v, a = (SX.sym(name, model.n) for name in "qva")
    angle, _ = readings(model, q, v, a)
    still = ca.substitute(angle, ca.vertcat(q, v, a), ca.vertcat(model.q, SX.zeros(2 * model.n)))
    motors = []
    for j in model.joints:
        if j in model.rigid:
            motors.append(model.of_joint(j)["ratio"] * model.q[j - 1])
        else:
            motors.append(model.slot(f"motor_position_{j}"))
    shown = {"motor_position": ca.vertcat(*motors), "joint_position": still}
    return Emitted(dense("positions", {"x": model.x, "c": c}, shown), "what encoders show that are not read late, rad")


def dynamics(model: Model, c: Any) -> list[Emitted]:
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
    drives = {j: model.drive(j, model.of_joint(j)) for j in model.joints}
    kinetic, potential = _energy(model, drives)
    xc, qvc = {"x": x, "c": c}, {"q": qs, "v": vs, "c": c}
    force = SX.sym("tip_force", 2)
    torque = chain.recursion(qs, vs, a, p, (p["gravity_x"], p["gravity_y"]), (force[0], force[1]))
    return [
        Emitted(
            dense("mass_matrix", {"q": qs, "c": c}, {"M": ca.substitute(model.inertia(), q, qs)}),
            "mass matrix of the links and the rotors of rigid drives (n × n)",
        ),
        Emitted(
            dense("coriolis_matrix", qvc, {"C": chain.coriolis_matrix(qs, vs, p)}),
            "Christoffel matrix C with Ṁ − 2C skew (n × n)",
        ),
        Emitted(
            dense("gravity_torque", {"q": qs, "c": c}, {"g": chain.gravity(qs, p)}),
            "torque that holds the arm at rest, N m",
        ),
        Emitted(
            dense(
                "inverse_dynamics",
                {"q": qs, "v": vs, "a": a, "tip_force": force, "c": c},
                {"joint_torque": torque, "motor_torque": _motor_torque(model, qs, vs, a, torque)},
            ),
            "joint torque, and motor torque with the gear taken as rigid, that give the acceleration a",
        ),
        Emitted(dense("energy", xc, {"kinetic": kinetic, "potential": potential}), "kinetic and potential energy, J"),
        Emitted(
            dense("outputs", {"x": x, "u": u, "c": c}, sensed(model, drives)),
            "what a complete set of exact sensors reads",
        ),
    ]


def _total(model: Model, port: Port, j: int, signals: Signals) -> Any:
    """The sum of the effects without states at a port of joint j; effects with states stand where they began."""
    p = model.of_joint(j)
    return sum((e.equation(signals, p) for e in model.at(port, j) if not e.states), SX(0))


def _motor_torque(model: Model, q: Any, v: Any, a: Any, joint_torque: Any) -> Any:
    """Torque at each motor when θ = N q: J_m N a + viscous + dry friction − other motor effects + τ/N (n)."""
    out = []
    for j in model.joints:
        p = model.of_joint(j)
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
        level = _total(model, Port.FRICTION, j, signals)
        level = never_driving(level, model.at(Port.FRICTION, j))
        other = _total(model, Port.MOTOR, j, replace(signals, friction_level=level))
        link = _total(model, Port.LINK, j, signals)
        own = p["motor_inertia"] * (p["ratio"] * a[j - 1] + model.carried_motion(j, p, a))
        out.append(own + level * direction - other + (joint_torque[j - 1] - link) / p["ratio"])
    torque = ca.vertcat(*out)
    for j in model.joints:  # the rotor of a later joint pulls on the links that carry it
        p = model.of_joint(j)
        reaction = model.reaction(j, p)
        if reaction is not None:
            push = p["motor_inertia"] * (p["ratio"] * a[j - 1] + model.carried_motion(j, p, a))
            torque = torque + ca.vertcat(*(reaction[k - 1] * push / model.of_joint(k)["ratio"] for k in model.joints))
    return torque


def _energy(model: Model, drives: dict[int, Drives]) -> tuple[Any, Any]:
    q, v, p = model.q, model.v, model.chain_parameters()
    kinetic = v.T @ model.inertia() @ v / 2
    potential = SX(0)
    for j in model.flexible:
        own = model.of_joint(j)
        speed = model.slot(f"motor_velocity_{j}") + model.carried_motion(j, own, v)
        kinetic = kinetic + own["motor_inertia"] * speed * speed / 2
        potential = potential + own["stiffness_level"] * harmonic_drive.energy(
            drives[j].spring_torque, harmonic_drive.springs(own)
        )
    points = model.chain.points(q, p)
    bodies = model.chain.bodies(p)
    absolute = SX(0)
    for j in model.joints:
        if model.robot.joints[j - 1].kind == "revolute":
            absolute = absolute + q[j - 1]
        com = [
            bodies[j - 1].mass * points[j - 1, k] + bodies[j - 1].moment * f(absolute)
            for k, f in ((0, ca.cos), (1, ca.sin))
        ]
        potential = potential - p["gravity_x"] * com[0] - p["gravity_y"] * com[1]
    return kinetic, potential


def sensed(model: Model, drives: dict[int, Drives]) -> dict[str, Any]:
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
        p, d = model.of_joint(j), drives[j]
        torque = d.transmitted
        for e in model.at(Port.TORQUE_SENSOR, j):
            torque = torque + e.equation(Signals(joint_torque=d.transmitted), p)
        if j in model.rigid:
            q, v = model.slot(f"joint_position_{j}"), model.slot(f"joint_velocity_{j}")
            row = [p["ratio"] * q, p["ratio"] * v, SX(0), SX(0), torque]
        else:
            beyond = ca.fabs(d.wound) > harmonic_drive.springs(p).law_torsion
            row = [model.slot(f"motor_position_{j}"), model.slot(f"motor_velocity_{j}"), d.torsion, beyond, torque]
        for name, value in zip(out, row, strict=True):
            out[name].append(value)
    chain, p = model.chain, model.chain_parameters()
    joined = {name: ca.vertcat(*values) for name, values in out.items()}
    tip = {"tip": chain.tip(model.q, p), "tip_velocity": chain.jacobian(model.q, p) @ model.v}
    angle, rate = _encoders(model, drives)
    return {**joined, "joint_position": angle, "joint_velocity": rate, "joint_angle": model.q, **tip}


def _encoders(model: Model, drives: dict[int, Drives]) -> tuple[Any, Any]:
    """The readings of the joints' encoders in state x (n), and their rates (n)."""
    a = SX.sym("a", model.n)
    angle, rate = readings(model, model.q, model.v, a)
    if not ca.depends_on(ca.vertcat(angle, rate), a):
        return angle, rate
    rate_of_x, _ = model.motion(drives)
    first = [s.name for s in model.x_slots].index("joint_velocity_1")
    angle, rate = ca.substitute([angle, rate], [a], [rate_of_x[first : first + model.n]])
    return angle, rate


def readings(model: Model, q: Any, v: Any, a: Any) -> tuple[Any, Any]:
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
        p, (at, speed, change) = model.of_joint(j), (w[j - 1] for w in (q, v, a))
        signals = Signals(joint_position=at, joint_velocity=speed, joint_acceleration=change, ratio=p["ratio"])
        error = sum((SX(e.equation(signals, p)) for e in model.at(Port.SENSOR, j)), SX(0))
        angles.append(at + error)
        rates.append(speed + ca.jacobian(error, at) * speed + ca.jacobian(error, speed) * change)
    return ca.vertcat(*angles), ca.vertcat(*rates)
