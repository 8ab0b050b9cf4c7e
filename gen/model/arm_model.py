"""The arm as one graph: drives in lanes, the chain that joins them, and the effects at their ports.

Legend: x state, u input, p parameters, c constants (p and all that depends on p alone), z the effects' states;
θ, ω motor angle and speed; q, v joint position and velocity; i input of the drive; φ torsion; τ joint torque; s
direction of sliding, −1, 0 (stuck) or 1.

A joint's drive is the same graph for every joint with the same kind of drive, so it is written once and evaluated in
lanes; only the chain couples the joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca

from gen.effects.effect import Effect, Port, Signals, State
from gen.model import harmonic_drive as drive
from gen.model.carried_rotors import CarriedRotor, find_carried_rotors
from gen.model.chain_dynamics import ChainDynamics
from gen.model.drive_equations import DriveOutputs, DriveSymbols, write_drive_equations
from gen.model.model_quantities import list_inputs, list_quantities, list_states, memory_step_quantity
from gen.model.robot_chain import make_chain
from gen.robot.description import Robot
from gen.robot.link_geometry import find_level_axes

SX = ca.SX


class Model:
    """Symbols and equations of one robot with a tuple of effects."""

    def __init__(self, robot: Robot, effects: tuple[Effect, ...]) -> None:
        self.robot = robot
        self.effects = tuple(effect.choose_form(robot.in_space) for effect in effects)
        self.n = len(robot.joints)
        self.joints = range(1, self.n + 1)
        self.chain = make_chain(robot)
        self.flexible = tuple(j for j in self.joints if not robot.joints[j - 1].drive.rigid)
        self.rigid = tuple(j for j in self.joints if robot.joints[j - 1].drive.rigid)
        self.plan = drive.plan_inverse([robot.joints[j - 1].drive for j in self.flexible])
        placed = [(effect, self.joints_of_effect(effect)) for effect in self.effects]
        self.effect_states = tuple((e, s, j) for e, joints in placed for j in joints for s in e.states)
        self.x_slots = list_states(robot, [(state, j) for _, state, j in self.effect_states])
        self.u_slots = list_inputs(robot)
        self.quantities = list_quantities(robot, placed, self.u_slots)
        if any(s.is_rate_limited for _, s, _ in self.effect_states) and not self.needs_stiff_step:
            self.quantities += (memory_step_quantity(robot.step),)
        self.p = SX.sym("p", len(self.quantities))
        self.x = SX.sym("x", len(self.x_slots))
        self.u = SX.sym("u", len(self.u_slots))
        self.by_name = {q.name: self.p[k] for k, q in enumerate(self.quantities)}
        self.inverse_symbols = {j: SX.sym(f"inverse_{j}", self.plan.degree + 1) for j in self.flexible}

    # -- states and joints -----------------------------------------------------------------------------------------

    @property
    def needs_stiff_step(self) -> bool:
        """Whether a state of an effect that the robot file asks for needs the L-stable step.

        The state of an effect whose amplitude is 0 to begin with is slowed until the explicit step carries it
        (`gen.effects.state_rate_limit`).
        """
        nominal = {(q.effect, q.joint, q.name): q.nominal for q in self.quantities}
        return any(
            nominal[e.name, j, f"{name}_{j}"] for e, s, j in self.effect_states if s.is_stiff for name in e.amplitudes
        )

    def joints_of_effect(self, effect: Effect) -> tuple[int, ...]:
        """Find the joints at which an effect stands.

        Args:
            effect: The effect.

        Returns:
            The joints' numbers from 1; (0,) for the arm as a whole.

        """
        if effect.needs_gravity and not any(part.nominal for part in self.robot.gravity):
            return ()
        if effect.joints == "arm":
            return (0,)
        chosen: tuple[int, ...] = {"first": (1,), "last": (self.n,)}.get(effect.joints, tuple(self.joints))
        if effect.port is Port.SERIES:
            chosen = tuple(j for j in chosen if self.robot.joints[j - 1].drive.compliant)
        return tuple(
            j
            for j in chosen
            if (effect.suits_rigid_drive or j in self.flexible)
            and (effect.suits_prismatic_joint or self.robot.joints[j - 1].kind == "revolute")
        )

    @property
    def drive_states(self) -> tuple[tuple[Effect, State, int], ...]:
        """The states of effects that stand in a drive, each with its effect and the number of its joint."""
        return tuple(one for one in self.effect_states if one[0].port is not Port.STAND)

    def state_symbol(self, name: str) -> Any:
        """Find the symbol of a state.

        Args:
            name: The name of the entry of x.

        Returns:
            The symbol.

        """
        return self.x[[s.name for s in self.x_slots].index(name)]

    # -- symbols ----------------------------------------------------------------------------------------------------

    @property
    def q(self) -> Any:
        """Joint positions (n)."""
        return ca.vertcat(*(self.state_symbol(f"joint_position_{j}") for j in self.joints))

    @property
    def v(self) -> Any:
        """Joint velocities (n)."""
        return ca.vertcat(*(self.state_symbol(f"joint_velocity_{j}") for j in self.joints))

    @property
    def wrench(self) -> Any:
        """Force of the world on the tip, N, and in space its moment, N m, in the base frame (2, or 6 in space)."""
        return self.u[self.n :]

    def joint_symbols(self, j: int) -> dict[str, Any]:
        """Find the parameters of a joint as the robot file and the effects give them.

        Args:
            j: The joint's number from 1, or 0 for the arm as a whole.

        Returns:
            The symbols in p by the names that equations use, without the joint's number.

        """
        own = {q.name.removesuffix(f"_{j}"): self.p[k] for k, q in enumerate(self.quantities) if q.joint == j}
        if "memory_step" in self.by_name:
            own["memory_step"] = self.by_name["memory_step"]
        if j in self.inverse_symbols:
            own["inverse"] = self.inverse_symbols[j]
        return own

    def joint_parameters(self, j: int) -> dict[str, Any]:
        """Find the parameters that the equations of a joint read.

        Effects in series change the level and the damping of the springs. States of effects that the L-stable step
        carries are not slowed.

        Args:
            j: The joint's number from 1, or 0 for the arm as a whole.

        Returns:
            Symbols and expressions by name, as `joint_symbols`.

        """
        p: dict[str, Any] = {"memory_step": 0.0} | self.joint_symbols(j)
        for effect in self.effects_at(Port.SERIES, j):
            share, damping = effect.equation(Signals(), p)
            p["stiffness_level"] = p["stiffness_level"] * share
            p["torsional_damping"] = p["torsional_damping"] + damping
        return p

    def inverse_definitions(self) -> tuple[Any, Any]:
        """Find the coefficients of the springs' inverses, which depend on p alone.

        Returns:
            The symbols that stand for them, and their definitions in p.

        """
        made = [
            drive.inverse_coefficients(drive.spring_constants(self.joint_parameters(j)), self.plan.degree)
            for j in self.flexible
        ]
        return ca.vertcat(*self.inverse_symbols.values()), ca.vertcat(*made)

    def effects_at(self, port: Port, j: int) -> list[Effect]:
        """List the effects at a port of a joint.

        Args:
            port: The port.
            j: The joint's number from 1, or 0 for the arm as a whole.

        Returns:
            The effects in the order in which they act.

        """
        return [e for e in self.effects if e.port is port and j in self.joints_of_effect(e)]

    def chain_parameters(self) -> dict[str, Any]:
        """Find the parameters of the chain, with gravity and the tip's mass as the effects make them.

        Returns:
            Symbols and expressions by name.

        """
        values = dict(self.by_name)
        stated = ca.vertcat(*(self.by_name[f"gravity_{axis}"] for axis in self.chain.axes))
        base = Signals(gravity=stated, level_axes=find_level_axes(self.robot))
        fields = [e.equation(base, self.joint_parameters(0)) for e in self.effects_at(Port.BASE, 0)]
        for k, axis in enumerate(self.chain.axes):
            values[f"gravity_{axis}"] = sum(field[k] for field in fields)
        masses = [e.equation(Signals(), self.joint_parameters(self.n)) for e in self.effects_at(Port.MASS, self.n)]
        if self.chain.in_space:
            for mass, *center in masses:
                values |= {"tip_mass": mass, "tip_mass_center": center}
        else:
            values["tip_mass"] = sum(masses)
        return values

    # -- one drive --------------------------------------------------------------------------------------------------

    def drive_outputs(self, j: int, p: dict[str, Any], exact: Any = None, spring_torque: Any = None) -> DriveOutputs:
        """Write the equations of a joint's drive.

        Args:
            j: The joint's number from 1.
            p: The joint's parameters by name (`joint_parameters`).
            exact: The direction of sliding, −1, 0 or 1; None takes the smooth sign.
            spring_torque: A symbol in place of the springs' torque, N m, where their inverse is to be differentiated
                implicitly.

        Returns:
            The torques, accelerations and rates of the drive.

        """
        q, v = self.state_symbol(f"joint_position_{j}"), self.state_symbol(f"joint_velocity_{j}")
        if j in self.rigid:
            theta, omega = p["ratio"] * q, p["ratio"] * v
        else:
            theta, omega = self.state_symbol(f"motor_position_{j}"), self.state_symbol(f"motor_velocity_{j}")
        states = {(e.name, s.name): self.state_symbol(f"{s.name}_{j}") for e, s, k in self.drive_states if k == j}
        effects = tuple(e for e in self.effects if j in self.joints_of_effect(e))
        current = self.u[j - 1]
        symbols = DriveSymbols(j in self.rigid, q, v, theta, omega, current, states, effects, self.plan)
        return write_drive_equations(symbols, p, exact, spring_torque)

    # -- rotors -----------------------------------------------------------------------------------------------------

    def find_rotors(self, chain: ChainDynamics, trig: Any, velocities: Sequence[Any]) -> dict[int, CarriedRotor]:
        """Find how links move the rotors that they carry.

        Args:
            chain: The chain, or a longer one that ends with its joints.
            trig: Sines and cosines of its joints' angles.
            velocities: Velocities of its joints.

        Returns:
            The coupled rotors by the number of their joint.

        """
        before, directions = chain.n - self.n - 1, {}
        for j in self.joints:
            p = self.joint_parameters(j)
            found = [e.equation(Signals(ratio=p["ratio"]), p) for e in self.effects_at(Port.REACTION, j)]
            if found:
                directions[before + j] = sum(found)
        carried = find_carried_rotors(chain, trig, velocities, directions)
        return {place - before: rotor for place, rotor in carried.items()}

    def add_rotors(self, M: Any, rotors: dict[int, CarriedRotor]) -> Any:
        """Add the rotors of rigid drives to a mass matrix.

        Args:
            M: The mass matrix of a chain that ends with the arm's joints.
            rotors: The coupled rotors in it (`find_rotors`).

        Returns:
            The sum.

        """
        size = M.shape[0]
        for j in self.rigid:
            p = self.joint_parameters(j)
            row = SX.zeros(1, size)
            row[size - self.n + j - 1] = p["ratio"]
            if j in rotors:
                row = row + rotors[j].row
            M = M + p["motor_inertia"] * row.T @ row
        return M

    def total_mass_matrix(self) -> Any:
        """Write the mass matrix of the links with the rotors of rigid drives.

        Returns:
            The mass matrix (n × n), kg m² or kg.

        """
        return self._links_and_rotors

    @cached_property
    def _links_and_rotors(self) -> Any:
        trig = self.chain.sines_and_cosines(self.q)
        rotors = self.find_rotors(self.chain, trig, ca.vertsplit(self.v))
        return self.add_rotors(self.chain.mass_matrix(self.q, self.chain_parameters(), trig), rotors)
