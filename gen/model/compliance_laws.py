"""Compliance laws, each as one tick: impedance (25) and admittance (26) at the tip and at the joints, and positions.

Legend: x tip position, x_d desired, x_e = x − x_d; M, B, K the wanted mass, damping, stiffness; F_e force of the
world on the tip; Λ = (J M_q⁻¹ Jᵀ)⁻¹ the tip's inertia (the paper's m); q joint, θ motor angle; φ torsion; τ joint
torque; T motor torque; r the disturbance observer's estimate of all that pushes the rotor besides T and τ/N, above all
dry friction; h period.

The outer laws ask for a joint acceleration. The inner loops give it to a flexible, sticking drive:

- torque: T = τ̂/N + J_m N (q̈ + 2 λ (φ̇_d − φ̇) + λ² (φ_d − φ)) − r, φ_d the torsion under the wanted τ: the torque
  loop closed on the estimate from torsion; reflected rotors are compensated by J_m N q̈;
- position: T = τ/N + J_m (N q̈ + 2 λ (N q̇ − ω) + λ² (θ_d − θ)) − r, θ_d = N (q + φ_d).

A rigid drive has no torsion to read: T = τ/N + J_m N q̈ + viscous and dry friction of the model, at the wanted speed
in the position loop and at the measured speed in the torque loop, which therefore does not break a standing rigid
joint loose: there an impedance law keeps a dead band, an admittance law does not.
Sources: paper (20)–(26) corrected; Khatib, IEEE J. Robot. Autom. 3 (1987) 43 for Λ; Albu-Schäffer, Ott, Hirzinger,
Int. J. Robot. Res. 26 (2007) 23 for the torque loop; Le Tien et al., IROS 2008 for friction as an observed disturbance.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen.effects.effect import Parameter
from gen.model import harmonic_drive, torque_estimate
from gen.model.arm_model import Model, solve_symmetric
from gen.model.emitted_function import EmittedFunction, make_dense_function

SX = ca.SX
SQUARINGS, TAYLOR = 50, 6  # of `held_force`: h B/M up to 1e14, the most that the gains' bounds allow, becomes 0.1

COMMON_GAINS = (
    Parameter("period", "s", 1e-3, 1e-5, 0.1, "time from tick to tick"),
    Parameter("velocity_cutoff", "Hz", 80.0, 1.0, 1e4, "cut-off of the filtered differences of both encoders"),
    Parameter("bandwidth", "rad/s", 50.0, 1.0, 1e4, "of the inner loop, critically damped"),
    Parameter("observer_bandwidth", "rad/s", 100.0, 0.0, 1e4, "of the disturbance observer; 0 leaves it out"),
    Parameter(
        "singularity", "1/kg", 1e-3, 1e-9, 1.0, "added to the tip's mobility, so that singular poses stay finite"
    ),
    Parameter("posture_damping", "1/s", 5.0, 0.0, 1e3, "damping of motion that does not move the tip"),
)


@dataclass(frozen=True)
class Law:
    """A controller: gains, reference and memory by name, and its two functions."""

    name: str
    gains: tuple[Parameter, ...]
    reference: tuple[str, ...]
    state: tuple[str, ...]
    start_function: EmittedFunction
    tick_function: EmittedFunction


@dataclass(frozen=True)
class ArmEstimate:
    """The arm as a tick knows it; torsions and the torques estimated from them are None for rigid drives."""

    theta: Any  # motor angles, rad
    q: Any  # joint positions, rad or m
    omega: Any  # filtered motor speeds, rad/s
    v: Any  # filtered joint velocities
    phi: list[Any]  # torsions, rad
    phi_rate: list[Any]  # rad/s
    torque: list[Any]  # joint torques from the torsions, N m
    force: Any  # of the world on the tip, N
    disturbance: list[Any]  # disturbances at the rotors, N m at the motor


class ControlLoop:
    """Symbols of one law, and the inner loops that all laws share."""

    def __init__(
        self, model: Model, name: str, own: tuple[Parameter, ...], space: str, memory: tuple[str, ...]
    ) -> None:
        self.model, self.name, n = model, name, model.n
        self.gains = (*COMMON_GAINS, *own)
        self.g = {
            gain.name: symbol
            for gain, symbol in zip(self.gains, ca.vertsplit(SX.sym("gains", len(self.gains))), strict=True)
        }
        noun, axes = "joint", tuple(str(j) for j in model.joints)
        if space == "cartesian":
            noun, axes = "tip", ("x", "y")
        self.reference_names = tuple(
            f"{noun}_{what}_{axis}" for what in ("position", "velocity", "acceleration") for axis in axes
        )
        self.reference = SX.sym("reference", len(self.reference_names))
        filters = ("last_motor_position", "last_joint_position", "motor_velocity", "joint_velocity", "observed")
        self.state_names = tuple(f"{f}_{j}" for f in filters for j in model.joints) + memory
        self.state = SX.sym("state", len(self.state_names))
        self.measured = SX.sym("measured", 2 * n + 2)  # θ, q, tip force
        self.sent = SX.sym("sent", n)

    def split_reference(self) -> tuple[Any, Any, Any]:
        """Position, velocity and acceleration of the reference."""
        position, velocity, acceleration = ca.vertsplit(self.reference, self.reference.numel() // 3)
        return position, velocity, acceleration

    def mass_damping_stiffness(self, axes: Iterable[str]) -> tuple[Any, Any, Any]:
        """The wanted M, B and K along the axes, as vectors."""
        g, axes = self.g, tuple(axes)
        mass = ca.vertcat(*(g[f"mass_{axis}"] for axis in axes))
        damping = ca.vertcat(*(g[f"damping_{axis}"] for axis in axes))
        return mass, damping, ca.vertcat(*(g[f"stiffness_{axis}"] for axis in axes))

    def memory_part(self, name: str, count: int) -> Any:
        """The part of the memory that begins at ``name``."""
        first = self.state_names.index(name)
        return self.state[first : first + count]

    def estimate_arm(self) -> tuple[ArmEstimate, list[Any]]:
        """Estimate the arm at this tick; the second result is the next memory of the estimates."""
        model, n, g = self.model, self.model.n, self.g
        theta, q, force = self.measured[:n], self.measured[n : 2 * n], self.measured[2 * n :]
        last_theta, last_q, omega, v, observed = (self.state[k * n : (k + 1) * n] for k in range(5))
        a = 1 - ca.exp(-2 * ca.pi * g["velocity_cutoff"] * g["period"])
        omega = omega + a * ((theta - last_theta) / g["period"] - omega)
        v = v + a * ((q - last_q) / g["period"] - v)
        phi: list[Any] = []
        rate: list[Any] = []
        torque: list[Any] = []
        r: list[Any] = []
        next_observed: list[Any] = []
        for j in model.joints:
            p = model.joint_parameters(j)
            if j in model.rigid:
                phi, rate, torque, r = [*phi, None], [*rate, None], [*torque, None], [*r, SX(0)]
                next_observed.append(SX(0))
                continue
            twist = torque_estimate.measured_torsion(model, j, theta[j - 1], q[j - 1])
            phi.append(twist)
            rate.append(omega[j - 1] / p["ratio"] - v[j - 1])
            torque.append(torque_estimate.torque_from_torsion(model, j, twist) + p["torsional_damping"] * rate[-1])
            # the momentum p = J ω obeys ṗ = T − τ/N + r; the observer integrates the right-hand side, and
            # r = L (p − its integral)
            momentum = p["motor_inertia"] * omega[j - 1]
            integral = observed[j - 1] + g["period"] * (self.sent[j - 1] - torque[-1] / p["ratio"])
            decay = ca.exp(-g["observer_bandwidth"] * g["period"])
            next_observed.append(decay * integral + (1 - decay) * momentum)
            r.append(g["observer_bandwidth"] * (momentum - next_observed[-1]))
        seen = ArmEstimate(theta, q, omega, v, phi, rate, torque, force, r)
        return seen, [theta, q, omega, v, ca.vertcat(*next_observed)]

    def torque_loop(self, seen: ArmEstimate, torque: Any, acceleration: Any) -> Any:
        """Motor torques that make the joint torque follow ``torque`` (n)."""
        out = []
        for j in self.model.joints:
            p, k = self.model.joint_parameters(j), j - 1
            if j in self.model.rigid:
                out.append(self._rigid_drive_torque(j, seen.v[k], acceleration[k], torque[k]))
                continue
            twist = harmonic_drive.spring_torsion(torque[k] / p["stiffness_level"], harmonic_drive.spring_constants(p))
            gain = self.g["bandwidth"]
            push = acceleration[k] - 2 * gain * seen.phi_rate[k] + gain**2 * (twist - seen.phi[k])
            out.append(seen.torque[k] / p["ratio"] + p["motor_inertia"] * p["ratio"] * push - seen.disturbance[k])
        return ca.vertcat(*out)

    def position_loop(self, seen: ArmEstimate, q: Any, v: Any, a: Any, torque: Any) -> Any:
        """Motor torques that make the joints follow q, v, a (n each), for which they need ``torque``."""
        gain = self.g["bandwidth"]
        out = []
        for j in self.model.joints:
            p, k = self.model.joint_parameters(j), j - 1
            if j in self.model.rigid:
                back = 2 * gain * (v[k] - seen.v[k]) + gain**2 * (q[k] - seen.q[k])
                full = self.model.total_mass_matrix()[k, k] / p["ratio"]
                full = ca.substitute(full, ca.vertcat(self.model.q, self.model.v), ca.vertcat(seen.q, seen.v))
                out.append(self._rigid_drive_torque(j, v[k], a[k], torque[k]) + full * back)
                continue
            theta = p["ratio"] * (
                q[k]
                + harmonic_drive.spring_torsion(torque[k] / p["stiffness_level"], harmonic_drive.spring_constants(p))
            )
            back = 2 * gain * (p["ratio"] * v[k] - seen.omega[k]) + gain**2 * (theta - seen.theta[k])
            out.append(torque[k] / p["ratio"] + p["motor_inertia"] * (p["ratio"] * a[k] + back) - seen.disturbance[k])
        return ca.vertcat(*out)

    def _rigid_drive_torque(self, j: int, v: Any, a: Any, torque: Any) -> Any:
        p = self.model.joint_parameters(j)
        omega = p["ratio"] * v
        friction = p["viscous_friction"] * omega + p["coulomb_friction"] * ca.tanh(omega / p["friction_smoothing"])
        return torque / p["ratio"] + p["motor_inertia"] * p["ratio"] * a + friction

    def arm_terms(self, q: Any, v: Any) -> tuple[Any, Any, Any, Any]:
        """Mass matrix of the links, C v + g, J, and dJ/dt v, at q and v."""
        chain, p = self.model.chain, self.model.chain_parameters()
        qs, vs = SX.sym("q", self.model.n), SX.sym("v", self.model.n)
        J = chain.tip_jacobian(qs, p)
        parts = [chain.mass_matrix(qs, p), chain.bias_torque(qs, vs, p), J, ca.jtimes(J @ vs, qs, vs)]
        mass, bias, jacobian, turn = ca.substitute(parts, [qs, vs], [q, v])
        return mass, bias, jacobian, turn

    def make_law(self, c: Any, torque: Any, memory: list[Any], started: list[Any]) -> Law:
        """The law's two functions from what its tick computes."""
        g = ca.vertcat(*self.g.values())
        n = self.model.n
        zero = SX.zeros(n)
        first = ca.vertcat(self.measured[:n], self.measured[n : 2 * n], zero, zero, zero, *started)
        ins = {
            "measured": self.measured,
            "sent": self.sent,
            "reference": self.reference,
            "gains": g,
            "c": c,
            "state": self.state,
        }
        tick = make_dense_function(f"{self.name}_tick", ins, {"torque": torque, "next": ca.vertcat(*memory)})
        begin = {"measured": self.measured, "reference": self.reference, "c": c}
        start = make_dense_function(f"{self.name}_start", begin, {"state": first})
        return Law(
            self.name,
            self.gains,
            self.reference_names,
            self.state_names,
            EmittedFunction(start, "memory of the controller at its first tick"),
            EmittedFunction(tick, "one tick: motor torques, N m, and the next memory"),
        )


