"""The equations of motion of the whole arm at one state: its chain, the rotors that it carries, the base beneath it.

Legend: x state; q, v positions and velocities of the joints, before them those of the base where it turns; a
accelerations of the arm's joints, b those of the base (`gen.model.yielding_base`); M mass matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from gen.effects.effect import Port, Signals
from gen.model.arm_model import Model
from gen.model.drive_equations import DriveOutputs
from gen.model.symmetric_matrices import invert_symmetric, solve_symmetric
from gen.model.yielding_base import BASE_JOINTS, YieldingBase, add_base_joints

SX = ca.SX


class ArmMotion:
    """The motion of an arm in the state x of its model."""

    def __init__(self, model: Model, trig: Any = None) -> None:
        """Prepare the equations.

        Args:
            model: The model.
            trig: Sine and cosine of the joints' angles (`KinematicChain.sines_and_cosines`); None makes them from q.

        """
        self.model, self.chain, self.q, self.v = model, model.chain, model.q, model.v
        self.trig = trig or model.chain.sines_and_cosines(model.q)
        self.base = _find_base(model)
        if self.base is not None:
            turns, rates = (self.base.compliance * part for part in (self.base.moments, self.base.moment_rates))
            self.chain = add_base_joints(model.chain)
            self.q, self.v = ca.vertcat(turns, self.q), ca.vertcat(rates, self.v)
            sines, cosines = ca.sin(turns), ca.cos(turns)
            self.trig = tuple(
                [*ca.vertsplit(first), *then] for first, then in zip((sines, cosines), self.trig, strict=True)
            )
        self.first = self.chain.n - model.n  # place of the arm's first joint
        self.rotors = model.find_rotors(self.chain, self.trig, ca.vertsplit(self.v))

    def mass_matrix(self) -> Any:
        """Write the mass matrix of base and links with the rotors of rigid drives.

        Returns:
            M, kg m² or kg; a base without inertia of its own.

        """
        M = self.chain.mass_matrix(self.q, self.model.chain_parameters(), self.trig)
        return self.model.add_rotors(M, self.rotors)

    def equations_of_motion(self, drives: dict[int, DriveOutputs], sliding: Any = None) -> tuple[Any, Any]:
        """Write the equations of motion of the whole arm.

        Args:
            drives: The drive of each joint by its number.
            sliding: Direction of sliding of each motor (n), −1, 1, or 0 to stop it; None lets all move.

        Returns:
            The rate of x, and the torque that would hold each motor where it is (n, N m at the motor), which has a
            meaning for stopped joints only.

        """
        model, load, M = self.model, self._acting_load(drives, [0] * self.chain.n), self.mass_matrix()
        whole = (M, load)
        if self.base is not None:
            M, load = self.base.condense(*whole)
        released: list[Any] = [1] * model.n  # 1 where a motor moves, 0 where it is stopped
        if sliding is None:
            accelerations = solve_symmetric(M, load)
        else:
            released = [sliding[j - 1] ** 2 for j in model.joints]
            moves = [SX(1)] * model.n
            for j in model.rigid:
                moves[j - 1] = released[j - 1]
            held = ca.diag(ca.vertcat(*moves))
            accelerations = solve_symmetric(held @ M @ held + SX.eye(model.n) - held, ca.vertcat(*moves) * load)
        rest = load - M @ accelerations
        if self.base is not None:
            accelerations = ca.vertcat(accelerations, self.base.find_acceleration(*whole, accelerations))
        hold = []
        for j in model.joints:
            p, d = model.joint_parameters(j), drives[j]
            if j in model.rigid:
                hold.append(rest[j - 1] / p["ratio"])
            else:
                hold.append(d.net_torque - p["motor_inertia"] * self._carried_acceleration(j, accelerations))
        return self.state_rate(drives, accelerations, released), ca.vertcat(*hold)

    def state_rate(self, drives: dict[int, DriveOutputs], accelerations: Any, released: Sequence[Any]) -> Any:
        """Write the rate of x.

        Args:
            drives: The drive of each joint by its number.
            accelerations: a (n), and b (3) where the base turns.
            released: 1 where a motor moves, 0 where it is stopped (n).

        Returns:
            The rate of x.

        """
        model, motor = self.model, []
        for j in model.flexible:
            motor.append((drives[j].acceleration - self._carried_acceleration(j, accelerations)) * released[j - 1])
        speeds = [model.state_symbol(f"motor_velocity_{j}") for j in model.flexible]
        pending = {(j, True): list(drives[j].rates) for j in model.joints}
        if self.base is not None:
            pending[1, False] = ca.vertsplit(ca.vertcat(self.base.moment_rates, accelerations[model.n :]))
        rates = [pending[j, effect.port is not Port.STAND].pop(0) for effect, _, j in model.effect_states]
        return ca.vertcat(*speeds, model.v, *motor, accelerations[: model.n], *rates)

    # -- derivatives ------------------------------------------------------------------------------------------------

    def name_accelerations(self) -> tuple[Any, list[int]]:
        """Name the accelerations, to differentiate without solving for them.

        Returns:
            Symbols for a (n) and b (3 where the base turns), and their places in the rate of x.

        """
        names = [slot.name for slot in self.model.x_slots]
        places = [names.index(f"joint_velocity_{j}") for j in self.model.joints]
        if self.base is not None:
            places += [names.index(f"base_moment_rate_{axis}_1") for axis in "xyz"]
        return SX.sym("a", len(places)), places

    def unbalanced_load(self, drives: dict[int, DriveOutputs], accelerations: Any) -> Any:
        """Write the torques that a motion lacks: inverse dynamics, of which the true accelerations leave 0.

        Args:
            drives: The drive of each joint by its number.
            accelerations: a (n), and b (3) where the base turns.

        Returns:
            The torques (n), N m or N, and after them what the base's equation lacks (3), N m/s².

        """
        whole = self._whole_acceleration(accelerations)
        size = self.chain.n
        rotors = self.model.add_rotors(SX.zeros(size, size), self.rotors)
        load = self._acting_load(drives, ca.vertsplit(whole)) - rotors @ whole
        if self.base is None:
            return load
        lacking = self.base.squared_frequency * load[:BASE_JOINTS] + self.base.pulls - accelerations[self.model.n :]
        return ca.vertcat(load[BASE_JOINTS:], lacking)

    def invert_residual(self) -> Any:
        """Find the accelerations by what `unbalanced_load` lacks.

        Returns:
            The derivatives of a and b by each torque that is added (n × n, with a base that turns n + 3 square).

        """
        M = self.mass_matrix()
        if self.base is None:
            return invert_symmetric(M)
        n = self.model.n
        condensed, _ = self.base.condense(M, SX.zeros(self.chain.n))
        by_load, by_base = SX.eye(n + BASE_JOINTS)[:n, :], SX.eye(n + BASE_JOINTS)[n:, :]
        slopes = invert_symmetric(condensed) @ self.base.condense_slopes(M, by_load, by_base)
        return ca.vertcat(slopes, self.base.find_slopes(M, by_base, slopes))

    # -- parts ------------------------------------------------------------------------------------------------------

    def _whole_acceleration(self, accelerations: Any) -> Any:
        """Accelerations of the base's joints and of the arm's, from a and b."""
        if self.base is None:
            return accelerations
        n = self.model.n
        return ca.vertcat(self.base.compliance * accelerations[n:], accelerations[:n])

    def _carried_acceleration(self, j: int, accelerations: Any) -> Any:
        """The acceleration that the links before a joint give its rotor; 0 where it is not coupled."""
        if j not in self.rotors:
            return 0
        return self.rotors[j].find_acceleration(self._whole_acceleration(accelerations))

    def rotor_speed(self, j: int) -> Any:
        """Write the speed of a rotor about its axis, with that of the link that carries it.

        Args:
            j: The joint's number from 1.

        Returns:
            θ̇ + s Ω, rad/s.

        """
        if j in self.model.rigid:
            speed = self.model.joint_parameters(j)["ratio"] * self.model.v[j - 1]
        else:
            speed = self.model.state_symbol(f"motor_velocity_{j}")
        if j in self.rotors:
            speed = speed + self.rotors[j].find_turn(self.v)
        return speed

    def _acting_load(self, drives: dict[int, DriveOutputs], accelerations: Sequence[Any]) -> Any:
        """Torques of the drives, less those that the chain needs for its accelerations (N m or N)."""
        model, forces = self.model, []
        for j in model.joints:
            torque = drives[j].joint_torque
            if j in model.rigid:
                torque = torque + model.joint_parameters(j)["ratio"] * drives[j].net_torque
            forces.append(torque)
        load = ca.vertcat(*[SX(0)] * self.first, *forces)
        for j, rotor in self.rotors.items():
            p = model.joint_parameters(j)
            if j in model.flexible:
                load = load - rotor.row.T * drives[j].net_torque
            else:
                row = SX(rotor.row)
                row[self.first + j - 1] += p["ratio"]
                load = load - row.T * (p["motor_inertia"] * rotor.drift)
            load = load - rotor.twist * (p["motor_inertia"] * self.rotor_speed(j))
        chain = model.chain_parameters()
        field, wrench = self.chain.gravity(chain), ca.vertsplit(model.wrench)
        return load - self.chain.newton_euler(self.q, self.v, accelerations, chain, field, wrench, self.trig)


def _find_base(model: Model) -> YieldingBase | None:
    """The base as an effect lets it turn; None where it stands still."""
    for effect in model.effects_at(Port.STAND, 1):
        p = model.joint_parameters(1)
        states = {state.name: model.state_symbol(f"{state.name}_1") for state in effect.states}
        (compliance, squared_frequency), rates = effect.equation(Signals(states=states), p)
        moments = ca.vertcat(*list(states.values())[:BASE_JOINTS])
        moment_rates, pulls = ca.vertcat(*rates[:BASE_JOINTS]), ca.vertcat(*rates[BASE_JOINTS:])
        return YieldingBase(compliance, squared_frequency, moments, moment_rates, pulls)
    return None
