"""Gravity in the plane of motion. Legend: g_x, g_y in the base frame, m/s²."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Port, Signals


def compute_gravity(s: Signals, p: Mapping[str, Any]) -> Any:
    """(g_x, g_y)."""
    return p["gravity_x"], p["gravity_y"]


EFFECT = Effect(
    name="gravity",
    port=Port.BASE,
    parameters=(),
    amplitudes=("gravity_x", "gravity_y"),
    equation=compute_gravity,
    citation="Lagrangian of the chain (`gen.model.lagrangian`)",
    joints="arm",
    experiment=Experiment("hold still at several poses across the range", "follows the lever of the pose"),
    confusion_groups=(ConfusionGroup.POSE,),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE),
)
