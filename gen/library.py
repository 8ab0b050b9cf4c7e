"""Everything that a library holds: the model's functions, the torque estimate and the controllers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen import torque_estimate
from gen.compliance import Law, laws
from gen.functions import Emitted, Graphs, assemble, dense
from gen.model import Model

SX = ca.SX


@dataclass(frozen=True)
class Library:
    """The graphs of a model, every function to emit, and the controllers among them."""

    graphs: Graphs
    functions: tuple[Emitted, ...]
    laws: tuple[Law, ...]


def library(model: Model) -> Library:
    """The library of a model."""
    graphs = assemble(model)
    controllers = laws(model, graphs.c)
    ticks = tuple(f for law in controllers for f in (law.start, law.tick))
    return Library(graphs, (*graphs.functions, _torque_estimate(model, graphs.c), *ticks), controllers)


def _torque_estimate(model: Model, c: Any) -> Emitted:
    names = ("motor_position", "joint_position", "motor_velocity", "motor_acceleration", "motor_torque")
    ins = {name: SX.sym(name, model.n) for name in names}
    theta, q, omega, alpha, torque = ins.values()
    found = torque_estimate.estimates(model, theta, q, omega, alpha, torque)
    return Emitted(dense("torque_estimate", {**ins, "c": c}, found), "joint torque from torsion, N m: three estimates")
