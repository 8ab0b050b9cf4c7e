"""Quadratic problems of the predictive controller's form: random ones, and their dense form for independent solvers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy import sparse

Floats = NDArray[np.float64]
FREE = 1e20


@dataclass(frozen=True)
class Sizes:
    """n joints, nx states, N nodes, general rows; entries of the state with limits of their own."""

    n: int
    nx: int
    nodes: int
    general: int
    simple: tuple[int, ...]

    @property
    def rows(self) -> int:
        return 2 * self.n + len(self.simple) + self.general

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The arrays of hda_mpc_qp.h in order; matrices hold columns in their last but one axis."""
        n, nx, k, rows = self.n, self.nx, self.nodes, self.rows
        return {
            "first": (nx,), "A": (k, nx, nx), "B": (k, n, nx), "b": (k, nx), "H": (k, nx, nx), "h": (k, nx),
            "R": (k, n), "r": (k, n), "D": (k, n), "d": (k, n), "G": (k, self.general, nx),
            "low": (k, rows), "high": (k, rows), "linear": (k, rows), "square": (k, rows),
        }  # fmt: skip

    def split(self, problem: Floats) -> dict[str, Floats]:
        """Views of a flat problem."""
        out, at = {}, 0
        for name, shape in self.shapes.items():
            size = int(np.prod(shape))
            out[name], at = problem[at : at + size].reshape(shape), at + size
        assert at == problem.size
        return out


def random_problem(sizes: Sizes, rng: np.random.Generator) -> Floats:
    """A convex problem with stable dynamics and rows of all kinds."""
    problem = np.zeros(sum(int(np.prod(shape)) for shape in sizes.shapes.values()))
    q, n, nx = sizes.split(problem), sizes.n, sizes.nx
    q["first"][:] = rng.normal(size=nx)
    for k in range(sizes.nodes):
        A = rng.normal(size=(nx, nx))
        q["A"][k] = A * rng.uniform(0.5, 1.0) / np.abs(np.linalg.eigvals(A)).max()
        F = rng.normal(size=(nx, rng.integers(1, nx + 1)))
        q["H"][k] = F @ F.T
    for name, scale in (("B", 1.0), ("b", 0.1), ("h", 3.0), ("r", 1.0), ("d", 0.1), ("G", 1.0)):
        q[name][:] = scale * rng.normal(size=q[name].shape)
    q["R"][:], q["D"][:] = rng.uniform(0.05, 1, q["R"].shape), rng.uniform(0, 1, q["D"].shape)
    width = rng.uniform(0.5, 3, q["low"].shape)
    q["low"][:], q["high"][:] = -width, width
    q["low"][:, -(sizes.general - n) :] = -2 * FREE
    q["linear"][:], hard = 10 ** rng.uniform(-1, 2, q["linear"].shape), slice(0, 2 * n)
    q["square"][:] = 10 ** rng.uniform(-2, 2, q["square"].shape)
    q["linear"][:, hard], q["square"][:, hard] = 10 * FREE, 0.0
    return problem


def condensed(sizes: Sizes, q: dict[str, Floats]) -> tuple[Floats, Floats, Floats, Floats]:
    """P, g of the cost in all torques, and the rows as M T + o."""
    n, nx, count = sizes.n, sizes.nx, sizes.nodes * sizes.n
    x, S, P, g = q["first"].copy(), np.zeros((nx, count)), np.zeros((count, count)), np.zeros(count)
    M, o = [], []
    for k in range(sizes.nodes):
        A, B = q["A"][k].T, q["B"][k].T
        S = A @ S
        S[:, k * n : (k + 1) * n] += B
        x = A @ x + q["b"][k]
        own = np.zeros((n, count))
        own[:, k * n : (k + 1) * n] = np.eye(n)
        change = own.copy()
        if k:
            change[:, (k - 1) * n : k * n] = -np.eye(n)
        P += S.T @ q["H"][k] @ S + own.T @ np.diag(q["R"][k]) @ own + change.T @ np.diag(q["D"][k]) @ change
        g += S.T @ (q["H"][k] @ x + q["h"][k]) + own.T @ q["r"][k] + change.T @ q["d"][k]
        M.append(np.vstack([own, change, S[list(sizes.simple)], q["G"][k] @ S]))
        o.append(np.concatenate([np.zeros(2 * n), x[list(sizes.simple)], q["G"][k] @ x]))
    return P, g, np.array(M), np.array(o)


