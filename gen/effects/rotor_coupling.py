"""The rotor rides on the link before its joint. Legend: s direction of the rotor against the link (1, −1; 0 leaves it
out).

The rotor turns about the joint's axis, and in space its spin resists the turning of that axis as a gyroscope does.
Without this effect a rotor is an armature, as in MJCF and URDF, which know no other: it turns with its joint alone."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_reaction(s: Signals, p: Mapping[str, Any]) -> Any:
    """s: the rotor's kinetic energy is ½ J_m (θ̇ + s Ω)², Ω the angular velocity of the link that carries
    it, along the joint's axis."""
    return p["coupling"]


EFFECT = Effect(
    name="rotor_coupling",
    port=Port.REACTION,
    parameters=(
        Parameter(
            "coupling",
            "1",
            0.0,
            -1.0,
            1.0,
            "the rotor turns with (1) or against (-1) the link that carries it",
            typical=1.0,
        ),
    ),
    amplitudes=("coupling",),
    equation=compute_reaction,
    citation="Spong, J. Dyn. Sys. Meas. Control 109 (1987) 310, the term that is dropped there; size: whole",
    experiment=Experiment("move the joints before this one hard while it is held", "follows their acceleration"),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.FIRST_JOINT_ACCELERATION),
)
