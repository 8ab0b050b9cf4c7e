"""OSQP's generated code for the sparse form of the problem, and the tables that fill its matrices.

Variables node by node: T (n), x of the next node (nx), slacks (one a soft row). Rows node by node: dynamics; T; T
less the torque before; soft rows less their slack (high); those with a low bound plus their slack; slacks. OSQP prints
its code into a folder (``codegen``, never compiled by it); its files come out flat, with names that begin with
`hda_osqp`.
Source: Stellato, Banjac, Goulart, Bemporad, Boyd, Math. Prog. Comp. 12 (2020) 637; OSQP 1.x, Apache License 2.0.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gen.mpc.horizon_stage import Stage

OSQP_PREFIX = "hda_osqp_"
UNUSED_FILES = {"emosqp.c", "Makefile"}
# (row, column) -> (offset in the problem or -1 for the number 1, sign)…
MatrixEntries = dict[tuple[int, int], tuple[tuple[int, float], ...]]


@dataclass(frozen=True)
class ProblemLayout:
    """Where the arrays of `hda_mpc_qp` begin, in doubles, and the sizes that they are made of."""

    n: int
    nx: int
    nodes: int
    simple_entries: tuple[int, ...]
    general_count: int
    has_low_bound: tuple[bool, ...]  # which soft rows have a low bound

    @property
    def soft_count(self) -> int:
        """Soft rows of a node."""
        return len(self.simple_entries) + self.general_count

    @property
    def row_count(self) -> int:
        """Rows of a node in the problem."""
        return 2 * self.n + self.soft_count

    @property
    def array_offsets(self) -> dict[str, int]:
        """Offsets of the arrays."""
        n, nx, k, rows = self.n, self.nx, self.nodes, self.row_count
        sizes = {
            "first": nx, "A": k * nx * nx, "B": k * nx * n, "b": k * nx, "H": k * nx * nx, "h": k * nx,
            "R": k * n, "r": k * n, "D": k * n, "d": k * n, "G": k * self.general_count * nx,
            "low": k * rows, "high": k * rows, "linear": k * rows, "square": k * rows,
        }  # fmt: skip
        ends = np.cumsum([0, *sizes.values()])
        return dict(zip(sizes, map(int, ends[:-1]), strict=True))

    @property
    def variables_per_node(self) -> int:
        """Variables of a node."""
        return self.n + self.nx + self.soft_count

    @property
    def constraints_per_node(self) -> int:
        """Constraints of a node."""
        return self.nx + 2 * self.n + self.soft_count + sum(self.has_low_bound) + self.soft_count


def make_layout(made: Stage, simple: list[int]) -> ProblemLayout:
    """The layout of a stage's problem."""
    flexible = len(made.model.flexible)
    lower = (True,) * (len(simple) + flexible) + (False,) * (made.ng - flexible)
    return ProblemLayout(made.model.n, made.nx, made.structure.nodes, tuple(simple), made.ng, lower)


def cost_entries(at: ProblemLayout) -> MatrixEntries:
    """Upper triangle of P."""
    n, nx, start, out = at.n, at.nx, at.array_offsets, MatrixEntries()
    for k in range(at.nodes):
        base = k * at.variables_per_node
        for j in range(n):
            parts = [(start["R"] + k * n + j, 1.0), (start["D"] + k * n + j, 1.0)]
            if k + 1 < at.nodes:
                parts.append((start["D"] + (k + 1) * n + j, 1.0))
            out[base + j, base + j] = tuple(parts)
            if k:
                out[base - at.variables_per_node + j, base + j] = ((start["D"] + k * n + j, -1.0),)
        for j in range(nx):
            for i in range(j + 1):
                out[base + n + i, base + n + j] = ((start["H"] + (k * nx + j) * nx + i, 1.0),)
        for i in range(at.soft_count):
            place = base + n + nx + i
            out[place, place] = ((start["square"] + k * at.row_count + 2 * n + i, 1.0),)
    return out


def constraint_entries(at: ProblemLayout) -> MatrixEntries:
    """A."""
    n, nx, start, out = at.n, at.nx, at.array_offsets, MatrixEntries()
    one = ((-1, 1.0),)
    for k in range(at.nodes):
        row, base = k * at.constraints_per_node, k * at.variables_per_node
        for i in range(nx):
            out[row + i, base + n + i] = one
            if k:
                for j in range(nx):
                    out[row + i, base - at.variables_per_node + n + j] = ((start["A"] + (k * nx + j) * nx + i, -1.0),)
            for j in range(n):
                out[row + i, base + j] = ((start["B"] + (k * n + j) * nx + i, -1.0),)
        row += nx
        for j in range(n):
            out[row + j, base + j] = out[row + n + j, base + j] = one
            if k:
                out[row + n + j, base - at.variables_per_node + j] = ((-1, -1.0),)
        row += 2 * n
        for sign, chosen in (
            (-1.0, range(at.soft_count)),
            (1.0, [i for i in range(at.soft_count) if at.has_low_bound[i]]),
        ):
            for i in chosen:
                for column, entry in _row_entries(at, k, i):
                    out[row, base + n + column] = (entry,)
                out[row, base + n + nx + i] = ((-1, sign),)
                row += 1
        for i in range(at.soft_count):
            out[row + i, base + n + nx + i] = one
    return out


