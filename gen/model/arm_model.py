"""The arm as one graph: drives in lanes, the chain that joins them, and the effects at their ports.

Legend: x state, u input, p parameters, c constants (p and all that depends on p alone), z the effects' states;
θ, ω motor angle and speed; q, v joint position and velocity; i input of the drive; φ torsion; τ joint torque; s
direction of sliding, −1, 0 (stuck) or 1.

A joint's drive is the same graph for every joint with the same kind of drive, so it is written once and evaluated in
lanes; only the chain couples the joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from gen.effects.effect import Effect, Port, Signals
from gen.model import harmonic_drive as drive
from gen.model.drive_equations import DriveOutputs, DriveSymbols, write_drive_equations
from gen.model.model_quantities import list_inputs, list_quantities, list_states, memory_step_quantity
from gen.model.robot_chain import make_chain
from gen.model.symmetric_matrices import solve_symmetric
from gen.robot.description import Robot

SX = ca.SX


class Model:
    """Symbols and equations of one robot with a tuple of effects."""

    def __init__(self, robot: Robot, effects: tuple[Effect, ...]) -> None:
        self.robot, self.effects = robot, effects
        self.n = len(robot.joints)
        self.joints = range(1, self.n + 1)
        self.chain = make_chain(robot)
        self.flexible = tuple(j for j in self.joints if not robot.joints[j - 1].drive.rigid)
        self.rigid = tuple(j for j in self.joints if robot.joints[j - 1].drive.rigid)
        self.plan = drive.plan_inverse([robot.joints[j - 1].drive for j in self.flexible])
        self.effect_states = tuple((e, s, j) for e in effects for j in self.joints_of_effect(e) for s in e.states)
        self.x_slots = list_states(robot, [(state, j) for _, state, j in self.effect_states])
        self.u_slots = list_inputs(robot)
        self.quantities = list_quantities(robot, [(e, self.joints_of_effect(e)) for e in effects], self.u_slots)
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
        if not self._acts_here(effect):
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

    def _acts_here(self, effect: Effect) -> bool:
        """Whether the effect's equation holds in a chain like this one."""
        return effect.suits_joint_in_space or not self.robot.in_space

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
        fields = [e.equation(Signals(), self.joint_parameters(0)) for e in self.effects_at(Port.BASE, 0)]
        values["gravity_x"], values["gravity_y"] = (sum(f[k] for f in fields) for k in (0, 1))
        values["tip_mass"] = sum(
            e.equation(Signals(), self.joint_parameters(self.n)) for e in self.effects_at(Port.MASS, self.n)
        )
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
        states = {(e.name, s.name): self.state_symbol(f"{s.name}_{j}") for e, s, k in self.effect_states if k == j}
        effects = tuple(e for e in self.effects if j in self.joints_of_effect(e))
        current = self.u[j - 1]
        symbols = DriveSymbols(j in self.rigid, q, v, theta, omega, current, states, effects, self.plan)
        return write_drive_equations(symbols, p, exact, spring_torque)

    # -- the whole arm ----------------------------------------------------------------------------------------------

    def rotor_reaction(self, j: int, p: dict[str, Any]) -> Any:
        """Find how the rotor of a joint couples to the links before it.

        Args:
            j: The joint's number from 1.
            p: The joint's parameters by name.

        Returns:
            The row of ∂(rotor speed)/∂v (1 × n), or None where the rotor is not coupled.

        """
        found = [e.equation(Signals(ratio=p["ratio"]), p) for e in self.effects_at(Port.REACTION, j)]
        if not found:
            return None
        carried = [int(k < j and self.robot.joints[k - 1].kind == "revolute") for k in self.joints]
        return sum(found) * SX(carried).T

    def carried_motion(self, j: int, p: dict[str, Any], motion: Any) -> Any:
        """Find the part of a rotor's motion that the links before its joint give it.

        Args:
            j: The joint's number from 1.
            p: The joint's parameters by name.
            motion: Velocities or accelerations of the joints (n).

        Returns:
            The same of the rotor, at the motor; 0 where it is not coupled.

        """
        reaction = self.rotor_reaction(j, p)
        if reaction is None:
            return 0
        return (reaction @ motion)[0]

    def total_mass_matrix(self, trig: Any = None) -> Any:
        """Write the mass matrix of the links with the rotors of rigid drives.

        Args:
            trig: Sine and cosine of the joints' angles (`Chain.trig`); None makes them from q.

        Returns:
            The mass matrix (n × n), kg m² or kg.

        """
        return self._add_rotors(self.chain.mass_matrix(self.q, self.chain_parameters(), trig))

    def _add_rotors(self, M: Any) -> Any:
        """A mass matrix with the rotors of rigid drives added."""
        for j in self.rigid:
            p = self.joint_parameters(j)
            row = SX.zeros(1, self.n)
            row[j - 1] = p["ratio"]
            reaction = self.rotor_reaction(j, p)
            if reaction is not None:
                row = row + reaction
            M = M + p["motor_inertia"] * row.T @ row
        return M

    def equations_of_motion(
        self, drives: dict[int, DriveOutputs], sliding: Any = None, trig: Any = None
    ) -> tuple[Any, Any]:
        """Write the equations of motion of the whole arm.

        Args:
            drives: The drive of each joint by its number.
            sliding: Direction of sliding of each motor (n), −1, 1, or 0 to stop it; None lets all move.
            trig: Sine and cosine of the joints' angles (`Chain.trig`); None makes them from q.

        Returns:
            The rate of x, and the torque that would hold each motor where it is (n, N m at the motor), which has a
            meaning for stopped joints only.

        """
        load = self._acting_load(drives, trig, [0] * self.n)
        M = self.total_mass_matrix(trig)
        released: list[Any] = [1] * self.n  # 1 where a motor moves, 0 where it is stopped
        if sliding is None:
            accelerations = solve_symmetric(M, load)
        else:
            released = [sliding[j - 1] ** 2 for j in self.joints]
            moves = [SX(1)] * self.n
            for j in self.rigid:
                moves[j - 1] = released[j - 1]
            held = ca.diag(ca.vertcat(*moves))
            accelerations = solve_symmetric(held @ M @ held + SX.eye(self.n) - held, ca.vertcat(*moves) * load)
        rest = load - M @ accelerations
        hold = []
        for j in self.joints:
            p, d = self.joint_parameters(j), drives[j]
            if j in self.rigid:
                hold.append(rest[j - 1] / p["ratio"])
            else:
                hold.append(d.net_torque - p["motor_inertia"] * self.carried_motion(j, p, accelerations))
        return self.state_rate(drives, accelerations, released), ca.vertcat(*hold)

    def state_rate(self, drives: dict[int, DriveOutputs], accelerations: Any, released: Sequence[Any]) -> Any:
        """Write the rate of x.

        Args:
            drives: The drive of each joint by its number.
            accelerations: Accelerations of the joints (n).
            released: 1 where a motor moves, 0 where it is stopped (n).

        Returns:
            The rate of x.

        """
        motor = []
        for j in self.flexible:
            carried = self.carried_motion(j, self.joint_parameters(j), accelerations)
            motor.append((drives[j].acceleration - carried) * released[j - 1])
        speeds = [self.state_symbol(f"motor_velocity_{j}") for j in self.flexible]
        pending = {j: list(drives[j].rates) for j in self.joints}
        rates = [pending[j].pop(0) for _, _, j in self.effect_states]
        return ca.vertcat(*speeds, self.v, *motor, accelerations, *rates)

    def unbalanced_load(self, drives: dict[int, DriveOutputs], accelerations: Any) -> Any:
        """Write the torques that a motion lacks: inverse dynamics, of which the true accelerations leave 0.

        Args:
            drives: The drive of each joint by its number.
            accelerations: Accelerations of the joints (n).

        Returns:
            The torques (n), N m or N.

        """
        rotors = self._add_rotors(SX.zeros(self.n, self.n))
        return self._acting_load(drives, None, ca.vertsplit(accelerations)) - rotors @ accelerations

    def _acting_load(self, drives: dict[int, DriveOutputs], trig: Any, accelerations: Sequence[Any]) -> Any:
        """Torques of the drives, less those that the chain needs for its accelerations (n, N m or N)."""
        forces = []
        for j in self.joints:
            torque = drives[j].joint_torque
            if j in self.rigid:
                torque = torque + self.joint_parameters(j)["ratio"] * drives[j].net_torque
            forces.append(torque)
        load = ca.vertcat(*forces)
        for j in self.flexible:
            reaction = self.rotor_reaction(j, self.joint_parameters(j))
            if reaction is not None:
                load = load - reaction.T * drives[j].net_torque
        chain = self.chain_parameters()
        field, wrench = self.chain.gravity(chain), ca.vertsplit(self.wrench)
        return load - self.chain.newton_euler(self.q, self.v, accelerations, chain, field, wrench, trig)
