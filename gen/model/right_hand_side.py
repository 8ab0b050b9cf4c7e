"""The right-hand side of the arm, arranged for speed: drives in lanes, constants computed once, and its derivatives."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca

from gen.effects.effect import Port
from gen.model import harmonic_drive, input_effects, mechanics
from gen.model.arm_model import Model
from gen.model.drive_equations import DriveOutputs
from gen.model.emitted_function import EmittedFunction, make_dense_function
from gen.model.equations_of_motion import ArmMotion

SX = ca.SX
DRIVE_PORTS = {  # ports whose effects stand in the graph of one drive
    Port.WARMTH, Port.FRICTION, Port.MOTOR, Port.TORSION, Port.PLAY, Port.SERIES, Port.TRANSMISSION, Port.LINK,
}  # fmt: skip


LANE_WIDTHS = (2, 4, 8)
WIDEST_LANE = LANE_WIDTHS[-1]


@dataclass(frozen=True)
class Lane:
    """Joints whose drives are the same graph, evaluated side by side."""

    joints: tuple[int, ...]
    width: int  # of the vector: 2, 4, 8
    state_entries: tuple[tuple[int, ...], ...]  # for each state that the graph reads: its index in x for each joint
    smooth: (
        ca.Function
    )  # (state entries…, input, constants) -> (acceleration or net torque, joint torque, sine, cosine, rates…)
    exact: ca.Function  # (…, direction) -> (level, net, acceleration, joint torque, sine, cosine, rates…)
    constants: Any  # (k × width) symbols, a part of c
    definitions: Any  # the same as functions of p


@dataclass(frozen=True)
class Preparation:
    """`prepare` in two parts: the long one, the inverse of a joint's springs, is printed once for all joints."""

    inverse: ca.Function | None  # (keys) -> coefficients; None where every drive is rigid
    keys: tuple[tuple[int, ...], ...]  # entries of p that each flexible joint's inverse takes
    rest: ca.Function  # (p, coefficients of all joints) -> c


@dataclass
class Graphs:
    """The functions to emit, and the parts of the right-hand side that lanes need."""

    model: Model
    lanes: tuple[Lane, ...]
    chain: ca.Function  # smooth: (x, u, lane outputs, c) -> rate of x
    exact_chain: ca.Function  # (x, u, sliding, lane outputs, c) -> rate of x
    holding_chain: ca.Function  # (x, u, sliding, lane outputs, c) -> (hold, level)
    preparation: Preparation
    c: Any
    functions: tuple[EmittedFunction, ...] = field(default_factory=tuple)


def hoist_constants(expressions: list[Any], p: Any) -> tuple[list[Any], list[Any], list[Any]]:
    """Replace every part of the expressions that depends on p alone by a symbol.

    Args:
        expressions: The expressions.
        p: The symbols that count as known.

    Returns:
        The expressions, the new symbols, and the definitions of these in p.

    """
    stacked, symbols, definitions = ca.extract_parametric(
        ca.cse(ca.vertcat(*[ca.vec(ca.densify(e)) for e in expressions])), p
    )
    ends = itertools.accumulate(SX(e).numel() for e in expressions)
    parts = ca.vertsplit(stacked, [0, *ends])
    return [ca.reshape(part, SX(e).shape) for part, e in zip(parts, expressions, strict=True)], symbols, definitions


class Constants:
    """Collects c: parameters, the springs' inverses, the lanes' constants, then those of all other expressions."""

    def __init__(self, model: Model) -> None:
        self.symbols, self.definitions = [model.p], [model.p]
        self.inverse_pair = model.inverse_definitions()
        self.add(*self.inverse_pair)
        self.fixed = ca.vertcat(*self.symbols)  # the symbols on which hoisted expressions may depend

    def add(self, symbols: Any, definitions: Any) -> None:
        """Append symbols with their definitions in p."""
        self.symbols.append(ca.vec(symbols))
        self.definitions.append(ca.vec(definitions))

    def hoist(self, expressions: list[Any]) -> list[Any]:
        """The expressions over c."""
        changed, symbols, definitions = hoist_constants(expressions, self.fixed)
        first = sum(s.numel() for s in self.symbols)
        renamed = [SX.sym(f"e{first + k}") for k in range(len(symbols))]
        if symbols:
            changed = ca.substitute(changed, symbols, renamed)
            self.add(ca.vertcat(*renamed), ca.vertcat(*definitions))
        return list(changed)

    @property
    def c(self) -> Any:
        """All of c."""
        return ca.vertcat(*self.symbols)

    def preparation(self, model: Model) -> Preparation:
        """The function p -> c in two parts."""
        symbols, definition = model.inverse_definitions()
        rest = ca.Function(
            "rest", [model.p, symbols], [ca.vertcat(*self.definitions[:1], symbols, *self.definitions[2:])]
        )
        if not model.flexible:
            return Preparation(None, (), rest)
        count = model.inverse_symbols[model.flexible[0]].numel()
        places = {
            j: _find_dependencies(definition[k * count : (k + 1) * count], model.p)
            for k, j in enumerate(model.flexible)
        }
        first = model.flexible[0]
        inverse = ca.Function("inverse", [model.p[list(places[first])]], [definition[:count]], {"cse": True})
        return Preparation(inverse, tuple(places.values()), rest)

    def definitions_in_p(self) -> Any:
        """All of c as functions of p alone."""
        return ca.substitute(ca.vertcat(*self.definitions), *self.inverse_pair)


