"""The springs of wave generator and flexspline in series. Legend: φ torsion, τ joint torque
(`gen.model.harmonic_drive`)."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """level · τ(φ), τ the exact inverse of the torsion law."""
    return p["stiffness_level"] * s.spring_torque


EFFECT = Effect(
    name="stiffness",
    port=Port.TRANSMISSION,
    parameters=(
        Parameter("stiffness_level", "1", 1.0, 0.0, 3.0, "level of both springs against the robot file's", typical=0.3),
    ),
    amplitudes=("stiffness_level",),
    equation=compute_torque,
    citation="paper (3)-(11), (19) corrected; size: catalogue stiffness holds to ±30 %, Harmonic Drive, CSG/CSF "
    "catalogue (2018)",
    suits_rigid_drive=False,
    experiment=Experiment(
        "load the held gear with several torques", "twists it in proportion and comes back on its line"
    ),
    confusion_groups=(
        ConfusionGroup.TORSION_LOOP,
        ConfusionGroup.SOFT_MODE,
        ConfusionGroup.TORSION_OR_READING,
        ConfusionGroup.REVERSAL,
        ConfusionGroup.ANGLE_ERROR,
    ),
    plot=Plot(PlotKind.TORSION, Abscissa.TORSION),
)
