"""Friction that falls as the drive warms up. Legend: h share; z warmth in [0, 1], T time constant, s."""

from collections.abc import Mapping
from typing import Any

from gen.effect import Effect, Parameter, Port, Signals, State


def share(s: Signals, p: Mapping[str, Any]) -> Any:
    """h z with ż = (1 − z) / T: dry and viscous friction fall to 1 − h of what they were."""
    z = s.states["warmth"]
    return p["thermal_share"] * z, ((1 - z) / p["thermal_time"],)


EFFECT = Effect(
    name="thermal_friction",
    port=Port.WARMTH,
    parameters=(
        Parameter("thermal_share", "1", 0.0, -1.0, 0.95, "share of friction that a warm drive has lost", typical=0.3),
        Parameter(
            "thermal_time", "s", 10.0, 0.5, 10000.0, "time constant of warming up", starts=(10.0, 3.0, 30.0, 300.0)
        ),
    ),
    amplitudes=("thermal_share",),
    equation=share,
    citation="Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134 (2012) 051013, with its size",
    states=(State("warmth", "1", 1.0, "share of the way to the warm drive"),),
)
