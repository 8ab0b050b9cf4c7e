"""Dry friction that changes over the joint's range. Legend: a, b sine and cosine amplitude, N m at the motor; q
joint angle."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_friction_level(s: Signals, p: Mapping[str, Any]) -> Any:
    """a sin q + b cos q."""
    return p["position_sine"] * ca.sin(s.joint_position) + p["position_cosine"] * ca.cos(s.joint_position)


EFFECT = Effect(
    name="position_dependent_friction",
    port=Port.FRICTION,
    parameters=(
        Parameter(
            "position_sine",
            "N m",
            0.0,
            -50.0,
            50.0,
            "dry friction that goes once a turn of the joint",
            typical=0.2,
            scale="coulomb_friction",
        ),
        Parameter(
            "position_cosine",
            "N m",
            0.0,
            -50.0,
            50.0,
            "dry friction that goes once a turn of the joint",
            typical=0.2,
            scale="coulomb_friction",
        ),
    ),
    amplitudes=("position_sine", "position_cosine"),
    equation=compute_friction_level,
    citation="Popović, Goldenberg, IEEE Trans. Robot. Autom. 14 (1998) 114, friction by position, with its size",
    suits_prismatic_joint=False,
    experiment=Experiment(
        "creep through the whole range both ways", "varies with the angle and changes its sign with the direction"
    ),
    confusion_groups=(
        ConfusionGroup.FRICTION_BY_CONDITION,
        ConfusionGroup.RANGE_END,
    ),
    plot=Plot(PlotKind.FRICTION_BEYOND_BASE, Abscissa.JOINT_ANGLE),
    is_friction=True,
)