def tip_inertia(loop: ControlLoop, M_q: Any, J: Any) -> Any:
    """Λ (2 × 2): inverse of the tip's mobility, kept finite in singular poses."""
    columns = [solve_symmetric(M_q, J.T[:, k]) for k in range(2)]
    A = J @ ca.horzcat(*columns) + loop.g["singularity"] * SX.eye(2)
    return ca.horzcat(*(solve_symmetric(A, SX.eye(2)[:, k]) for k in range(2)))


def held_force(M: Any, B: Any, K: Any, h: Any, x: Any, v: Any, F: Any) -> tuple[Any, Any]:
    """Move M ẍ + B ẋ + K x = F on by one period with F held: (26) discretised exactly.

    exp(A h) is found by scaling and squaring, but as Y = exp − 1: Y ← 2 Y + Y² keeps every digit of entries that are
    small against 1, however many squarings follow. So one number of squarings serves the whole range of the gains.

    Args:
        M: Mass, kg or kg m².
        B: Damping, N s/m or N m s/rad.
        K: Stiffness, N/m or N m/rad.
        h: Period, s.
        x: Position, m or rad.
        v: Velocity.
        F: Force or torque.

    Returns:
        Position and velocity after the period.

    Source:
        Van Loan, IEEE Trans. Autom. Control 23 (1978) 395; Moler, Van Loan, SIAM Review 45 (2003) 3, method 3.

    """
    A = SX(3, 3)
    A[0, 1], A[1, 0], A[1, 1], A[1, 2] = h, -h * K / M, -h * B / M, h / M
    scaled = A / 2.0**SQUARINGS
    Y = scaled
    for k in range(TAYLOR, 1, -1):
        Y = scaled + scaled @ Y / k
    for _ in range(SQUARINGS):
        Y = 2 * Y + Y @ Y
    return x + Y[0, 0] * x + Y[0, 1] * v + Y[0, 2] * F, v + Y[1, 0] * x + Y[1, 1] * v + Y[1, 2] * F


