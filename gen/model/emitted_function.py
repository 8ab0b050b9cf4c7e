"""A function to emit: dense column vectors in, dense column vectors out (matrices column by column), so that one
signature, `void hda_<name>(const double *in…, double *out…)`, serves C, Python and the interpreter alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

SX = ca.SX


@dataclass(frozen=True)
class EmittedFunction:
    """A function to emit: the graph, and its purpose in words."""

    graph: ca.Function
    meaning: str

    @property
    def name(self) -> str:
        """The name without prefix."""
        return str(self.graph.name())

    @property
    def inputs(self) -> tuple[tuple[str, int], ...]:
        """Names and lengths of the inputs."""
        return tuple((self.graph.name_in(k), self.graph.numel_in(k)) for k in range(self.graph.n_in()))

    @property
    def outputs(self) -> tuple[tuple[str, int], ...]:
        """Names and lengths of the outputs."""
        return tuple((self.graph.name_out(k), self.graph.numel_out(k)) for k in range(self.graph.n_out()))


def make_dense_function(name: str, inputs: dict[str, Any], outputs: dict[str, Any]) -> ca.Function:
    """Make a Function of dense column vectors.

    Args:
        name: The function's name.
        inputs: Symbols by name.
        outputs: Expressions by name; matrices are stacked column by column.

    Returns:
        The Function, with common subexpressions computed once.

    """
    return ca.Function(
        name,
        list(inputs.values()),
        [ca.vec(ca.densify(SX(value))) for value in outputs.values()],
        list(inputs),
        list(outputs),
        {"cse": True},
    )
