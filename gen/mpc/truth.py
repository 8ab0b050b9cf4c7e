"""The truth beside a tick: the whole nonlinear problem, converged by IPOPT, with the dynamics integrated finely.

Nothing of the compiled controller is in it but the graphs that it was made from: every node is integrated by RK4 in small
steps, so that the error of the exponential step is measured too. Limits are soft with the same exact penalty (slacks),
inputs hard. Source: Wächter, Biegler, Math. Program. 106 (2006) 25.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from gen.library import Library
from gen.mpc.stage import SPEED, Stage, stage
from gen.mpc.structure import Structure

MX = ca.MX
FINE = 5e-4  # s, of the integration


def truth(library: Library, structure: Structure, problem: Mapping[str, Any]) -> dict[str, Any]:
    """The converged plan of a problem: torques (nodes × n, in the controller's units), cost of it and of the ``plan`` that
    is given, both on the finely integrated dynamics, and IPOPT's status.

    ``problem``: x (first state), T (torques, the starting guess and the plan to compare), before, shared, force, goal
    (nodes × outputs), weights (2 × outputs: all nodes, last), torque_weight, rate_weight, hold, low, high (rows), linear,
    square (rows), grid, period, simple, fading; all in the controller's units.
    """
    model = library.graphs.model
    made = stage(model, structure, ca.vertcat(model.p, *model.inverse.values()))
    data = {name: np.asarray(value, float) for name, value in problem.items()}
    n, nodes = model.n, structure.nodes
    T, slack = MX.sym("T", n, nodes), MX.sym("slack", data["low"].shape[0] - 2 * n, nodes)
    cost, rows, bounds = _problem(made, data, T, slack)
    z = ca.vertcat(ca.vec(T), ca.vec(slack))
    nlp = {"x": z, "f": cost, "g": rows}
    silent = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 500}}
    solver = ca.nlpsol("truth", "ipopt", nlp, silent)
    plan = np.asarray(data["T"], float).reshape(nodes, n).T
    begun = np.concatenate([plan.T.ravel(), np.zeros(slack.numel())])
    most = np.concatenate([np.full(n * nodes, np.inf), np.full(slack.numel(), np.inf)])
    least = np.concatenate([np.full(n * nodes, -np.inf), np.zeros(slack.numel())])
    found = solver(x0=begun, lbg=bounds[0], ubg=bounds[1], lbx=least, ubx=most)
    torques = np.array(found["x"]).ravel()[: n * nodes].reshape(nodes, n)
    price = ca.Function("price", [z], [cost, rows])
    return {
        "T": torques.tolist(),
        "cost": float(found["f"]),
        "cost_of_plan": _priced(price, begun, np.asarray(bounds), n, slack.shape),
        "status": str(solver.stats()["return_status"]),
        "iterations": int(solver.stats()["iter_count"]),
    }


def _priced(price: Any, begun: Any, bounds: Any, n: int, shape: tuple[int, int]) -> float:
    """Cost of a plan with the slacks that it needs."""
    count, soft = begun.size - shape[0] * shape[1], shape[0]
    rows = np.array(price(begun)[1]).reshape(shape[1], -1)
    low, high = bounds[0].reshape(rows.shape), bounds[1].reshape(rows.shape)
    own = rows[:, 2 * n :]
    upper, lower = own[:, :soft] - high[:, 2 * n : 2 * n + soft], low[:, 2 * n + soft :] - own[:, soft:]
    needed = np.maximum(0.0, np.maximum(upper, lower))
    return float(price(np.concatenate([begun[:count], needed.ravel()]))[0])


def _problem(made: Stage, data: Mapping[str, Any], T: Any, slack: Any) -> tuple[Any, Any, tuple[Any, Any]]:
    """Cost, rows and their bounds; soft rows stand twice, less and plus their slack."""
    n, nodes, simple = made.model.n, made.structure.nodes, [int(k) for k in data["simple"]]
    shared, x, before = MX(data["shared"]), MX(data["x"]), MX(data["before"])
    cost, rows, low, high = MX(0), [], [], []
    step = _step(made)
    for k in range(nodes):
        duration = float(data["grid"][k])
        force = MX(data["force"] * data["fading"][k])
        parts = max(1, round(duration / FINE))
        for _ in range(parts):
            x = step(x, T[:, k], force, shared, duration / parts)
        y, _, g, _ = made.look(x, shared)
        last = int(k == nodes - 1)
        cost += 0.5 * ca.sum1(data["weights"][last] * (y - data["goal"][k]) ** 2)
        cost += 0.5 * ca.sum1(data["torque_weight"] * (T[:, k] - data["hold"]) ** 2)
        cost += 0.5 * ca.sum1(data["rate_weight"] * (T[:, k] - before) ** 2)
        soft = ca.vertcat(*(x[i] for i in simple), g)
        s = slack[:, k]
        cost += ca.dot(data["linear"][2 * n :], s) + 0.5 * ca.sum1(data["square"][2 * n :] * s**2)
        span = float(data["grid"][k - 1]) if k else float(data["period"][0])
        share = np.concatenate([np.ones(n), np.full(n, span)])
        rows += [T[:, k], T[:, k] - before, soft - s, soft + s]
        free = np.full(soft.numel(), np.inf)
        low += [share * data["low"][: 2 * n], -free, _finite(data["low"][2 * n :])]
        high += [share * data["high"][: 2 * n], _finite(data["high"][2 * n :]), free]
        before = T[:, k]
    return cost, ca.vertcat(*rows), (np.concatenate(low), np.concatenate(high))


def _finite(bound: Any) -> Any:
    return np.where(np.abs(bound) > 1e19, np.sign(bound) * np.inf, bound)


def _step(made: Stage) -> ca.Function:
    """One small step of RK4, in the controller's units."""
    x, T, F = MX.sym("x", made.nx), MX.sym("T", made.model.n), MX.sym("F", 2)
    shared, h = MX.sym("shared", made.places["end"]), MX.sym("h")
    half = made.nx // 2

    def rate(at: Any) -> Any:
        return ca.vertcat(SPEED * at[half:], made.rate(at, T, F, shared)[0])

    k1 = rate(x)
    k2 = rate(x + 0.5 * h * k1)
    k3 = rate(x + 0.5 * h * k2)
    k4 = rate(x + h * k3)
    return ca.Function("step", [x, T, F, shared, h], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
