"""A joint encoder with a wrong zero. Legend: b angle, rad."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, EncoderTerm, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_reading_error(s: Signals, p: Mapping[str, Any]) -> Any:
    """b."""
    return p["encoder_bias"]


EFFECT = Effect(
    name="encoder_bias",
    port=Port.SENSOR,
    parameters=(
        Parameter(
            "encoder_bias",
            "rad",
            0.0,
            -1.0,
            1.0,
            "what the joint encoder reads at q = 0",
            typical=0.001,
            sliding="m",
            encoder_term=EncoderTerm.CONSTANT,
        ),
    ),
    amplitudes=("encoder_bias",),
    equation=compute_reading_error,
    citation="Mooring, Roth, Driels, Fundamentals of Manipulator Calibration (1991), joint offsets; size: 0.05°, "
    "what a mark on the housing gives",
    experiment=Experiment(
        "hold still at several poses across the range", "is the same angle everywhere and needs no torque"
    ),
    confusion_groups=(
        ConfusionGroup.ENCODER_ERROR,
        ConfusionGroup.POSE,
        ConfusionGroup.ANGLE_ERROR,
    ),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE),
)
