"""Symmetric positive definite matrices: equations and inverses, unrolled as expressions."""

from __future__ import annotations

from typing import Any

import casadi as ca

SX = ca.SX


def solve_symmetric(M: Any, b: Any) -> Any:
    """Solve M a = b by the factors L D Lᵀ, unrolled.

    Args:
        M: Symmetric positive definite matrix (n × n).
        b: Right-hand sides (n × k).

    Returns:
        The solutions a (n × k).

    """
    n = M.shape[0]
    L, D = SX.eye(n), [SX(0)] * n
    for j in range(n):
        D[j] = M[j, j] - sum(L[j, k] * L[j, k] * D[k] for k in range(j))
        for i in range(j + 1, n):
            L[i, j] = (M[i, j] - sum(L[i, k] * L[j, k] * D[k] for k in range(j))) / D[j]
    columns = []
    for column in range(b.shape[1]):
        y: list[Any] = []
        for i in range(n):
            y.append(b[i, column] - sum(L[i, k] * y[k] for k in range(i)))
        a: list[Any] = [None] * n
        for i in reversed(range(n)):
            a[i] = y[i] / D[i] - sum(L[k, i] * a[k] for k in range(i + 1, n))
        columns.append(ca.vertcat(*a))
    return ca.horzcat(*columns)


def invert_symmetric(M: Any) -> Any:
    """Invert a matrix by the factors L D Lᵀ, unrolled.

    Args:
        M: Symmetric positive definite matrix (n × n).

    Returns:
        The inverse (n × n).

    """
    n = M.shape[0]
    columns = solve_symmetric(M, SX.eye(n))
    upper = [[columns[min(i, k), max(i, k)] for k in range(n)] for i in range(n)]
    return ca.vertcat(*(ca.horzcat(*row) for row in upper))
