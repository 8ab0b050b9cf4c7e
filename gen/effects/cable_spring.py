"""A cable or hose that pulls the joint back. Legend: k stiffness, N m/rad; q_0 angle at which it is slack."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """−k (q − q_0)."""
    return -p["cable_stiffness"] * (s.joint_position - p["cable_rest"])


EFFECT = Effect(
    name="cable_spring",
    port=Port.LINK,
    parameters=(
        Parameter("cable_stiffness", "N m/rad", 0.0, 0.0, 10000.0, "torque by joint angle", typical=3.0, sliding="N/m"),
        Parameter(
            "cable_rest",
            "rad",
            0.0,
            -10.0,
            10.0,
            "joint angle at which it does not pull",
            starts=(0.0, -1.0, 1.0),
            sliding="m",
        ),
    ),
    amplitudes=("cable_stiffness",),
    equation=compute_torque,
    citation="Siciliano et al., Robotics (2009), 7.2, an elastic force in the joint; size: a dress pack of 1 to 5 "
    "N m at one radian on an arm of 10 N m",
    experiment=Experiment("creep through the whole range both ways", "pulls the same at an angle from either side"),
    confusion_groups=(
        ConfusionGroup.POSE,
        ConfusionGroup.RANGE_END,
    ),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE),
)
