"""Viscous friction. Legend: r_m coefficient, N m s/rad; θ̇ motor speed."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Port, Signals


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """−r_m θ̇."""
    return -p["viscous_friction"] * s.motor_velocity


EFFECT = Effect(
    name="viscous_friction",
    port=Port.MOTOR,
    parameters=(),
    amplitudes=("viscous_friction",),
    equation=compute_torque,
    citation="paper (18); size: grease at 10 against 40 °C, several times as viscous, "
    "Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134 (2012) 051013",
    usual_shares={"viscous_friction": 2.0},
    experiment=Experiment("run at several constant speeds both ways", "grows in proportion to speed"),
    confusion_groups=(
        ConfusionGroup.GAIN_OR_MASS,
        ConfusionGroup.FRICTION_BY_SPEED,
    ),
    plot=Plot(PlotKind.FRICTION, Abscissa.MOTOR_SPEED),
    is_friction=True,
)
