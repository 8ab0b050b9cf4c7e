"""A dead zone in the gear, in which nothing touches: neither spring nor damping acts. Legend: b width, rad
at the joint; φ torsion."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, EncoderTerm, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_play(s: Signals, p: Mapping[str, Any]) -> Any:
    """φ held within ±b/2: the springs see what is beyond."""
    half = 0.5 * p["backlash_angle"]
    return ca.fmax(ca.fmin(s.torsion, half), -half)


EFFECT = Effect(
    name="backlash",
    port=Port.PLAY,
    parameters=(
        Parameter(
            "backlash_angle",
            "rad",
            0.0,
            0.0,
            0.05,
            "width of the dead zone",
            typical=0.0005,
            sliding="m",
            encoder_term=EncoderTerm.TORQUE_SIGN,
        ),
    ),
    amplitudes=("backlash_angle",),
    equation=compute_play,
    citation="Nordin, Gutman, Automatica 38 (2002) 1633; size: 1 to 3 arcmin of a worn drive with its coupling, "
    "Harmonic Drive, CSG/CSF catalogue (2018), Oldham coupling",
    suits_rigid_drive=False,
    experiment=Experiment(
        "let the load pass zero slowly, with both encoders", "jumps where the torque changes its sign"
    ),
    confusion_groups=(
        ConfusionGroup.TORSION_OR_READING,
        ConfusionGroup.REVERSAL,
    ),
    plot=Plot(PlotKind.TORSION, Abscissa.TORSION),
)
