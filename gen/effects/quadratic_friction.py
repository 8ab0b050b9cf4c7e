"""Friction with the square of the speed. Legend: c coefficient, N m s²/rad²; θ̇ motor speed."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """−c θ̇ |θ̇|."""
    return -p["quadratic_friction"] * s.motor_velocity * ca.fabs(s.motor_velocity)


EFFECT = Effect(
    name="quadratic_friction",
    port=Port.MOTOR,
    parameters=(
        Parameter(
            "quadratic_friction",
            "N m s²/rad²",
            0.0,
            0.0,
            1000.0,
            "friction by the square of the motor speed",
            typical=0.3,
            scale="viscous_friction/ratio",
        ),
    ),
    amplitudes=("quadratic_friction",),
    equation=compute_torque,
    citation="Tuttle, Seering, IEEE Trans. Robot. Autom. 12 (1996) 368, friction beyond linear in speed; size: "
    "30 % of the viscous part at 1 rad/s of the joint",
    experiment=Experiment("run at constant speeds up to the fastest", "grows with the square of speed"),
    confusion_groups=(ConfusionGroup.FRICTION_BY_SPEED,),
    plot=Plot(PlotKind.FRICTION, Abscissa.MOTOR_SPEED),
    is_friction=True,
)