def _row_entries(at: ProblemLayout, k: int, i: int) -> Iterator[tuple[int, tuple[int, float]]]:
    """The columns among the states of soft row i of node k, and its entries there."""
    if i < len(at.simple_entries):
        yield at.simple_entries[i], (-1, 1.0)
        return
    begin = at.array_offsets["G"] + (k * at.general_count + i - len(at.simple_entries)) * at.nx
    for column in range(at.nx):
        yield column, (begin + column, 1.0)


def osqp_files(made: Stage, simple: list[int]) -> dict[str, str]:
    """Write the files of OSQP's generated code, and hda_mpc_osqp_tables.h.

    Args:
        made: The stage.
        simple: Entries of the state with limits of their own.

    Returns:
        The text of each file by its name.

    """
    import osqp
    from scipy import sparse

    at = make_layout(made, simple)
    P, A = cost_entries(at), constraint_entries(at)
    shape = (at.nodes * at.constraints_per_node, at.nodes * at.variables_per_node)

    def matrix(entries: MatrixEntries, rows: int, value: Any) -> Any:
        keys = sorted(entries, key=lambda key: (key[1], key[0]))
        ij = np.array(keys).T
        return keys, sparse.csc_matrix(
            (np.array([value(entries[key], *key) for key in keys]), (ij[0], ij[1])), (rows, shape[1])
        )

    # values that only mark the entries: the controller fills in its own
    p_keys, p = matrix(P, shape[1], lambda _, i, j: 2.0 if i == j else 0.01)
    a_keys, a = matrix(A, shape[0], lambda parts, _, __: parts[0][1] if parts[0][0] < 0 else 0.5 * parts[0][1])
    out: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        with _silence_output():
            solver = osqp.OSQP()
            solver.setup(p, np.zeros(shape[1]), a, -np.ones(shape[0]), np.ones(shape[0]), verbose=False,
            polishing=False,
                         check_dualgap=False, adaptive_rho=True, warm_starting=True)  # fmt: skip
            solver.codegen(
                folder,
                parameters="matrices",
                prefix=OSQP_PREFIX,
                compile=False,
                extension_name=None,
                force_rewrite=True,
            )
        for path in sorted(Path(folder).rglob("*.[ch]")):
            if path.name not in UNUSED_FILES:
                out[_flat_name(path.name)] = _flatten_includes(path.read_text(encoding="utf-8"))
    out["hda_mpc_osqp_tables.h"] = _emit_tables(at, [P[key] for key in p_keys], [A[key] for key in a_keys])
    return out


def _flat_name(name: str) -> str:
    return OSQP_PREFIX + name.removeprefix(OSQP_PREFIX)


def _flatten_includes(text: str) -> str:
    """The text with includes of OSQP's own headers by their flat names, and without the date on which it was made."""
    undated = re.sub(r"(autogenerated by OSQP) on .*", r"\1", text)
    return re.sub(r'#\s*include\s+"([\w./]+)"', lambda m: f'#include "{_flat_name(m[1].rsplit("/", 1)[-1])}"', undated)


def _emit_tables(at: ProblemLayout, p: list[Any], a: list[Any]) -> str:
    from gen.c_code.headers import add_include_guard

    def wide(parts: Any) -> str:
        offsets = [offset for offset, _ in parts] + [-2] * (3 - len(parts))
        return "{" + ", ".join(map(str, offsets)) + "}"

    lines = [
        (
            f"enum {{ P_ENTRIES = {len(p)}, A_ENTRIES = {len(a)}, WIDTH = {at.variables_per_node}, HEIGHT ="
            f" {at.constraints_per_node} }};"
        ),
        "/* offsets in the problem that add up (-2: none), and their sign */",
        f"static const int p_from[][3] = {{{', '.join(wide(parts) for parts in p)}}};",
        f"static const signed char p_sign[] = {{{', '.join(str(int(parts[0][1])) for parts in p)}}};",
        "/* offset in the problem (-1: the number 1), and its sign */",
        f"static const int a_from[] = {{{', '.join(str(parts[0][0]) for parts in a)}}};",
        f"static const signed char a_sign[] = {{{', '.join(str(int(parts[0][1])) for parts in a)}}};",
        "/* which soft rows have a low bound */",
        f"static const int has_low[] = {{{', '.join(str(int(low)) for low in at.has_low_bound)}}};",
    ]
    return add_include_guard("HDA_MPC_OSQP_TABLES_H", "How the problem fills OSQP's matrices.", "\n".join(lines) + "\n")


@contextlib.contextmanager
def _silence_output() -> Iterator[None]:
    """OSQP's banner is printed in C: the process's output goes nowhere meanwhile."""
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
