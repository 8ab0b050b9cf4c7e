"""The base is not level. Legend: in the plane t_x, t_y gravity that comes into it by the tilt, m/s². In space R, the
turn of the base by its roll, then by its pitch, rad, about two level axes: the level part of x of the base (of y,
where x is within 37° of upright), and the one across it. Where gravity points along −z these are x and y."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals

USUAL_TILT = 0.087  # rad


def compute_gravity(s: Signals, p: Mapping[str, Any]) -> Any:
    """(t_x, t_y), added to gravity; in space Rᵀ g − g."""
    return p["tilt_x"], p["tilt_y"]


def compute_turned_gravity(s: Signals, p: Mapping[str, Any]) -> Any:
    """Rᵀ g − g, added to gravity."""
    first, second = s.level_axes
    rolled = _turn_back(first, p["tilt_roll"], s.gravity)
    return rolled + _turn_back(second, p["tilt_pitch"], s.gravity + rolled)


def _turn_back(axis: Any, angle: Any, a: Any) -> Any:
    """The change of the components of a vector when their frame turns about a unit vector (Rodrigues)."""
    across = ca.cross(axis, a)
    return (1 - ca.cos(angle)) * ca.cross(axis, across) - ca.sin(angle) * across


def _tilt_angle(name: str, axis: str) -> Parameter:
    return Parameter(name, "rad", 0.0, -1.0, 1.0, f"turn of the base about its {axis} level axis", typical=USUAL_TILT)


PLANE_FORM = Effect(
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
            typical=USUAL_TILT,
            scale="gravity_x_by_tilt",
            equivalent="gravity_x",
        ),
        Parameter(
            "tilt_y",
            "m/s²",
            0.0,
            -10.0,
            10.0,
            "gravity along y of the base frame besides the stated one",
            typical=USUAL_TILT,
            scale="gravity_y_by_tilt",
            equivalent="gravity_y",
        ),
    ),
    amplitudes=("tilt_x", "tilt_y"),
    equation=compute_gravity,
    citation="Lagrangian of the chain (`gen.model.lagrangian`); size: 5°, in the plane by axis",
    joints="arm",
    experiment=Experiment(
        "hold still at several poses across the range", "follows the pose's lever about an upright axis, too"
    ),
    confusion_groups=(
        ConfusionGroup.POSE,
        ConfusionGroup.RANGE_END,
    ),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE),
)
EFFECT = replace(
    PLANE_FORM,
    space_form=replace(
        PLANE_FORM,
        parameters=(_tilt_angle("tilt_roll", "first"), _tilt_angle("tilt_pitch", "second")),
        amplitudes=("tilt_roll", "tilt_pitch"),
        equation=compute_turned_gravity,
        citation="Rodrigues' rotation, Featherstone (2008), ch. 2; size: 5°",
        needs_gravity=True,
    ),
)
