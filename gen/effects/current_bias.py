"""A constant offset of the current or force. Legend: b torque at the motor, N m."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """b."""
    return p["bias"]


EFFECT = Effect(
    name="current_bias",
    port=Port.MOTOR,
    parameters=(
        Parameter(
            "bias", "N m", 0.0, -50.0, 50.0, "constant torque added at the motor", typical=0.2, scale="coulomb_friction"
        ),
    ),
    amplitudes=("bias",),
    equation=compute_torque,
    citation="Janot, Gautier, Brunot, Data set and reference models of EMPS (2019), offset of the measured "
    "force, with its size",
    experiment=Experiment("hold still in one pose, reached from both sides", "adds the same at rest as in motion"),
    confusion_groups=(ConfusionGroup.BIAS_OR_DIRECTION,),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.MOTOR_SPEED),
)
