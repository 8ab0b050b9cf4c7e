"""Dry friction of the gear under load. Legend: μ share; τ transmitted torque (of a rigid drive N times the
motor's), N m; N ratio."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_friction_level(s: Signals, p: Mapping[str, Any]) -> Any:
    """μ |τ / N|."""
    return p["load_share"] * ca.fabs(s.joint_torque / s.ratio)


EFFECT = Effect(
    name="load_dependent_friction",
    port=Port.FRICTION,
    parameters=(
        Parameter(
            "load_share", "1", 0.0, 0.0, 1.0, "dry friction at the motor by the torque that it transmits", typical=0.2
        ),
    ),
    amplitudes=("load_share",),
    equation=compute_friction_level,
    citation="Hamon, Gautier, Garrec, Proc. IROS (2010) 187; size: efficiency of 65 to 85 % under load, Harmonic "
    "Drive, CSG/CSF catalogue (2018)",
    experiment=Experiment("repeat one speed at several loads", "grows with the load, whichever way that acts"),
    confusion_groups=(ConfusionGroup.FRICTION_BY_CONDITION,),
    plot=Plot(PlotKind.FRICTION_BEYOND_BASE, Abscissa.LOAD),
    is_friction=True,
)