def _find_dependencies(expression: Any, p: Any) -> tuple[int, ...]:
    """Entries of p that the expression depends on."""
    return tuple(k for k in range(p.numel()) if ca.depends_on(expression, p[k]))


def assemble_graphs(model: Model) -> Graphs:
    """Write everything that is emitted for a model.

    Args:
        model: The model.

    Returns:
        The functions to emit, and the parts of the right-hand side that lanes need.

    """
    constants = Constants(model)
    lanes = tuple(_make_lane(model, joints, constants) for joints in _group_joints(model))
    D = {j: _lane_symbols(model, lane, j) for lane in lanes for j in lane.joints}
    trig = _joint_trig(model, D)
    sliding = SX.sym("sliding", model.n)
    motion, drives = ArmMotion(model, trig), {j: d for j, (d, _, _) in D.items()}
    smooth_rate, _ = motion.equations_of_motion(drives)
    exact_rate, hold = motion.equations_of_motion(drives, sliding)
    smooth_rate, exact_rate, hold = constants.hoist([smooth_rate, exact_rate, hold])
    jacobians = constants.hoist(_rate_jacobians(model))
    c = constants.c
    handed = ca.vertcat(*(ca.vertcat(*symbols) for _, symbols, _ in D.values()))
    levels = ca.vertcat(*(D[j][0].dry_friction for j in model.joints))
    ins = {"x": model.x, "u": model.u, "sliding": sliding, "handed": handed, "c": c}
    smooth_ins = {name: ins[name] for name in ins if name != "sliding"}
    chain = make_dense_function("chain", smooth_ins, {"rate": smooth_rate})
    exact_chain = make_dense_function("exact_chain", ins, {"rate": exact_rate})
    holding_chain = make_dense_function("holding_chain", ins, {"hold": hold, "level": levels})
    smooth = _hand_over(model, lanes, None)
    exact = _hand_over(model, lanes, sliding)
    xuc = {"x": model.x, "u": model.u, "c": c}
    rate = chain(model.x, model.u, smooth, c)
    exact_rate = exact_chain(model.x, model.u, sliding, exact, c)
    hold, levels = holding_chain(model.x, model.u, sliding, exact, c)
    functions = [
        EmittedFunction(
            make_dense_function("prepare", {"p": model.p}, {"c": constants.definitions_in_p()}),
            "constants from parameters",
        ),
        EmittedFunction(make_dense_function("rhs", xuc, {"rate": rate}), "rate of x, friction with the smooth sign"),
        *_emit_exact_friction(model, c, sliding, exact_rate, hold, levels),
        EmittedFunction(
            make_dense_function("rhs_jacobian", xuc, dict(zip(("by_x", "by_u", "by_p"), jacobians, strict=True))),
            "derivatives of the rate by x, u and p, column by column",
        ),
        input_effects.emit_input_law(model, c),
        *mechanics.emit_kinematics(model, c),
        mechanics.emit_positions(model, c),
        *mechanics.emit_dynamics(model, c),
    ]
    if model.needs_stiff_step:
        functions += _stiff_functions(model, xuc, jacobians[0])
    return Graphs(model, lanes, chain, exact_chain, holding_chain, constants.preparation(model), c, tuple(functions))


def _emit_exact_friction(
    model: Model, c: Any, sliding: Any, rate: Any, hold: Any, levels: Any
) -> tuple[EmittedFunction, EmittedFunction]:
    """The functions of dry friction that sticks exactly: the rate, and the torques that hold the motors."""
    ins = {"x": model.x, "u": model.u, "sliding": sliding, "c": c}
    return (
        EmittedFunction(
            make_dense_function("rhs_exact", ins, {"rate": rate}),
            "rate of x, each motor sliding in the given direction or stuck (0)",
        ),
        EmittedFunction(
            make_dense_function("holding", ins, {"hold": hold, "level": levels}),
            "torque that holds each motor at rest, and the most that dry friction gives, N m at the motor",
        ),
    )


