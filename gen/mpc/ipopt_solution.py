"""The truth beside a tick: the whole nonlinear problem, converged by IPOPT, with the dynamics integrated finely.

Nothing of the compiled controller is in it but the graphs from which it was made: every node is integrated by RK4 in
small steps, so that the error of the exponential step is measured too. Limits are soft with the same exact penalty
(slacks), inputs hard. Source: Wächter, Biegler, Math. Program. 106 (2006) 25.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from gen.model.function_library import Library
from gen.model.rotation_vectors import find_rotation_vector, make_rotation_matrix
from gen.mpc.horizon_stage import VELOCITY_UNIT, Stage, make_stage
from gen.mpc.problem_structure import Structure

MX, SX = ca.MX, ca.SX
STEPS_PER_NODE = 4  # steps of RK4 a node: 2.5 ms each at the default, a hundredth of a joint's period


def solve_problem(library: Library, structure: Structure, problem: Mapping[str, Any]) -> dict[str, Any]:
    """Solve a controller's problem to convergence.

    Args:
        library: The library.
        structure: The controller's structure.
        problem: In the controller's units: x (first state), T (torques: the starting guess, and the plan to compare),
            before, shared, force, goal (nodes × outputs), orientation (nodes × 9 in space: that from which the
            goal's turn is told, else × 0), weights (2 × outputs: all nodes, last), torque_weight,
            rate_weight, hold, low, high, linear, square (rows), grid, period, simple, fading.

    Returns:
        The torques "T" (nodes × n, in the controller's units), their "cost" and the "cost_of_plan" given, both on the
        finely integrated dynamics, IPOPT's "status" and "iterations".

    """
    model = library.graphs.model
    made = make_stage(model, structure, ca.vertcat(model.p, *model.inverse_symbols.values()))
    data = {name: np.asarray(value, float) for name, value in problem.items()}
    n, nodes = model.n, structure.nodes
    T, x = MX.sym("T", n, nodes), MX.sym("x", made.nx, nodes)
    slack = MX.sym("slack", data["low"].shape[0] - 2 * n, nodes)
    cost, rows, bounds = _pose_problem(made, data, T, x, slack)
    z = ca.vertcat(ca.vec(T), ca.vec(x), ca.vec(slack))
    silent: Any = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8, "max_iter": 300, "mu_strategy": "adaptive"},
    }
    nlp: Any = {"x": z, "f": cost, "g": rows}
    solver: Any = ca.nlpsol("truth", "ipopt", nlp, silent)
    plan = data["T"].reshape(nodes, n)
    states = _roll_out(made, data, plan)
    begun = np.concatenate([plan.ravel(), states.ravel(), np.zeros(slack.numel())])
    least = np.concatenate([np.full(n * nodes + states.size, -np.inf), np.zeros(slack.numel())])
    found = solver(x0=begun, lbg=bounds[0], ubg=bounds[1], lbx=least, ubx=np.inf)
    torques = np.array(found["x"]).ravel()[: n * nodes].reshape(nodes, n)
    price = ca.Function("price", [z], [cost, rows])
    return {
        "T": torques.tolist(),
        "cost": _price_plan(price, made, data, torques, np.asarray(bounds)),
        "cost_of_plan": _price_plan(price, made, data, plan, np.asarray(bounds)),
        "status": str(solver.stats()["return_status"]),
        "iterations": int(solver.stats()["iter_count"]),
    }


def _roll_out(made: Stage, data: Mapping[str, Any], plan: Any) -> Any:
    """States of a plan (nodes × nx)."""
    step, at, out = _make_integrator(made), data["x"], []
    for k in range(made.structure.nodes):
        at = np.array(step(at, plan[k], data["force"] * data["fading"][k], data["shared"], data["grid"][k])).ravel()
        out.append(at)
    return np.array(out)


def _price_plan(price: Any, made: Stage, data: Mapping[str, Any], plan: Any, bounds: Any) -> float:
    """Cost of a plan rolled out, with the slacks that it needs."""
    n, nx, nodes = made.model.n, made.nx, made.structure.nodes
    soft = data["low"].shape[0] - 2 * n
    known = np.concatenate([plan.ravel(), _roll_out(made, data, plan).ravel()])
    rows = np.array(price(np.concatenate([known, np.zeros(soft * nodes)]))[1]).reshape(nodes, -1)[:, nx + 2 * n :]
    low, high = (bound.reshape(nodes, -1)[:, nx + 2 * n :] for bound in bounds)
    needed = np.maximum(0.0, np.maximum(rows[:, :soft] - high[:, :soft], low[:, soft:] - rows[:, soft:]))
    return float(price(np.concatenate([known, needed.ravel()]))[0])


def _pose_problem(made: Stage, data: Mapping[str, Any], T: Any, x: Any, slack: Any) -> tuple[Any, Any, tuple[Any, Any]]:
    """Cost, rows and their bounds; soft rows stand twice, less and plus their slack."""
    n, nodes, simple = made.model.n, made.structure.nodes, [int(k) for k in data["simple"]]
    shared, before, at = MX(data["shared"]), MX(data["before"]), MX(data["x"])
    cost, rows, low, high = MX(0), list[Any](), list[Any](), list[Any]()
    spans = [data["period"][0], *data["grid"]]  # s, since the torque before
    step = _make_integrator(made)
    for k in range(nodes):
        force = MX(data["force"] * data["fading"][k])
        gap = x[:, k] - step(at, T[:, k], force, shared, float(data["grid"][k]))
        at = x[:, k]
        y, _, g, _ = made.output_graph(at, shared)
        last = int(k == nodes - 1)
        off = _find_distances(made, y, data["goal"][k], data["orientation"][k])
        cost += 0.5 * ca.dot(data["weights"][last], off**2)
        cost += 0.5 * ca.dot(data["torque_weight"], (T[:, k] - data["hold"]) ** 2)
        cost += 0.5 * ca.dot(data["rate_weight"], (T[:, k] - before) ** 2)
        soft, s = ca.vertcat(*(at[i] for i in simple), g), slack[:, k]
        cost += ca.dot(data["linear"][2 * n :], s) + 0.5 * ca.dot(data["square"][2 * n :], s**2)
        span = float(spans[k])
        share = np.concatenate([np.ones(n), np.full(n, span)])
        rows += [gap, T[:, k], T[:, k] - before, soft - s, soft + s]
        free, still = np.full(soft.numel(), np.inf), np.zeros(made.nx)
        low += [still, share * data["low"][: 2 * n], -free, _restore_infinities(data["low"][2 * n :])]
        high += [still, share * data["high"][: 2 * n], _restore_infinities(data["high"][2 * n :]), free]
        before = T[:, k]
    return cost, ca.vertcat(*rows), (np.concatenate(low), np.concatenate(high))


def _find_distances(made: Stage, y: Any, goal: Any, seen: Any) -> Any:
    """Outputs less their goal; of a turn the rotation vector between both orientations, of which the goal is told from
    the one that the controller saw."""
    off, axes = y[: made.ny] - goal, made.axes
    if axes.follows_pose:
        turns = slice(axes.positions, axes.count)
        wanted = make_rotation_matrix(SX(goal[turns])) @ SX(ca.reshape(ca.DM(seen), 3, 3))
        off[turns] = _turn_between(ca.DM(ca.evalf(wanted)))(y[made.ny :])
    return off


def _turn_between(wanted: Any) -> ca.Function:
    """The rotation vector from an orientation, column by column, to where it is looked at from the wanted one."""
    R = SX.sym("R", 9)
    return ca.Function("turn", [R], [find_rotation_vector(ca.reshape(R, 3, 3) @ wanted.T)])


def _restore_infinities(bound: Any) -> Any:
    return np.where(np.abs(bound) > 1e19, np.sign(bound) * np.inf, bound)


def _make_integrator(made: Stage) -> ca.Function:
    """A node by small steps of RK4, in the controller's units."""
    x, T, F = SX.sym("x", made.nx), SX.sym("T", made.model.n), SX.sym("F", len(made.model.u_slots) - made.model.n)
    shared, duration = SX.sym("shared", made.shared_offsets["end"]), SX.sym("h")
    half, h, at = made.nx // 2, duration / STEPS_PER_NODE, x

    def rate(at: Any) -> Any:
        return ca.vertcat(VELOCITY_UNIT * at[half:], made.rate(at, T, F, shared)[0])

    for _ in range(STEPS_PER_NODE):
        k1 = rate(at)
        k2 = rate(at + 0.5 * h * k1)
        k3 = rate(at + 0.5 * h * k2)
        k4 = rate(at + h * k3)
        at = at + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("node", [x, T, F, shared, duration], [at], {"cse": True})
