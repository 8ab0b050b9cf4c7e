"""The arm as one graph: drives in lanes, the chain that joins them, and the effects at their ports.

Legend: x state, u input, p parameters, c constants (p and whatever depends on p alone), z the effects' states;
θ, ω motor angle and speed; q, v joint position and velocity; i input of the drive; φ torsion; τ joint torque; s
direction of sliding, −1, 0 (stuck) or 1.

A joint's drive is the same graph for every joint with the same kind of drive, so it is written once and evaluated in
lanes; only the chain couples the joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen import drive, sizes
from gen.arm import Chain
from gen.effect import Effect, Parameter, Port, Signals
from gen.robot import Robot, parameters
from gen.schema import keys

SX = ca.SX


@dataclass(frozen=True)
class Quantity:
    """A named entry of p with its bounds; ``joint`` 0 is the whole arm."""

    name: str
    joint: int
    unit: str
    nominal: float
    low: float
    high: float
    tolerance: float
    meaning: str
    effect: str | None = None  # whose amplitude or shape it is
    role: str = "base"  # "base" a key of the robot file, "amplitude" or "shape" of an effect
    typical: float | None = None  # size of a difference from nominal that is usually met, in `unit`
    everywhere: float | None = None  # that of which every machine has a little, where that is another
    starts: tuple[float, ...] = ()  # of a shape: values from which a search starts


@dataclass(frozen=True)
class Slot:
    """A named entry of x or u; ``bound`` is the size up to which the model is meant to be used."""

    name: str
    unit: str
    bound: float


@dataclass(frozen=True)
class Drives:
    """What the drive of one joint hands to the chain."""

    net: Any  # on the rotor, N m
    level: Any  # of set-valued friction, N m at the motor: what `net` loses as the direction goes from 0 to 1
    acceleration: Any  # net / J_m; None for a rigid drive
    joint_torque: Any  # on the link, with what acts at the link, N m; a rigid drive's own part is in `net`
    transmitted: Any = None  # by the gear, N m; of a rigid drive without what its rotor takes
    torsion: Any = None
    wound: Any = None  # torsion that the springs see
    spring_torque: Any = None
    rates: tuple[Any, ...] = ()


class Model:
    """Symbols and equations of one robot with a tuple of effects."""

    def __init__(self, robot: Robot, effects: tuple[Effect, ...]) -> None:
        self.robot, self.effects = robot, effects
        self.n = len(robot.joints)
        self.joints = range(1, self.n + 1)
        self.chain = Chain([joint.kind for joint in robot.joints])
        self.flexible = tuple(j for j in self.joints if not robot.joints[j - 1].drive.rigid)
        self.rigid = tuple(j for j in self.joints if robot.joints[j - 1].drive.rigid)
        self.plan = drive.plan([robot.joints[j - 1].drive for j in self.flexible])
        self.memory = tuple((e, s, j) for e in effects for j in self.applies(e) for s in e.states)
        self.x_slots, self.u_slots = self._x_slots(), self._u_slots()
        self.quantities = self._quantities()
        if any(s.slowed for _, s, _ in self.memory) and not self.stiff:
            self.quantities += (_memory_step(robot.step),)
        self.p = SX.sym("p", len(self.quantities))
        self.x = SX.sym("x", len(self.x_slots))
        self.u = SX.sym("u", len(self.u_slots))
        self.by_name = {q.name: self.p[k] for k, q in enumerate(self.quantities)}
        self.inverse = {j: SX.sym(f"inverse_{j}", self.plan.degree + 1) for j in self.flexible}

    # -- what there is ----------------------------------------------------------------------------------------------

    @property
    def stiff(self) -> bool:
        """Whether a memory that the robot file asks for needs the L-stable step; one whose amplitude is 0 to begin with
        is slowed to what the explicit step carries (`gen.memory`)."""
        nominal = {(q.effect, q.joint, q.name): q.nominal for q in self.quantities}
        return any(nominal[e.name, j, f"{name}_{j}"] for e, s, j in self.memory if s.stiff for name in e.amplitudes)

    def applies(self, effect: Effect) -> tuple[int, ...]:
        """The joints at which the effect stands; (0,) for the arm as a whole."""
        if effect.joints == "arm":
            return (0,)
        chosen: tuple[int, ...] = {"first": (1,), "last": (self.n,)}.get(effect.joints, tuple(self.joints))
        if effect.port is Port.SERIES:
            chosen = tuple(j for j in chosen if self._drive(j).compliant)
        return tuple(
            j
            for j in chosen
            if (effect.rigid or j in self.flexible)
            and (effect.prismatic or self.robot.joints[j - 1].kind == "revolute")
        )

    def _quantities(self) -> tuple[Quantity, ...]:
        amplitude_of = {key: effect for effect in self.effects for key in effect.sizes}
        found = []
        for v in parameters(self.robot):
            low, high = v.low, v.high
            key = v.name.rpartition("_")[0]
            if key in drive.SPRINGS:  # where the springs' inverse keeps its error, and a robot file may state them
                low = max(min(low, v.nominal), v.nominal / drive.SPREAD)
                high = min(max(high, v.nominal), v.nominal * drive.SPREAD)
            effect = amplitude_of.get(key)
            typical = effect.sizes[key] * sizes.usual(self.robot, v.joint, key) if effect else None
            name = effect.name if effect else None
            found.append(
                Quantity(v.name, v.joint, v.unit, v.nominal, low, high, v.tolerance, v.meaning, name, "base", typical)
            )
        stated = {(s.name, s.joint): s.parameters for s in self.robot.effects}
        for effect in self.effects:
            for j in self.applies(effect):
                values = stated.get((effect.name, j), {})
                found += [
                    self._quantity(effect, parameter, j, values.get(parameter.name))
                    for parameter in effect.parameters
                    if not (parameter.unless and getattr(self._drive(j), parameter.unless) is not None)
                ]
        return tuple(found)

    def _quantity(self, effect: Effect, parameter: Parameter, j: int, stated: Any) -> Quantity:
        name = f"{parameter.name}_{j}" if j else parameter.name
        nominal = parameter.nominal if stated is None else stated.nominal
        tolerance = 0.0 if stated is None else stated.tolerance
        unit, factor = parameter.unit, self._factor(parameter.scale, j)
        if stated is None and parameter.starts:
            nominal *= factor
        if j and self.robot.joints[j - 1].kind == "prismatic":
            unit = parameter.sliding or unit
        if j and self.u_slots[j - 1].unit != "A":
            unit = unit.replace("1/A", "1/(N m)")
        return Quantity(
            name,
            j,
            unit,
            nominal,
            parameter.low,
            parameter.high,
            tolerance,
            parameter.meaning,
            effect.name,
            "amplitude" if parameter.name in effect.amplitudes else "shape",
            None if parameter.typical is None else parameter.typical * factor,
            None if parameter.everywhere is None else parameter.everywhere * factor,
            tuple(start * factor for start in parameter.starts),
        )

    def _factor(self, scale: str | None, j: int) -> float:
        """What a parameter's scale comes to at joint j."""
        over, _, under = (scale or "1").partition("/")
        top, bottom = (1.0 if key in ("1", "") else sizes.usual(self.robot, j, key) for key in (over, under))
        return top / bottom

    def _x_slots(self) -> tuple[Slot, ...]:
        slots = []
        for quantity, unit, size in (("position", "rad", sizes.POSITION), ("velocity", "rad/s", sizes.VELOCITY)):
            for j in self.flexible:
                slots.append(Slot(f"motor_{quantity}_{j}", unit, size * abs(self._drive(j).ratio.nominal)))
            for j in self.joints:
                prismatic = self.robot.joints[j - 1].kind == "prismatic"
                slots.append(Slot(f"joint_{quantity}_{j}", unit.replace("rad", "m") if prismatic else unit, size))
        slots += [Slot(f"{s.name}_{j}", s.unit, s.bound) for _, s, j in self.memory]
        return tuple(slots)

    def _u_slots(self) -> tuple[Slot, ...]:
        slots = []
        for j in self.joints:
            name, unit = ("motor_torque", "N m") if self._drive(j).torque_constant is None else ("motor_current", "A")
            slots.append(Slot(f"{name}_{j}", unit, sizes.largest_input(self.robot, j)))
        return (*slots, Slot("tip_force_x", "N", 100.0), Slot("tip_force_y", "N", 100.0))

    def _drive(self, j: int) -> Any:
        return self.robot.joints[j - 1].drive

    def slot(self, name: str) -> Any:
        """The symbol in x of that name."""
        return self.x[[s.name for s in self.x_slots].index(name)]

    # -- symbols ----------------------------------------------------------------------------------------------------

    @property
    def q(self) -> Any:
        """Joint positions (n)."""
        return ca.vertcat(*(self.slot(f"joint_position_{j}") for j in self.joints))

    @property
    def v(self) -> Any:
        """Joint velocities (n)."""
        return ca.vertcat(*(self.slot(f"joint_velocity_{j}") for j in self.joints))

    @property
    def force(self) -> Any:
        """Force of the world on the tip, base frame, N (2)."""
        return self.u[self.n :]

    def symbols_of(self, j: int) -> dict[str, Any]:
        """The symbols of joint j's parameters by the names that equations use, without the joint's number."""
        own = {q.name.removesuffix(f"_{j}"): self.p[k] for k, q in enumerate(self.quantities) if q.joint == j}
        own |= {"memory_step": self.by_name["memory_step"]} if "memory_step" in self.by_name else {}
        return own | ({"inverse": self.inverse[j]} if j in self.inverse else {})

    def of_joint(self, j: int) -> dict[str, Any]:
        """What equations of joint j read by name: `symbols_of`, with the springs' level and damping as effects in
        series make them; memories that the L-stable step carries are not slowed."""
        p: dict[str, Any] = {"memory_step": 0.0} | self.symbols_of(j)
        for effect in self.at(Port.SERIES, j):
            share, damping = effect.equation(Signals(), p)
            p["stiffness_level"] = p["stiffness_level"] * share
            p["torsional_damping"] = p["torsional_damping"] + damping
        return p

    def derived(self) -> tuple[Any, Any]:
        """Symbols that stand for coefficients made from p alone (the springs' inverse), and what they are."""
        made = [drive.inverse(drive.springs(self.of_joint(j)), self.plan.degree) for j in self.flexible]
        return ca.vertcat(*self.inverse.values()), ca.vertcat(*made)

    def at(self, port: Port, j: int) -> list[Effect]:
        """The effects at a port of joint j (0: of the whole arm)."""
        return [e for e in self.effects if e.port is port and j in self.applies(e)]

    def chain_parameters(self) -> dict[str, Any]:
        """Parameters of the chain by name, with gravity and tip mass as the effects make them."""
        values = dict(self.by_name)
        fields = [e.equation(Signals(), self.of_joint(0)) for e in self.at(Port.BASE, 0)]
        values["gravity_x"], values["gravity_y"] = (sum(f[k] for f in fields) for k in (0, 1))
        values["tip_mass"] = sum(e.equation(Signals(), self.of_joint(self.n)) for e in self.at(Port.MASS, self.n))
        return values

    # -- one drive --------------------------------------------------------------------------------------------------

    def drive(self, j: int, p: dict[str, Any], exact: Any = None, spring_torque: Any = None) -> Drives:
        """The drive of joint j. ``exact`` is the direction of sliding (None: smooth sign); ``spring_torque`` replaces
        the springs' torque by a symbol where the inverse is to be differentiated implicitly."""
        rigid = j in self.rigid
        q, v = self.slot(f"joint_position_{j}"), self.slot(f"joint_velocity_{j}")
        theta = p["ratio"] * q if rigid else self.slot(f"motor_position_{j}")
        omega = p["ratio"] * v if rigid else self.slot(f"motor_velocity_{j}")
        states = {(e.name, s.name): self.slot(f"{s.name}_{j}") for e, s, k in self.memory if k == j}
        rates: dict[tuple[str, str], Any] = {}

        def total(port: Port, start: Any, **signals: Any) -> Any:
            for effect in self.at(port, j):
                own = {s.name: states[effect.name, s.name] for s in effect.states}
                term = effect.equation(Signals(**signals, ratio=p["ratio"], states=own), p)
                if effect.states:
                    term, change = term
                    rates.update({(effect.name, s.name): r for s, r in zip(effect.states, change, strict=True)})
                start = start + term
            return start

        motor = {"motor_position": theta, "motor_velocity": omega}
        joint = {"joint_position": q, "joint_velocity": v}
        current = self.u[j - 1]
        step_down = 1 / p["ratio"]
        phi = wound = spring = slope = SX()
        if rigid:
            tau = p["ratio"] * p.get("torque_constant", 1) * current
        else:
            error = total(Port.TORSION, SX(0), **motor)
            slope = ca.jacobian(error, theta)  # beside 1/ratio, not added to it: slope 0 is then exact
            phi, phi_rate = theta * step_down + error - q, omega * step_down + slope * omega - v
            play = total(Port.PLAY, SX(0), torsion=phi)
            wound = phi - play
            if self.at(Port.PLAY, j):  # within the play nothing touches, so nothing damps; without play all does
                phi_rate = phi_rate * (1 - (phi == play) * (phi != 0))
            spring = spring_torque
            if spring is None:
                spring = drive.spring_torque(wound, drive.springs(p), p["inverse"], self.plan)
            tau = total(Port.TRANSMISSION, 0, torsion=phi, torsion_rate=phi_rate, spring_torque=spring, **motor)
        link = total(Port.LINK, 0 if rigid else tau, joint_torque=tau, **joint, **motor)
        direction = ca.tanh(omega / p["friction_smoothing"]) if exact is None else exact
        cold = 1 - total(Port.WARMTH, 0, **motor)
        level = total(Port.FRICTION, 0, direction=direction, joint_torque=tau, **joint, **motor)
        level = cold * (ca.fmax(level, 0) if self.dips(j) else level)  # dry friction never drives
        inverse, p = 1 / p["motor_inertia"], p | {"viscous_friction": cold * p["viscous_friction"]}
        felt = {"friction_level": level, "direction": direction, "joint_torque": tau}
        torque = total(Port.MOTOR, 0, current=current, **felt, **motor)
        if not rigid:
            torque = torque - (tau * step_down + slope * tau)  # the gear does the work that it transmits
        net = torque - level * direction
        if exact is not None:  # other effects may have taken a part of the dry friction over
            level = ca.substitute(-ca.jacobian(net, exact), exact, 0)
        order = tuple(rates[e.name, s.name] for e, s, k in self.memory if k == j)
        sent = p["ratio"] * net if rigid else tau
        return Drives(net, level, None if rigid else net * inverse, link, sent, phi, wound, spring, order)

    def dips(self, j: int) -> bool:
        """Whether effects could bring the level of dry friction of joint j below 0."""
        return len(self.at(Port.FRICTION, j)) > 1

    # -- the whole arm ----------------------------------------------------------------------------------------------

    def reaction(self, j: int, p: dict[str, Any]) -> Any:
        """How the rotor of joint j couples to the links before it: row of ∂(rotor speed)/∂v (1 × n), or None."""
        found = [e.equation(Signals(ratio=p["ratio"]), p) for e in self.at(Port.REACTION, j)]
        if not found:
            return None
        carried = [1 if k < j and self.robot.joints[k - 1].kind == "revolute" else 0 for k in self.joints]
        return sum(found) * SX(carried).T

    def inertia(self, trig: Any = None) -> Any:
        """Mass matrix of the links with the rotors of rigid drives (n × n)."""
        M = self.chain.mass_matrix(self.q, self.chain_parameters(), trig)
        for j in self.rigid:
            p = self.of_joint(j)
            row = SX.zeros(1, self.n)
            row[j - 1] = p["ratio"]
            reaction = self.reaction(j, p)
            row = row if reaction is None else row + reaction
            M = M + p["motor_inertia"] * row.T @ row
        return M

    def motion(self, drives: dict[int, Drives], sliding: Any = None, trig: Any = None) -> tuple[Any, Any]:
        """Rate of x, and the torque that would hold each motor where it is (n, N m at the motor).

        ``sliding`` (n, in −1, 0, 1) stops the joints where it is 0; None lets all move. The holding torque has a
        meaning for stopped joints only.
        """
        forces = []
        for j in self.joints:
            d = drives[j]
            forces.append(d.joint_torque + (self.of_joint(j)["ratio"] * d.net if j in self.rigid else 0))
        load = ca.vertcat(*forces)
        for j in self.flexible:
            reaction = self.reaction(j, self.of_joint(j))
            load = load if reaction is None else load - reaction.T * drives[j].net
        chain = self.chain_parameters()
        field, force = (chain["gravity_x"], chain["gravity_y"]), (self.force[0], self.force[1])
        load = load - self.chain.recursion(self.q, self.v, [0] * self.n, chain, field, force, trig)
        M = self.inertia(trig)
        if sliding is None:
            accelerations = solve_symmetric(M, load)
        else:
            moves = ca.vertcat(*(sliding[j - 1] ** 2 if j in self.rigid else SX(1) for j in self.joints))
            held = ca.diag(moves)
            accelerations = solve_symmetric(held @ M @ held + SX.eye(self.n) - held, moves * load)
        rest = load - M @ accelerations
        motor, hold = [], []
        for j in self.joints:
            p, d = self.of_joint(j), drives[j]
            if j in self.rigid:
                hold.append(rest[j - 1] / p["ratio"])
                continue
            reaction = self.reaction(j, p)
            carried = 0 if reaction is None else (reaction @ accelerations)[0]
            motor.append((d.acceleration - carried) * (1 if sliding is None else sliding[j - 1] ** 2))
            hold.append(d.net - p["motor_inertia"] * carried)
        speeds = [self.slot(f"motor_velocity_{j}") for j in self.flexible]
        pending = {j: list(drives[j].rates) for j in self.joints}
        rates = [pending[j].pop(0) for _, _, j in self.memory]
        return ca.vertcat(*speeds, self.v, *motor, accelerations, *rates), ca.vertcat(*hold)


def _memory_step(step: float) -> Quantity:
    """The step, s, that slowed memories are prepared for, which whoever integrates with another one sets."""
    key = keys("")["step"]
    meaning = "integration step, faster than which no memory of an effect builds up"
    return Quantity("memory_step", 0, "s", step, key.range.low, key.range.high, 0.0, meaning)


def solve_symmetric(M: Any, b: Any) -> Any:
    """Solution of M a = b for symmetric positive definite M (n × n), by L D Lᵀ, unrolled."""
    n = M.shape[0]
    L, D = SX.eye(n), [SX(0)] * n
    for j in range(n):
        D[j] = M[j, j] - sum(L[j, k] * L[j, k] * D[k] for k in range(j))
        for i in range(j + 1, n):
            L[i, j] = (M[i, j] - sum(L[i, k] * L[j, k] * D[k] for k in range(j))) / D[j]
    y: list[Any] = []
    for i in range(n):
        y.append(b[i] - sum(L[i, k] * y[k] for k in range(i)))
    a: list[Any] = [None] * n
    for i in reversed(range(n)):
        a[i] = y[i] / D[i] - sum(L[k, i] * a[k] for k in range(i + 1, n))
    return ca.vertcat(*a)
