"""A joint encoder whose disc is off centre. Legend: q joint angle; a, b sine and cosine amplitude, z what is taken off
so that the encoder reads zero where it was set to zero; rad."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, EncoderTerm, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_reading_error(s: Signals, p: Mapping[str, Any]) -> Any:
    """a sin q + b cos q − z."""
    q = s.joint_position
    return p["eccentricity_sine"] * ca.sin(q) + p["eccentricity_cosine"] * ca.cos(q) - p["eccentricity_zero"]


EFFECT = Effect(
    name="encoder_eccentricity",
    port=Port.SENSOR,
    parameters=(
        Parameter(
            "eccentricity_sine",
            "rad",
            0.0,
            -0.05,
            0.05,
            "error of the joint encoder once a turn",
            typical=0.0005,
            encoder_term=EncoderTerm.JOINT_SINE,
        ),
        Parameter(
            "eccentricity_cosine",
            "rad",
            0.0,
            -0.05,
            0.05,
            "error of the joint encoder once a turn",
            typical=0.0005,
            encoder_term=EncoderTerm.JOINT_COSINE,
        ),
        Parameter(
            "eccentricity_zero",
            "rad",
            0.0,
            -0.05,
            0.05,
            "that error where the encoder was set to zero",
            typical=0.0005,
            encoder_term=EncoderTerm.ZERO_OFFSET,
        ),
    ),
    amplitudes=("eccentricity_sine", "eccentricity_cosine", "eccentricity_zero"),
    equation=compute_reading_error,
    citation="Sanchez-Brea, Morlanes, Meas. Sci. Technol. 19 (2008) 115104; size: 20 µm on a disc of 80 mm diameter",
    suits_prismatic_joint=False,
    experiment=Experiment("turn the joint as far as it can", "grows and comes back once a turn of the joint"),
    confusion_groups=(
        ConfusionGroup.ENCODER_ERROR,
        ConfusionGroup.POSE,
        ConfusionGroup.ANGLE_ERROR,
    ),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE),
)
