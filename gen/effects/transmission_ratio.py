"""A ratio that is not the stated one. Legend: e relative error; θ motor angle; N ratio."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torsion_error(s: Signals, p: Mapping[str, Any]) -> Any:
    """e θ / N."""
    return p["ratio_error"] * s.motor_position / s.ratio


EFFECT = Effect(
    name="transmission_ratio",
    port=Port.TORSION,
    parameters=(
        Parameter(
            "ratio_error",
            "1",
            0.0,
            -0.05,
            0.05,
            "relative error of the joint's turn per turn of the motor",
            typical=0.01,
        ),
    ),
    amplitudes=("ratio_error",),
    equation=compute_torsion_error,
    citation="Harmonic Drive, CSG/CSF catalogue (2018): ratio N or N + 1 by which part is held, 1 % at N = 100",
    suits_rigid_drive=False,
    experiment=Experiment("turn the joint as far as it can", "errs in proportion to the angle, without any load"),
    confusion_groups=(ConfusionGroup.ANGLE_ERROR,),
    plot=Plot(PlotKind.TORSION, Abscissa.TORSION),
)
