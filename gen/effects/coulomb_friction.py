"""Coulomb friction. Legend: τ_c level at the motor, N m."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Port, Signals


def compute_friction_level(s: Signals, p: Mapping[str, Any]) -> Any:
    """τ_c; its sign against the motion is the drive's, smooth or set-valued."""
    return p["coulomb_friction"]


EFFECT = Effect(
    name="coulomb_friction",
    port=Port.FRICTION,
    parameters=(),
    amplitudes=("coulomb_friction",),
    equation=compute_friction_level,
    citation="paper (17), (18) corrected: friction opposes motion; Olsson et al., Eur. J. Control 4 (1998) 176, "
    "(1); size: catalogues give starting torque to ±50 %, Harmonic Drive, CSG/CSF catalogue (2018)",
    usual_shares={"coulomb_friction": 0.5},
    experiment=Experiment("reverse slowly about one pose", "changes its sign with the direction and keeps its size"),
    confusion_groups=(
        ConfusionGroup.REVERSAL,
        ConfusionGroup.FRICTION_BY_CONDITION,
        ConfusionGroup.FRICTION_BY_SPEED,
    ),
    plot=Plot(PlotKind.FRICTION, Abscissa.MOTOR_SPEED),
    is_friction=True,
    guessed_keys=("coulomb_friction",),
)
