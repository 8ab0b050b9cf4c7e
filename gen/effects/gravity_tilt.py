"""The base is not level. Legend: t_x, t_y gravity that comes into the plane by it, m/s²."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_gravity(s: Signals, p: Mapping[str, Any]) -> Any:
    """(t_x, t_y), added to gravity."""
    return p["tilt_x"], p["tilt_y"]


EFFECT = Effect(
    name="gravity_tilt",
    port=Port.BASE,
    parameters=(
        Parameter(
            "tilt_x",
            "m/s²",
            0.0,
            -10.0,
            10.0,
            "gravity along x of the base frame besides the stated one",
            typical=0.85,
            equivalent="gravity_x",
        ),
        Parameter(
            "tilt_y",
            "m/s²",
            0.0,
            -10.0,
            10.0,
            "gravity along y of the base frame besides the stated one",
            typical=0.85,
            equivalent="gravity_y",
        ),
    ),
    amplitudes=("tilt_x", "tilt_y"),
    equation=compute_gravity,
    citation="Lagrangian of the chain (`gen.model.lagrangian`); size: 5° of 9.81 m/s²",
    joints="arm",
    suits_joint_in_space=False,
    experiment=Experiment(
        "hold still at several poses across the range", "follows the pose's lever about an upright axis, too"
    ),
    confusion_groups=(
        ConfusionGroup.POSE,
        ConfusionGroup.RANGE_END,
    ),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE),
)
