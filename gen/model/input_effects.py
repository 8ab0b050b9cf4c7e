"""The input effects as a function of the command, to be emitted; `hda_input.c` runs it row by row.

The order is that of a drive's electronics: the command arrives late, is limited and sags with the supply, and the
current follows it with a lag.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from gen.effects.effect import Port, Signals
from gen.model.arm_model import Model
from gen.model.emitted_function import EmittedFunction, make_dense_function

SX = ca.SX


def emit_input_law(model: Model, c: Any) -> EmittedFunction:
    """Write the input effects: (command, c) -> current (n), its delay, s (n), time constant of its lag, s (n).

    Args:
        model: The model.
        c: The symbols of its constants.

    Returns:
        The function to emit; currents in A, or torques in N m where the robot's input is torque.

    """
    command = SX.sym("command", model.n)
    through, late, constant = [], [], []
    for j in model.joints:
        p, current = model.joint_parameters(j), command[j - 1]
        for effect in model.effects_at(Port.INPUT, j):
            current = effect.equation(Signals(current=current), p)
        through.append(current)
        late.append(sum((e.equation(Signals(), p) for e in model.effects_at(Port.DELAY, j)), SX(0)))
        constant.append(sum((e.equation(Signals(), p) for e in model.effects_at(Port.LAG, j)), SX(0)))
    made = {"current": ca.vertcat(*through), "delay": ca.vertcat(*late), "lag": ca.vertcat(*constant)}
    graph = make_dense_function("input_law", {"command": command, "c": c}, made)
    return EmittedFunction(
        graph, "what input effects let through of a command, its delay and the time constant of its lag, s"
    )
