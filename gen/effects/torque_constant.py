"""Torque per unit of input. Legend: k_t N m/A, or a gain where the input is torque; i input."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """k_t i."""
    if "torque_constant" in p:
        return p["torque_constant"] * s.current
    return p["torque_gain"] * s.current


EFFECT = Effect(
    name="torque_constant",
    port=Port.MOTOR,
    parameters=(
        Parameter(
            "torque_gain",
            "1",
            1.0,
            0.0,
            3.0,
            "torque that acts by torque that is commanded",
            typical=0.15,
            unless="torque_constant",
        ),
    ),
    amplitudes=("torque_constant", "torque_gain"),
    equation=compute_torque,
    citation="paper, Table II; size: data sheets give ±10 % at 25 °C and magnets lose 0.1 to 0.2 %/K (maxon, Key "
    "information (2021))",
    usual_shares={"torque_constant": 0.15},
    experiment=Experiment("hold several known payloads still", "errs in proportion to the current, at rest as well"),
    confusion_groups=(
        ConfusionGroup.GAIN_OR_MASS,
        ConfusionGroup.ANGLE_ERROR,
    ),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.MOTOR_INPUT),
)
