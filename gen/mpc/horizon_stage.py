"""One node of the horizon as graphs: rate of the arm with its Jacobians, outputs that cost, rows that are limited.

Legend: x scaled state (positions, then velocities), T motor torque over its largest, d disturbance torque at the
motors, F force on the tip (in space and its moment), z memory of the effects (held over the horizon), w walls (normal
and offset each); f rate of x; a accelerations, M mass matrix, r load that a motion lacks; y outputs that cost, R
orientation of the tip in space.

The state is that of the arm without the effects' memories, which the estimator follows. Positions of motors are taken
at the joint (over the ratio), velocities in units of `VELOCITY_UNIT` per second, torques in units of the motor's
largest, so that all entries are of one size. Friction is smooth over a width that a node carries (`smoothing`); the
spring is the model's own.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen.model import harmonic_drive
from gen.model.arm_model import Model
from gen.model.emitted_function import make_dense_function
from gen.model.equations_of_motion import ArmMotion
from gen.model.right_hand_side import hoist_constants
from gen.mpc.problem_structure import Structure
from gen.mpc.target_axes import TargetAxes

SX = ca.SX
VELOCITY_UNIT = 100.0  # 1/s: a velocity of 1 in the solver's units is this, in positions a second
SPEED_ROUNDING = 1e-3  # m/s: below it the length of the tip's velocity is rounded, so that it has a derivative


@dataclass(frozen=True)
class Stage:
    """The graphs, and the meaning of their entries.

    ``rate``: (x, T, F, shared) -> f, ∂f/∂x, ∂f/∂T of the velocities' rows; ``look``: (x, shared) -> y and after it R,
    ∂y/∂x, g, ∂g/∂x; ``constants``: c -> the first entries of shared. ``shared``: constants, then d, smoothing, memory,
    walls.
    """

    model: Model
    structure: Structure
    axes: TargetAxes
    rate: ca.Function
    output_graph: ca.Function
    constants: ca.Function
    horizon_entries: tuple[int, ...]  # entries of the model's x that the horizon's state is made of
    state_units: tuple[float, ...]  # SI of 1 in each of them
    held_entries: tuple[int, ...]  # entries of the model's x that are held
    torque_units: tuple[float, ...]  # N m of 1 in each input
    shared_offsets: dict[str, int]  # where the parts of shared begin, and its length "end"

    @property
    def nx(self) -> int:
        """Entries of the horizon's state."""
        return len(self.horizon_entries)

    @property
    def ny(self) -> int:
        """Outputs that cost: position and velocity along the target's axes, then joint velocities."""
        return 2 * self.axes.count + self.model.n

    @property
    def ng(self) -> int:
        """General rows: joint torques, tip speed, walls."""
        return int(self.output_graph.numel_out(2))