def _stiff_functions(model: Model, xuc: dict[str, Any], by_x: Any) -> list[EmittedFunction]:
    """The functions that the L-stable step needs besides the right-hand side."""
    stiffness = make_dense_function("stiffness_rate", xuc, {"rate": _stiffness_rate(model)})
    jacobian = make_dense_function("state_jacobian", xuc, {"by_x": by_x})
    return [
        EmittedFunction(stiffness, "fastest decay of a stiff state, 1/s"),
        EmittedFunction(jacobian, "derivative of the rate by x alone, column by column"),
    ]


# -- lanes ----------------------------------------------------------------------------------------------------------


def _group_joints(model: Model) -> list[tuple[int, ...]]:
    """Joints whose drives are the same graph: of one kind, with one kind of input and the same effects."""
    kinds: dict[Any, list[int]] = {}
    for j in model.joints:
        joint = model.robot.joints[j - 1]
        acting = tuple(e.name for e in model.effects if e.port in DRIVE_PORTS and j in model.joints_of_effect(e))
        kinds.setdefault((joint.drive.rigid, joint.kind, joint.drive.torque_constant is None, acting), []).append(j)
    return [tuple(joints[k : k + WIDEST_LANE]) for joints in kinds.values() for k in range(0, len(joints), WIDEST_LANE)]


def _state_names(model: Model, j: int) -> list[str]:
    names = [f"motor_position_{j}", f"joint_position_{j}", f"motor_velocity_{j}", f"joint_velocity_{j}"]
    if j in model.rigid:
        names = names[1::2]
    return names + [f"{s.name}_{j}" for _, s, k in model.drive_states if k == j]


def _lane_outputs(model: Model, j: int, d: DriveOutputs) -> tuple[list[Any], list[Any]]:
    """The results of a lane in the smooth and in the exact form, with sine and cosine of a revolute joint."""
    results = [d.net_torque]
    if d.acceleration is not None:
        results.append(d.acceleration)
    results.append(d.joint_torque)
    if model.robot.joints[j - 1].kind == "revolute":
        q = model.state_symbol(f"joint_position_{j}")
        results += [ca.sin(q), ca.cos(q)]
    return [*results, *d.rates], [d.dry_friction]


def _make_lane(model: Model, joints: tuple[int, ...], constants: Constants) -> Lane:
    width = next(w for w in LANE_WIDTHS if w >= len(joints))
    first, index = joints[0], {s.name: k for k, s in enumerate(model.x_slots)}
    s = SX.sym("s")
    smooth, _ = _lane_outputs(model, first, model.drive_outputs(first, model.joint_parameters(first)))
    drive_exact = model.drive_outputs(first, model.joint_parameters(first), exact=s)
    exact = [*_lane_outputs(model, first, drive_exact)[1], *_lane_outputs(model, first, drive_exact)[0]]
    own = {j: model.joint_symbols(j) for j in joints}
    keys = sorted(set.intersection(*map(set, own.values())))
    p = ca.vertcat(*(own[first][key] for key in keys))
    given = {p[k].element_hash() for k in range(p.numel())}
    changed, symbols, definitions = hoist_constants([SX(e) for e in smooth + exact], p)
    direct = [v for v in ca.symvar(ca.vertcat(*changed)) if v.element_hash() in given]
    constant = ca.vertcat(*direct, *symbols)
    entries = [model.state_symbol(name) for name in _state_names(model, first)]
    inputs = [*entries, model.u[first - 1]]
    names = [*(f"state_{k}" for k in range(len(entries))), "input"]
    k = SX.sym(f"k{first}", constant.numel(), width)
    define = ca.Function("define", [p], [ca.vertcat(*direct, *definitions)])
    columns = []
    for j in [*joints, *[joints[0]] * (width - len(joints))]:
        columns.append(define(ca.vertcat(*(own[j][key] for key in keys))))
    places = [[index[name] for name in _state_names(model, j)] for j in joints]
    lane = Lane(
        joints,
        width,
        tuple(zip(*places, strict=True)),
        _lane_function("smooth", [*names, "constants"], [*inputs, constant], changed[: len(smooth)]),
        _lane_function("exact", [*names, "direction", "constants"], [*inputs, s, constant], changed[len(smooth) :]),
        k,
        ca.horzcat(*columns),
    )
    constants.add(
        k.T, lane.definitions.T
    )  # lane after lane of each constant side by side, so that one load fetches a vector
    return lane


def _lane_function(name: str, names: list[str], inputs: list[Any], outputs: list[Any]) -> ca.Function:
    return ca.Function(name, inputs, outputs, names, [f"h{k}" for k in range(len(outputs))], {"cse": True})


