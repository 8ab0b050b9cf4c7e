"""The control loop of a law: estimates of the arm at a tick, and the inner loops that all laws share.

The inner loops give a wanted joint acceleration to a flexible, sticking drive:

- torque: T = τ̂/N + J_m N (q̈ + 2 λ (φ̇_d − φ̇) + λ² (φ_d − φ)) − r, φ_d the torsion under the wanted τ: the torque
  loop closed on the estimate from torsion; reflected rotors are compensated by J_m N q̈;
- position: T = τ/N + J_m (N q̈ + 2 λ (N q̇ − ω) + λ² (θ_d − θ)) − r, θ_d = N (q + φ_d).

A rigid drive has no torsion to read: T = τ/N + J_m N q̈ + viscous friction of the model + dry friction. The position
loop takes dry friction from the model, at the wanted speed. The torque loop observes it in the motion of the joints:
r is the filtered rest of M q̈ + C v + g − Jᵀ F_e − N T; without the observer it is the model's at the measured speed,
and a standing joint is not broken loose.

Legend: q joint, θ motor angle; φ torsion; τ joint torque; T motor torque; r the disturbance observer's estimate of all
that pushes the rotor besides T and τ/N, above all dry friction.

Source: Albu-Schäffer, Ott, Hirzinger, Int. J. Robot. Res. 26 (2007) 23 for the torque loop; Le Tien et al., IROS 2008
for friction as an observed disturbance.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca

from gen.effects.effect import Parameter
from gen.model import harmonic_drive, torque_estimate
from gen.model.arm_model import Model
from gen.model.emitted_function import EmittedFunction, make_dense_function

SX = ca.SX

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
    force: Any  # of the world on the tip, N, in space with its moment, N m
    disturbance: list[Any]  # disturbances at the rotors, N m at the motor


def _name_reference(model: Model, space: str) -> tuple[str, ...]:
    """Position, velocity and acceleration of the joints or the tip; in space the tip's turn stands after each."""
    motions: tuple[str, ...] = ("joint_position", "joint_velocity", "joint_acceleration")
    axes = tuple(str(j) for j in model.joints)
    if space == "cartesian":
        motions, axes = ("tip_position", "tip_velocity", "tip_acceleration"), model.chain.axes
        if model.chain.in_space:
            turns = ("tip_rotation", "tip_angular_velocity", "tip_angular_acceleration")
            motions = tuple(name for pair in zip(motions, turns, strict=True) for name in pair)
    return tuple(f"{motion}_{axis}" for motion in motions for axis in axes)


@lru_cache(maxsize=1)
def _write_arm_terms(model: Model) -> tuple[list[Any], list[Any]]:
    """The symbols q and v, and with them mass matrix of the links, C v + g, J, and dJ/dt v: once for all laws."""
    chain, p = model.chain, model.chain_parameters()
    q, v = SX.sym("q", model.n), SX.sym("v", model.n)
    J = chain.tip_jacobian(q, p)
    return [q, v], [chain.mass_matrix(q, p), chain.bias_torque(q, v, p), J, ca.jtimes(J @ v, q, v)]


@lru_cache(maxsize=1)
def _write_mass_matrix(model: Model) -> Any:
    """The mass matrix with the rotors of rigid drives, over the model's own q: once for all laws."""
    return model.total_mass_matrix()


