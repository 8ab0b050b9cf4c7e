"""Dry friction that depends on the direction. Legend: a half the difference of the two levels, N m; s direction."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_friction_level(s: Signals, p: Mapping[str, Any]) -> Any:
    """a s: more in one direction, less in the other, and as before at rest."""
    return p["asymmetric_torque"] * s.direction


EFFECT = Effect(
    name="asymmetric_friction",
    port=Port.FRICTION,
    parameters=(
        Parameter(
            "asymmetric_torque",
            "N m",
            0.0,
            -50.0,
            50.0,
            "half the difference between dry friction forwards and backwards",
            typical=0.25,
            scale="coulomb_friction",
        ),
    ),
    amplitudes=("asymmetric_torque",),
    equation=compute_friction_level,
    citation="Armstrong-Hélouvry, Control of Machines with Friction (1991), 4: a quarter apart in the joints of a "
    "PUMA 560",
    experiment=Experiment("repeat one motion in both directions", "differs between them and is nothing at rest"),
    confusion_groups=(
        ConfusionGroup.BIAS_OR_DIRECTION,
        ConfusionGroup.FRICTION_BY_CONDITION,
        ConfusionGroup.FRICTION_BY_SPEED,
    ),
    plot=Plot(PlotKind.FRICTION, Abscissa.MOTOR_SPEED),
    is_friction=True,
    presupposes="coulomb_friction",
    twins=("current_bias",),
)