def _lane_symbols(model: Model, lane: Lane, j: int) -> tuple[DriveOutputs, list[Any], tuple[Any, Any] | None]:
    """Symbols for the results of a lane for joint j, in the order of the exact outputs; sine and cosine apart too."""
    names = ["level", "net"]
    if j in model.flexible:
        names.append("acceleration")
    names.append("joint_torque")
    turns = model.robot.joints[j - 1].kind == "revolute"
    if turns:
        names += ["sine", "cosine"]
    named = {name: SX.sym(f"{name}_{j}") for name in names}
    rates = [SX.sym(f"rate_{j}_{k}") for k in range(lane.exact.n_out() - len(names))]
    d = DriveOutputs(named["net"], named["level"], named.get("acceleration"), named["joint_torque"], rates=tuple(rates))
    symbols = [*named.values(), *rates]
    if turns:
        return d, symbols, (named["sine"], named["cosine"])
    return d, symbols, None


def _joint_trig(model: Model, D: dict[int, Any]) -> tuple[list[Any], list[Any]]:
    pairs = [D[j][2] or (0, 1) for j in model.joints]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def _hand_over(model: Model, lanes: tuple[Lane, ...], sliding: Any) -> Any:
    """The lanes' outputs as scalars, joint after joint of each lane; the smooth form has no level."""
    out = []
    for lane in lanes:
        for place, j in enumerate(lane.joints):
            states = [model.x[index[place]] for index in lane.state_entries]
            if sliding is None:
                out += [SX(0), *lane.smooth.call([*states, model.u[j - 1], lane.constants[:, place]])]
            else:
                out += lane.exact.call([*states, model.u[j - 1], sliding[j - 1], lane.constants[:, place]])
    return ca.vertcat(*out)


# -- derivatives ----------------------------------------------------------------------------------------------------


def _rate_jacobians(model: Model) -> list[Any]:
    """∂ẋ/∂x, ∂ẋ/∂u, ∂ẋ/∂p, differentiated neither through an iteration nor through a factorisation.

    With r the load that a motion lacks, ∂a/∂w is M⁻¹ ∂r/∂w at the accelerations a. The springs' inverse is
    differentiated by the implicit function theorem, so the derivative is that of the law itself, at τ = 0 too. A
    coupled rotor brings its torque to all joints before its own: that torque has a name in r, so that the derivative by
    each of the many parameters that it depends on is one factor of its column.
    """
    spring = {j: SX.sym(f"spring_{j}") for j in model.flexible}
    drives = {j: model.drive_outputs(j, model.joint_parameters(j), spring_torque=spring.get(j)) for j in model.joints}
    motion = ArmMotion(model)
    a, places = motion.name_accelerations()
    spread = {j: SX.sym(f"net_torque_{j}") for j in motion.rotors}
    known = {j: replace(d, net_torque=spread.get(j, d.net_torque)) for j, d in drives.items()}
    load, rate = motion.unbalanced_load(known, a), motion.state_rate(known, a, [1] * model.n)
    law = {j: harmonic_drive.spring_constants(model.joint_parameters(j)) for j in model.flexible}
    torques = [
        harmonic_drive.spring_torque(drives[j].effective_torsion, law[j], model.inverse_symbols[j], model.plan)
        for j in model.flexible
    ]
    accelerations = motion.equations_of_motion(drives)[0][places]
    by_unknown = ca.jacobian(rate, a) @ motion.invert_residual()
    spread_torques, net_torques = ca.vertcat(*spread.values()), ca.vertcat(*(drives[j].net_torque for j in spread))
    by_spread = by_unknown @ ca.jacobian(load, spread_torques)
    out = []
    for w in (model.x, model.u, model.p):
        by_load, by_rate, by_net = (ca.jacobian(of, w) for of in (load, rate, net_torques))
        for j in model.flexible:
            slack = ca.jacobian(
                drives[j].effective_torsion - harmonic_drive.spring_torsion(spring[j], law[j]), w
            ) / harmonic_drive.spring_compliance(spring[j], law[j])
            by_load, by_rate, by_net = (
                by + ca.jacobian(of, spring[j]) @ slack
                for by, of in ((by_load, load), (by_rate, rate), (by_net, net_torques))
            )
        total = by_rate + by_unknown @ by_load  # most parameters stand in one torque: a column of the product each
        if spread:
            total = ca.substitute(total + by_spread @ by_net, spread_torques, net_torques)
        total = ca.substitute(total, a, accelerations)
        if spring:
            total = ca.substitute(total, ca.vertcat(*spring.values()), ca.vertcat(*torques))
        out.append(total)
    return out


def _stiffness_rate(model: Model) -> Any:
    drives = {j: model.drive_outputs(j, model.joint_parameters(j)) for j in model.joints}
    fastest = SX(0)
    for j in model.joints:
        own = [s for _, s, k in model.drive_states if k == j]
        for s, rate in zip(own, drives[j].rates, strict=True):
            if s.is_stiff:
                fastest = ca.fmax(fastest, ca.fabs(ca.jacobian(rate, model.state_symbol(f"{s.name}_{j}"))))
    return fastest