def _mass_damping_stiffness(
    axes: tuple[str, ...], units: tuple[str, str, str], nominal: tuple[float, float, float]
) -> tuple[Parameter, ...]:
    """Gains for the wanted mass, damping and stiffness along each axis."""
    kinds = (
        ("mass", "wanted inertia", 1e-9),
        ("damping", "wanted damping", 0.0),
        ("stiffness", "wanted stiffness", 0.0),
    )
    return tuple(
        Parameter(f"{name}_{axis}", unit, value, low, 1e6, meaning)
        for (name, meaning, low), unit, value in zip(kinds, units, nominal, strict=True)
        for axis in axes
    )


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
        _mass_damping_stiffness(("x", "y"), ("kg", "N s/m", "N/m"), (2.0, 45.0, 500.0)),
        "cartesian",
        (),
    )
    seen, memory = loop.estimate_arm()
    x_d, v_d, a_d = loop.split_reference()
    M_q, bias, J, turn = loop.arm_terms(seen.q, seen.v)
    M, B, K = loop.mass_damping_stiffness("xy")
    x_e = loop.model.chain.tip_position(seen.q, model.chain_parameters()) - x_d
    v_e = J @ seen.v - v_d
    L = tip_inertia(loop, M_q, J)
    F = L @ (a_d - turn + (seen.force - B * v_e - K * x_e) / M) - seen.force
    push = J.T @ F
    idle = -loop.g["posture_damping"] * (M_q @ seen.v)  # without the part that the tip feels
    push = push + idle - J.T @ (L @ (J @ _solve_columns(M_q, idle)))
    acceleration = _solve_columns(M_q, push + J.T @ seen.force)
    return loop.make_law(c, loop.torque_loop(seen, push + bias, acceleration), memory, [])


