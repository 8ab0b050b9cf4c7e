"""A mass at the tip. Legend: m_p mass, kg; in space x, y, z its centre in the tip's frame, m, where the inertia about
that centre counts as the link's."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals

MASS = Parameter("payload_mass", "kg", 0.0, 0.0, 100.0, "point mass at the tip", typical=0.3)


def compute_tip_mass(s: Signals, p: Mapping[str, Any]) -> Any:
    """m_p, a point at the end of the last link; in space at (x, y, z)."""
    return p["payload_mass"]


def compute_placed_mass(s: Signals, p: Mapping[str, Any]) -> Any:
    """(m_p, x, y, z), a point."""
    return p["payload_mass"], p["payload_x"], p["payload_y"], p["payload_z"]


def _center_along(axis: str) -> Parameter:
    meaning = f"centre of the payload from the tip along the tip's {axis}"
    return Parameter(f"payload_{axis}", "m", 0.0, -2.0, 2.0, meaning, starts=(0.0,), search_unit=0.05)


PLANE_FORM = Effect(
    name="payload",
    port=Port.MASS,
    parameters=(MASS,),
    amplitudes=("payload_mass",),
    equation=compute_tip_mass,
    citation="Lagrangian of the chain with a point mass at the tip; size: a small gripper, 0.3 kg",
    joints="last",
    experiment=Experiment("swap a known payload", "changes weight and inertia together"),
    confusion_groups=(
        ConfusionGroup.GAIN_OR_MASS,
        ConfusionGroup.POSE,
    ),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ACCELERATION),
)
EFFECT = replace(
    PLANE_FORM,
    space_form=replace(PLANE_FORM, parameters=(MASS, *map(_center_along, "xyz")), equation=compute_placed_mass),
)