def make_stage(model: Model, structure: Structure, fixed: Any) -> Stage:
    """Write the stage of a model.

    Args:
        model: The model.
        structure: The controller's structure.
        fixed: The symbols with which c begins: p and the springs' inverses.

    Returns:
        The stage.

    """
    names = [slot.name for slot in model.x_slots]
    memory = tuple(names.index(f"{s.name}_{j}") for _, s, j in model.effect_states)
    index = tuple(k for k in range(len(names)) if k not in memory)
    ratios = {
        f"motor_{what}_{j}": abs(_gear_ratio(model, j)) for j in model.joints for what in ("position", "velocity")
    }
    scale = tuple(ratios.get(names[k], 1.0) * (VELOCITY_UNIT if "velocity" in names[k] else 1.0) for k in index)
    torque = tuple(model.u_slots[j - 1].bound * (_nominal_torque_constant(model, j) or 1.0) for j in model.joints)
    n, x, T, F = model.n, SX.sym("x", len(index)), SX.sym("T", model.n), SX.sym("F", len(model.u_slots) - model.n)
    axes = TargetAxes(model, structure)
    d, smoothing = SX.sym("d", n), SX.sym("smoothing", n)
    held, walls = (
        SX.sym("held", max(1, len(memory))),
        SX.sym("walls", max(1, (len(model.chain.axes) + 1) * structure.walls)),
    )
    full = SX.zeros(len(names))
    for place, k in enumerate(index):
        full[k] = x[place] * scale[place]
    for place, k in enumerate(memory):
        full[k] = held[place]
    f, by_x, by_T = _velocity_rates(model, index, scale, torque, (x, T, F, d, smoothing, full))
    (y, Y), g = _outputs_that_cost(axes, full, x), _limited_rows(model, structure, walls, full)
    parts = [f, by_x, by_T, y, Y, g, ca.jacobian(g, x)]
    parts, symbols, definitions = hoist_constants([ca.densify(SX(part)) for part in parts], fixed)
    direct = [v for v in ca.symvar(ca.vertcat(*map(ca.vec, parts))) if ca.depends_on(fixed, v)]
    constants = ca.vertcat(*direct, *symbols)
    shared = ca.vertcat(constants, d, smoothing, held, walls)
    sizes = {"constants": constants.numel(), "disturbance": n, "smoothing": n, "held": held.numel(),
             "walls": walls.numel()}  # fmt: skip
    places, at = {}, 0
    for name, size in sizes.items():
        places[name], at = at, at + size
    rate = make_dense_function(
        "rate", {"x": x, "T": T, "F": F, "shared": shared}, dict(zip("fJB", parts[:3], strict=True))
    )
    look = make_dense_function("look", {"x": x, "shared": shared}, dict(zip("yYgG", parts[3:], strict=True)))
    made = make_dense_function("mpc_constants", {"c": fixed}, {"k": ca.vertcat(*direct, *definitions)})
    return Stage(model, structure, axes, rate, look, made, index, scale, memory, torque, places | {"end": at})


def _gear_ratio(model: Model, j: int) -> float:
    return float(model.robot.joints[j - 1].drive.ratio.nominal)


def _nominal_torque_constant(model: Model, j: int) -> float | None:
    value = model.robot.joints[j - 1].drive.torque_constant
    if value is None:
        return None
    return float(value.nominal)


