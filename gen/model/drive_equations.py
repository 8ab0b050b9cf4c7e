"""The equations of one joint's drive: its effects at their ports, along the signal chain from current to link.

Legend: θ, ω motor angle and speed; q, v joint position and velocity; φ torsion, τ joint torque.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from gen.effects.effect import Effect, Port, Signals
from gen.model import harmonic_drive

SX = ca.SX


@dataclass(frozen=True)
class DriveOutputs:
    """The results that the drive of one joint hands to the chain."""

    net_torque: Any  # on the rotor, N m
    dry_friction: Any  # of set-valued friction, N m at the motor: the change of `net` as the direction goes from 0 to 1
    acceleration: Any  # net / J_m; None for a rigid drive
    joint_torque: Any  # on the link, with the effects at the link, N m; a rigid drive's own part is in `net`
    transmitted_torque: Any = None  # by the gear, N m; of a rigid drive without the part that its rotor takes
    torsion: Any = None
    effective_torsion: Any = None  # torsion that the springs see
    spring_torque: Any = None
    rates: tuple[Any, ...] = ()


@dataclass(frozen=True)
class DriveSymbols:
    """The symbols of one joint that its drive reads, and the effects that act in it."""

    is_rigid: bool
    position: Any  # q
    velocity: Any  # v
    motor_position: Any  # θ
    motor_velocity: Any  # ω
    current: Any  # A, or N m where the input is torque
    effect_states: Mapping[tuple[str, str], Any]  # by effect and state, in the order of x
    effects: tuple[Effect, ...]  # that stand at this joint
    plan: harmonic_drive.InversePlan  # of the springs' inverse

    def effects_at(self, port: Port) -> list[Effect]:
        """List the effects at a port.

        Args:
            port: The port.

        Returns:
            The effects in the order in which they act.

        """
        return [effect for effect in self.effects if effect.port is port]


@dataclass(frozen=True)
class _Transmission:
    """Torque of the gear, and the torsion that it comes from; of a rigid drive only the torque has a meaning."""

    torque: Any
    torsion: Any = field(default_factory=SX)
    wound: Any = field(default_factory=SX)
    spring_torque: Any = field(default_factory=SX)
    slope: Any = field(default_factory=SX)  # change of the torsion by θ that effects add to 1/ratio


class _PortSums:
    """Adds up the effects at each port of one joint, and keeps the rates of their states."""

    def __init__(self, symbols: DriveSymbols, p: Mapping[str, Any]) -> None:
        self.symbols, self.p = symbols, p
        self.motor = {"motor_position": symbols.motor_position, "motor_velocity": symbols.motor_velocity}
        self.joint = {"joint_position": symbols.position, "joint_velocity": symbols.velocity}
        self.rates: dict[tuple[str, str], Any] = {}

    def add_up(self, port: Port, start: Any, **signals: Any) -> Any:
        """``start`` plus the terms of the effects at a port."""
        for effect in self.symbols.effects_at(port):
            own = {state.name: self.symbols.effect_states[effect.name, state.name] for state in effect.states}
            term = effect.equation(Signals(**signals, ratio=self.p["ratio"], states=own), self.p)
            if effect.states:
                term, change = term
                for state, rate in zip(effect.states, change, strict=True):
                    self.rates[effect.name, state.name] = rate
            start = start + term
        return start


def write_drive_equations(symbols: DriveSymbols, p: dict[str, Any], exact: Any, spring_torque: Any) -> DriveOutputs:
    """Write the equations of one joint's drive.

    Args:
        symbols: The joint's symbols.
        p: The joint's parameters by name (`Model.of_joint`).
        exact: The direction of sliding, −1, 0 or 1; None takes the smooth sign of the motor's speed.
        spring_torque: A symbol in place of the springs' torque, N m, where their inverse is to be differentiated
            implicitly; None writes the inverse itself.

    Returns:
        The torques, accelerations and rates of the drive.

    """
    ports = _PortSums(symbols, p)
    motor, joint, omega = ports.motor, ports.joint, symbols.motor_velocity
    if symbols.is_rigid:
        gear = _Transmission(p["ratio"] * p.get("torque_constant", 1) * symbols.current)
        link = ports.add_up(Port.LINK, 0, joint_torque=gear.torque, **joint, **motor)
    else:
        gear = _write_transmission(ports, spring_torque)
        link = ports.add_up(Port.LINK, gear.torque, joint_torque=gear.torque, **joint, **motor)
    tau, direction = gear.torque, exact
    if direction is None:
        direction = ca.tanh(omega / p["friction_smoothing"])
    cold = 1 - ports.add_up(Port.WARMTH, 0, **motor)
    level = ports.add_up(Port.FRICTION, 0, direction=direction, joint_torque=tau, **joint, **motor)
    level = cold * keep_friction_positive(level, symbols.effects_at(Port.FRICTION))
    inverse = 1 / p["motor_inertia"]
    ports.p = p | {"viscous_friction": cold * p["viscous_friction"]}
    felt = {"friction_level": level, "direction": direction, "joint_torque": tau}
    torque = ports.add_up(Port.MOTOR, 0, current=symbols.current, **felt, **motor)
    if not symbols.is_rigid:
        torque = torque - (tau * (1 / p["ratio"]) + gear.slope * tau)  # the gear does the work that it transmits
    net = torque - level * direction
    if exact is not None:  # other effects may have taken a part of the dry friction over
        level = ca.substitute(-ca.jacobian(net, exact), exact, 0)
    acceleration, sent = net * inverse, tau
    if symbols.is_rigid:
        acceleration, sent = None, p["ratio"] * net
    rates = tuple(ports.rates[key] for key in symbols.effect_states)
    return DriveOutputs(net, level, acceleration, link, sent, gear.torsion, gear.wound, gear.spring_torque, rates)


def keep_friction_positive(level: Any, effects: list[Effect]) -> Any:
    """Keep the level of dry friction from falling below 0, where several effects add up to it.

    Args:
        level: The level, N m at the motor.
        effects: The effects that make it.

    Returns:
        The level, N m at the motor; a single effect's own bounds keep it above 0 already.

    """
    if len(effects) > 1:
        return ca.fmax(level, 0)
    return level


def _write_transmission(ports: _PortSums, spring_torque: Any) -> _Transmission:
    """The gear with springs: torsion, the springs' torque, and the torque that it transmits."""
    symbols, p, motor = ports.symbols, ports.p, ports.motor
    theta, omega = symbols.motor_position, symbols.motor_velocity
    step_down = 1 / p["ratio"]
    error = ports.add_up(Port.TORSION, SX(0), **motor)
    slope = ca.jacobian(error, theta)  # beside 1/ratio, not added to it: slope 0 is then exact
    phi = theta * step_down + error - symbols.position
    phi_rate = omega * step_down + slope * omega - symbols.velocity
    play = ports.add_up(Port.PLAY, SX(0), torsion=phi)
    wound = phi - play
    if symbols.effects_at(Port.PLAY):  # within the play nothing touches, so nothing damps; without play all does
        phi_rate = phi_rate * (1 - (phi == play) * (phi != 0))
    spring = spring_torque
    if spring is None:
        spring = harmonic_drive.spring_torque(wound, harmonic_drive.spring_constants(p), p["inverse"], symbols.plan)
    tau = ports.add_up(Port.TRANSMISSION, 0, torsion=phi, torsion_rate=phi_rate, spring_torque=spring, **motor)
    return _Transmission(tau, phi, wound, spring, slope)
