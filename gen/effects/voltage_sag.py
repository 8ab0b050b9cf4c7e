"""Torque lost to the supply's sagging voltage. Legend: i current, A (or N m); a slope."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def reduce_current(s: Signals, p: Mapping[str, Any]) -> Any:
    """i (1 − a |i|) up to its maximum at |i| = 1/(2 a), which it keeps."""
    size = p["voltage_sag"] * ca.fabs(s.current)
    return s.current * ca.if_else(size < 0.5, 1 - size, 0.25 / ca.fmax(size, 0.5))


EFFECT = Effect(
    name="voltage_sag",
    port=Port.INPUT,
    parameters=(
        Parameter(
            "voltage_sag",
            "1/A",
            0.0,
            0.0,
            1000.0,
            "share of the current that is lost, by ampere",
            typical=0.2,
            scale="1/largest_input",
        ),
    ),
    amplitudes=("voltage_sag",),
    equation=reduce_current,
    citation="Duclusaud, Passault, Padois, Ly, Extended Friction Models for the Physics Simulation of Servo "
    "Actuators (2024); size: a fifth of the supply at full current",
    experiment=Experiment("repeat one motion faster and faster", "takes torque where speed and current are both large"),
    confusion_groups=(ConfusionGroup.COMMAND_PATH,),
    plot=Plot(PlotKind.INPUT, Abscissa.COMMAND),
)