def _velocity_rates(
    model: Model, index: Any, scale: Any, torque: Any, symbols: tuple[Any, ...]
) -> tuple[Any, Any, Any]:
    """Rate of the velocities in the solver's units, and its Jacobians by x and T. The springs' inverse is
    differentiated by the implicit function theorem, as in `gen.model.right_hand_side`."""
    x, T, F, d, smoothing, full = symbols
    spring = {j: SX.sym(f"spring_{j}") for j in model.flexible}
    drives = {j: model.drive_outputs(j, model.joint_parameters(j), spring_torque=spring.get(j)) for j in model.joints}
    motion = ArmMotion(model)
    rate, _ = motion.equations_of_motion(drives)
    law = {j: harmonic_drive.spring_constants(model.joint_parameters(j)) for j in model.flexible}
    inputs = []
    for j in model.joints:
        constant = model.by_name.get(f"torque_constant_{j}", 1.0)
        inputs.append((T[j - 1] * torque[j - 1] + d[j - 1]) / constant)
    old = [model.x, model.u, *(model.by_name[f"friction_smoothing_{j}"] for j in model.joints)]
    new = [full, ca.vertcat(*inputs, F), *ca.vertsplit(smoothing)]

    def over(expression: Any) -> Any:
        return ca.substitute([SX(expression)], old, new)[0]

    def pick_rows(rate: Any) -> Any:
        return over(ca.vertcat(*(rate[index[k]] / scale[k] for k in range(len(index) // 2, len(index)))))

    f = pick_rows(rate)
    slopes = _slopes_by_load(motion, drives, rate, (pick_rows, over)) if model.chain.in_space else _slopes_of(f)
    wound = {j: over(drives[j].effective_torsion) for j in model.flexible}
    by = [slopes(w) for w in (x, T)]
    solved = []
    for j in model.flexible:
        slope = over(harmonic_drive.spring_compliance(spring[j], law[j]))
        for k, w in enumerate((x, T)):
            by[k] = by[k] + slopes(spring[j]) @ (ca.jacobian(wound[j], w) / slope)
        solved.append(
            harmonic_drive.spring_torque(
                wound[j], substitute_springs(law[j], over), model.inverse_symbols[j], model.plan
            )
        )
    if spring:
        f, *by = ca.substitute([f, *by], list(spring.values()), solved)
    return f, by[0], by[1]


def _slopes_of(f: Any) -> Callable[[Any], Any]:
    """Jacobians by differentiating all of it, which is the shortest for the few terms of a plane."""
    return lambda w: ca.jacobian(f, w)


def _slopes_by_load(
    motion: ArmMotion, drives: Any, rate: Any, replace: tuple[Callable[[Any], Any], Callable[[Any], Any]]
) -> Callable[[Any], Any]:
    """Jacobians that are not differentiated through the factorisation of M: ∂a = M⁻¹ ∂r at the accelerations a, as in
    `gen.model.right_hand_side`."""
    pick_rows, over = replace
    a, places = motion.name_accelerations()
    load = over(motion.unbalanced_load(drives, a))
    moved = pick_rows(motion.state_rate(drives, a, [1] * motion.model.n))
    by_load = ca.jacobian(moved, a) @ over(motion.invert_residual())
    accelerations = over(rate[places])

    def find_slopes(w: Any) -> Any:
        slopes = ca.jacobian(moved, w) + by_load @ ca.jacobian(load, w)
        return ca.substitute(slopes, a, accelerations)

    return find_slopes


def substitute_springs(law: harmonic_drive.SpringConstants, over: Any) -> harmonic_drive.SpringConstants:
    """Replace symbols in the constants of a drive's law.

    Args:
        law: The constants.
        over: Replaces the symbols of an expression.

    Returns:
        The constants with symbols replaced.

    """
    return harmonic_drive.SpringConstants(**{name: over(value) for name, value in vars(law).items()})


def _outputs_that_cost(axes: TargetAxes, full: Any, x: Any) -> tuple[Any, Any]:
    """The outputs that cost with the tip's orientation after them, and the outputs' Jacobian by x. A turn is told from
    the present orientation: 0, with the angular velocity's Jacobian (`gen.mpc.target_axes`)."""
    model, q, v = axes.model, axes.model.q, axes.model.v
    chain, p = model.chain, model.chain_parameters()

    def over(expression: Any) -> Any:
        return ca.substitute([SX(expression)], [model.x], [full])[0]

    if axes.structure.space == "joint":
        y = over(ca.vertcat(q, v, v))
        return y, ca.jacobian(y, x)
    J = chain.tip_jacobian(q, p)
    place, moving = chain.tip_position(q, p), over(ca.vertcat(J @ v, v))
    if not axes.follows_pose:
        y = ca.vertcat(over(place), moving)
        return y, ca.jacobian(y, x)
    turn, place = over(J[axes.positions :, :]) @ ca.jacobian(over(q), x), over(place)
    y = ca.vertcat(place, SX.zeros(turn.shape[0]), moving, ca.vec(over(chain.tip_rotation(q))))
    return y, ca.vertcat(ca.jacobian(place, x), turn, ca.jacobian(moving, x))


def _limited_rows(model: Model, structure: Structure, walls: Any, full: Any) -> Any:
    """The limited rows: joint torques, N m; tip speed, m/s; depth in each wall, m."""
    chain, q, v = model.chain_parameters(), model.q, model.v
    count = len(model.chain.axes)
    tip, moving = model.chain.tip_position(q, chain), model.chain.tip_jacobian(q, chain)[:count, :] @ v
    torques = []
    for j in model.flexible:
        drives = model.drive_outputs(j, model.joint_parameters(j))
        torques.append(drives.transmitted_torque)
    speed = ca.sqrt(_sum_terms([moving[i] ** 2 for i in range(count)]) + SPEED_ROUNDING**2)
    depths = []
    for k in range(0, (count + 1) * structure.walls, count + 1):
        depths.append(_sum_terms([walls[k + i] * tip[i] for i in range(count)]) - walls[k + count])
    g = ca.vertcat(*torques, speed, *depths)
    return ca.substitute([SX(g)], [model.x], [full])[0]


def _sum_terms(terms: list[Any]) -> Any:
    return functools.reduce(operator.add, terms)