class ControlLoop:
    """Symbols of one law, and the inner loops that all laws share."""

    def __init__(
        self, model: Model, name: str, own: tuple[Parameter, ...], space: str, memory: tuple[str, ...]
    ) -> None:
        self.model, self.name, n = model, name, model.n
        named = {gain.name for gain in own}
        self.gains = (*(gain for gain in COMMON_GAINS if gain.name not in named), *own)
        self.g = {
            gain.name: symbol
            for gain, symbol in zip(self.gains, ca.vertsplit(SX.sym("gains", len(self.gains))), strict=True)
        }
        self.reference_names = _name_reference(model, space)
        self.reference = SX.sym("reference", len(self.reference_names))
        filters = ("last_motor_position", "last_joint_position", "motor_velocity", "joint_velocity", "observed")
        self.state_names = tuple(f"{f}_{j}" for f in filters for j in model.joints) + memory
        self.state = SX.sym("state", len(self.state_names))
        self.measured = SX.sym("measured", 2 * n + model.wrench.numel())  # θ, q, tip force
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

    def observe_rigid_drives(
        self, seen: ArmEstimate, memory: list[Any], M_q: Any, bias: Any, outside: Any
    ) -> tuple[ArmEstimate, list[Any]]:
        """Observe the disturbances of rigid drives in the motion of the joints.

        Args:
            seen: The arm at this tick.
            memory: The next memory of the estimates.
            M_q: Mass matrix of the links (n × n).
            bias: C v + g (n).
            outside: Joint torques of the force at the tip (n).

        Returns:
            Both with the disturbances; nothing is observed before a first torque was sent.

        """
        n, g = self.model.n, self.g
        change = (seen.v - self.state[3 * n : 4 * n]) / g["period"]
        load = M_q @ change + bias - outside
        decay = ca.if_else(ca.dot(self.sent, self.sent) > 0, ca.exp(-g["observer_bandwidth"] * g["period"]), 1)
        r, kept = list(seen.disturbance), ca.vertsplit(memory[-1])
        for j in self.model.rigid:
            p, k = self.model.joint_parameters(j), j - 1
            turning = p["motor_inertia"] * p["ratio"] * change[k] + p["viscous_friction"] * p["ratio"] * seen.v[k]
            rest = load[k] / p["ratio"] + turning - self.sent[k]
            r[k] = kept[k] = decay * self.state[4 * n + k] + (1 - decay) * rest
        return replace(seen, disturbance=r), [*memory[:-1], ca.vertcat(*kept)]

    def torque_loop(self, seen: ArmEstimate, torque: Any, acceleration: Any) -> Any:
        """Motor torques that make the joint torque follow ``torque`` (n)."""
        out = []
        for j in self.model.joints:
            p, k = self.model.joint_parameters(j), j - 1
            if j in self.model.rigid:
                dry = ca.if_else(
                    self.g["observer_bandwidth"] > 0, -seen.disturbance[k], self._dry_friction(j, seen.v[k])
                )
                out.append(self._rigid_drive_torque(j, seen.v[k], acceleration[k], torque[k], dry))
                continue
            twist = harmonic_drive.spring_torsion(torque[k] / p["stiffness_level"], harmonic_drive.spring_constants(p))
            gain = self.g["bandwidth"]
            push = acceleration[k] - 2 * gain * seen.phi_rate[k] + gain**2 * (twist - seen.phi[k])
            out.append(seen.torque[k] / p["ratio"] + p["motor_inertia"] * p["ratio"] * push - seen.disturbance[k])
        return ca.vertcat(*out)

    def position_loop(self, seen: ArmEstimate, q: Any, v: Any, a: Any, torque: Any) -> Any:
        """Motor torques that make the joints follow q, v, a (n each), for which they need ``torque``."""
        gain = self.g["bandwidth"]
        total = _write_mass_matrix(self.model)
        out = []
        for j in self.model.joints:
            p, k = self.model.joint_parameters(j), j - 1
            if j in self.model.rigid:
                back = 2 * gain * (v[k] - seen.v[k]) + gain**2 * (q[k] - seen.q[k])
                full = total[k, k] / p["ratio"]
                full = ca.substitute(full, ca.vertcat(self.model.q, self.model.v), ca.vertcat(seen.q, seen.v))
                push = self._rigid_drive_torque(j, v[k], a[k], torque[k], self._dry_friction(j, v[k]))
                out.append(push + full * back)
                continue
            theta = p["ratio"] * (
                q[k]
                + harmonic_drive.spring_torsion(torque[k] / p["stiffness_level"], harmonic_drive.spring_constants(p))
            )
            back = 2 * gain * (p["ratio"] * v[k] - seen.omega[k]) + gain**2 * (theta - seen.theta[k])
            out.append(torque[k] / p["ratio"] + p["motor_inertia"] * (p["ratio"] * a[k] + back) - seen.disturbance[k])
        return ca.vertcat(*out)

    def _rigid_drive_torque(self, j: int, v: Any, a: Any, torque: Any, dry: Any) -> Any:
        p = self.model.joint_parameters(j)
        friction = p["viscous_friction"] * (p["ratio"] * v) + dry
        return torque / p["ratio"] + p["motor_inertia"] * p["ratio"] * a + friction

    def _dry_friction(self, j: int, v: Any) -> Any:
        """Dry friction of the model, N m at the motor."""
        p = self.model.joint_parameters(j)
        return p["coulomb_friction"] * ca.tanh(p["ratio"] * v / p["friction_smoothing"])

    def arm_terms(self, q: Any, v: Any) -> tuple[Any, Any, Any, Any]:
        """Mass matrix of the links, C v + g, J, and dJ/dt v, at q and v."""
        symbols, parts = _write_arm_terms(self.model)
        mass, bias, jacobian, turn = ca.substitute(parts, symbols, [q, v])
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
