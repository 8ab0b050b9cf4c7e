"""Gravity. Legend: g_x, g_y in the base frame, m/s², in the plane of motion; in space g_z too."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Port, Signals


def compute_gravity(s: Signals, p: Mapping[str, Any]) -> Any:
    """(g_x, g_y)."""
    return p["gravity_x"], p["gravity_y"]


def compute_gravity_in_space(s: Signals, p: Mapping[str, Any]) -> Any:
    """(g_x, g_y, g_z)."""
    return p["gravity_x"], p["gravity_y"], p["gravity_z"]


PLANE_FORM = Effect(
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
EFFECT = replace(
    PLANE_FORM,
    space_form=replace(
        PLANE_FORM, amplitudes=("gravity_x", "gravity_y", "gravity_z"), equation=compute_gravity_in_space
    ),
)