def impedance_joint(model: Model, c: Any) -> Law:
    """(23): M q̈_e + B q̇_e + K q_e = Jᵀ F_e at each joint."""
    axes = tuple(str(j) for j in model.joints)
    loop = ControlLoop(
        model,
        "impedance_joint",
        _mass_damping_stiffness(axes, ("kg m²", "N m s/rad", "N m/rad"), (0.2, 3.0, 30.0)),
        "joint",
        (),
    )
    seen, memory = loop.estimate_arm()
    q_d, v_d, a_d = loop.split_reference()
    M_q, bias, J, _ = loop.arm_terms(seen.q, seen.v)
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
        _mass_damping_stiffness(("x", "y"), ("kg", "N s/m", "N/m"), (2.0, 45.0, 500.0)),
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
    weighted = _solve_columns(M_q, J.T) @ tip_inertia(loop, M_q, J)  # the inverse of J that asks least of the motors
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
        _mass_damping_stiffness(axes, ("kg m²", "N m s/rad", "N m/rad"), (0.2, 3.0, 30.0)),
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


def _solve_columns(M: Any, b: Any) -> Any:
    return ca.horzcat(*(solve_symmetric(M, b[:, k]) for k in range(b.shape[1])))


LAW_BUILDERS = (position_law, impedance_cartesian, impedance_joint, admittance_cartesian, admittance_joint)


def make_laws(model: Model, c: Any) -> tuple[Law, ...]:
    """Write every controller of the arm.

    Args:
        model: The model.
        c: The symbols of its constants.

    Returns:
        The controllers, in the order of `LAW_BUILDERS`.

    """
    return tuple(law(model, c) for law in LAW_BUILDERS)