def by_osqp(
    sizes: Sizes, problem: Floats, tolerance: float = 1e-9, relative: bool = True, more: float = 1.0
) -> Floats | None:
    """Torques (nodes, n) of the installed OSQP on the condensed problem; None where it does not report SOLVED.

    ``relative``: with the tolerance relative to the largest terms too; a penalty of thousands then makes it a lax one.
    ``more``: factor on all cost, which moves no solution but what the tolerance means.
    """
    q = sizes.split(problem)
    P, g, M, o = condensed(sizes, q)
    hard = q["linear"] >= FREE
    count, soft = len(g), int((~hard).sum())
    low = np.where(q["low"] < -FREE, -np.inf, q["low"]) - o
    high = np.where(q["high"] > FREE, np.inf, q["high"]) - o
    A: Any = sparse.bmat(
        [
            [sparse.csc_matrix(M[hard]), None],
            [sparse.csc_matrix(M[~hard]), -sparse.eye(soft)],
            [sparse.csc_matrix(M[~hard]), sparse.eye(soft)],
            [None, sparse.eye(soft)],
        ]
    )
    free = np.full(soft, np.inf)
    lower, upper = (
        np.concatenate([low[hard], -free, low[~hard], np.zeros(soft)]),
        np.concatenate([high[hard], high[~hard], free, free]),
    )
    cost = sparse.triu(sparse.block_diag([P, sparse.diags(q["square"][~hard])]), format="csc")
    solver = osqp.OSQP()
    settings = {"eps_abs": tolerance, "eps_rel": tolerance * relative, "max_iter": 100_000, "verbose": False}
    linear = np.concatenate([g, q["linear"][~hard]])
    solver.setup(more * cost, more * linear, A.tocsc(), lower, upper, check_dualgap=False, **settings)
    found = solver.solve(raise_error=False)
    return None if found.info.status_val != 1 else np.array(found.x[:count]).reshape(-1, sizes.n)


def price(sizes: Sizes, problem: Floats, T: Floats) -> float:
    """Cost of torques, penalties included."""
    q = sizes.split(problem)
    P, g, M, o = condensed(sizes, q)
    t = T.ravel()
    r = np.einsum("kij,j->ki", M, t) + o
    over = np.maximum(0, np.maximum(r - q["high"], q["low"] - r)) * (q["linear"] < FREE)
    return float(0.5 * t @ P @ t + g @ t + np.sum(np.minimum(q["linear"], FREE) * over + 0.5 * q["square"] * over**2))


def by_daqp(sizes: Sizes, problem: Floats) -> Floats | None:
    """Torques (nodes, n) of DAQP, a dual active set, on the condensed problem; None where it does not finish."""
    import daqp

    q = sizes.split(problem)
    P, g, M, o = condensed(sizes, q)
    hard = q["linear"] >= FREE
    count, soft, none = len(g), int((~hard).sum()), 1e30
    low, high = np.where(q["low"] < -FREE, -none, q["low"] - o), np.where(q["high"] > FREE, none, q["high"] - o)
    cost = np.block([[P, np.zeros((count, soft))], [np.zeros((soft, count)), np.diag(q["square"][~hard])]])
    eye, free = np.eye(soft), np.full(soft, none)
    rows = np.block([[M[hard], np.zeros((int(hard.sum()), soft))], [M[~hard], -eye], [M[~hard], eye]])
    lower = np.concatenate([np.full(count, -none), np.zeros(soft), low[hard], -free, low[~hard]])
    upper = np.concatenate([np.full(count + soft, none), high[hard], high[~hard], free])
    linear = np.concatenate([g, q["linear"][~hard]])
    tolerances = {"primal_tol": 1e-10, "dual_tol": 1e-10, "iter_limit": 20_000}
    x, _, flag, _ = daqp.solve(cost, linear, rows, upper, lower, np.zeros(len(upper), np.int32), **tolerances)
    return x[:count].reshape(-1, sizes.n) if flag == 1 else None
