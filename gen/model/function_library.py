"""The whole content of a library: the model's functions, the torque estimate and the controllers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen.model import torque_estimate
from gen.model.arm_model import Model, solve_symmetric
from gen.model.compliance_laws import Law, laws
from gen.model.emitted_function import Emitted, dense
from gen.model.right_hand_side import Graphs, assemble

SX = ca.SX


@dataclass(frozen=True)
class Library:
    """The graphs of a model, every function to emit, and the controllers among them."""

    graphs: Graphs
    functions: tuple[Emitted, ...]
    laws: tuple[Law, ...]


def library(model: Model) -> Library:
    """Write the library of a model.

    Args:
        model: The model.

    Returns:
        Its graphs, its functions and its controllers.

    """
    graphs = assemble(model)
    controllers = laws(model, graphs.c)
    ticks = tuple(f for law in controllers for f in (law.start, law.tick))
    own = (_torque_estimate(model, graphs.c), _force_map(model, graphs.c))
    return Library(graphs, (*graphs.functions, *own, *ticks), controllers)


def _torque_estimate(model: Model, c: Any) -> Emitted:
    names = ("motor_position", "joint_position", "motor_velocity", "motor_acceleration", "motor_torque")
    ins = {name: SX.sym(name, model.n) for name in names}
    theta, q, omega, alpha, torque = ins.values()
    found = torque_estimate.estimates(model, theta, q, omega, alpha, torque)
    return Emitted(dense("torque_estimate", {**ins, "c": c}, found), "joint torque from torsion, N m: three estimates")


def _force_map(model: Model, c: Any) -> Emitted:
    """(JJᵀ)⁻¹ J N, by rows: the map to the force that the guard limits.

    Near singular poses it grows without bound, and so does that force.
    """
    q = SX.sym("q", model.n)
    J = model.chain.jacobian(q, model.chain_parameters())
    square = J @ J.T + 1e-12 * SX.eye(2)
    ratios = ca.diag(ca.vertcat(*(model.of_joint(j)["ratio"] for j in model.joints)))
    columns = [solve_symmetric(square, (J @ ratios)[:, j]) for j in range(model.n)]
    return Emitted(
        dense("force_map", {"q": q, "c": c}, {"map": ca.horzcat(*columns).T}),
        "static force at the tip by motor torque, N/(N m), row by row",
    )
