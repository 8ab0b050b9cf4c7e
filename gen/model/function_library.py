"""The whole content of a library: the model's functions, the torque estimate and the controllers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen.model import torque_estimate
from gen.model.arm_model import Model
from gen.model.compliance_laws import make_laws
from gen.model.control_loop import Law
from gen.model.emitted_function import EmittedFunction, make_dense_function
from gen.model.right_hand_side import Graphs, assemble_graphs
from gen.model.symmetric_matrices import solve_symmetric

SX = ca.SX


@dataclass(frozen=True)
class Library:
    """The graphs of a model, every function to emit, and the controllers among them."""

    graphs: Graphs
    functions: tuple[EmittedFunction, ...]
    laws: tuple[Law, ...]


def make_library(model: Model) -> Library:
    """Write the library of a model.

    Args:
        model: The model.

    Returns:
        Its graphs, its functions and its controllers.

    """
    graphs = assemble_graphs(model)
    controllers = make_laws(model, graphs.c)
    ticks = tuple(f for law in controllers for f in (law.start_function, law.tick_function))
    own = (_torque_estimate(model, graphs.c), _force_map(model, graphs.c))
    return Library(graphs, (*graphs.functions, *own, *ticks), controllers)


def _torque_estimate(model: Model, c: Any) -> EmittedFunction:
    names = ("motor_position", "joint_position", "motor_velocity", "motor_acceleration", "motor_torque")
    ins = {name: SX.sym(name, model.n) for name in names}
    theta, q, omega, alpha, torque = ins.values()
    found = torque_estimate.estimate_torques(model, theta, q, omega, alpha, torque)
    return EmittedFunction(
        make_dense_function("torque_estimate", {**ins, "c": c}, found),
        "joint torque from torsion, N m: three estimates",
    )


def _force_map(model: Model, c: Any) -> EmittedFunction:
    """(JJᵀ)⁻¹ J N, J without rotations, by rows: the map to the force that the guard limits.

    Near singular poses it grows without bound, and so does that force.
    """
    q = SX.sym("q", model.n)
    axes = len(model.chain.axes)
    J = model.chain.tip_jacobian(q, model.chain_parameters())[:axes, :]
    square = J @ J.T + 1e-12 * SX.eye(axes)
    ratios = ca.diag(ca.vertcat(*(model.joint_parameters(j)["ratio"] for j in model.joints)))
    columns = [solve_symmetric(square, (J @ ratios)[:, j]) for j in range(model.n)]
    return EmittedFunction(
        make_dense_function("force_map", {"q": q, "c": c}, {"map": ca.horzcat(*columns).T}),
        "static force at the tip by motor torque, N/(N m), row by row",
    )
