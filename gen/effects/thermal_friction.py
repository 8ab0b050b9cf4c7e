"""Friction that falls as the drive warms up by its own motion. Legend: h share; z warmth in [0, 1]; T time constant,
s; θ̇ motor speed; w its value that warms the drive half-way, rad/s."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals, State


def compute_friction_loss(s: Signals, p: Mapping[str, Any]) -> Any:
    """h z with ż = (|θ̇| / (|θ̇| + w) − z) / T: dry and viscous friction fall to 1 − h of what they were."""
    z, speed = s.states["warmth"], ca.fabs(s.motor_velocity)
    return p["thermal_share"] * z, ((speed / (speed + p["thermal_speed"]) - z) / p["thermal_time"],)


EFFECT = Effect(
    name="thermal_friction",
    port=Port.WARMTH,
    parameters=(
        Parameter("thermal_share", "1", 0.0, -1.0, 0.95, "share of friction that a warm drive has lost", typical=0.3),
        Parameter(
            "thermal_time",
            "s",
            10.0,
            0.5,
            10000.0,
            "time constant of warming up",
            starts=(10.0, 3.0, 30.0, 300.0, 10.0, 3.0),
        ),
        Parameter(
            "thermal_speed",
            "rad/s",
            0.01,
            1e-6,
            1000.0,
            "motor speed that warms the drive half-way",
            starts=(0.01, 0.01, 0.01, 0.01, 1.0, 1.0),
            scale="ratio",
        ),
    ),
    amplitudes=("thermal_share",),
    equation=compute_friction_loss,
    citation="Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134 (2012) 051013, with its size; heat by friction's "
    "own power",
    states=(State("warmth", "1", 1.0, "share of the way to the warm drive", is_accumulating=True),),
    experiment=Experiment("repeat one motion from cold to warm", "falls over minutes"),
    confusion_groups=(
        ConfusionGroup.GAIN_OR_MASS,
        ConfusionGroup.FRICTION_BY_CONDITION,
    ),
    plot=Plot(PlotKind.FRICTION_BEYOND_BASE, Abscissa.TIME),
    is_friction=True,
    presupposes="coulomb_friction",
)
