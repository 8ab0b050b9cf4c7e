"""Damping between motor side and link. Legend: d coefficient, N m s/rad at the joint; φ̇ rate of torsion."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Port, Signals


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """d φ̇."""
    return p["torsional_damping"] * s.torsion_rate


EFFECT = Effect(
    name="joint_damping",
    port=Port.TRANSMISSION,
    parameters=(),
    amplitudes=("torsional_damping",),
    equation=compute_torque,
    citation="Spong, J. Dyn. Sys. Meas. Control 109 (1987) 310, with a dashpot beside the spring; size: no "
    "catalogue gives it; what damps the spring of a CSG-17 (about 1e4 N m/rad) under 0.06 kg m² critically, 2 √(K M)",
    suits_rigid_drive=False,
    usual_shares={"torsional_damping": 8.0},
    experiment=Experiment("load the gear to and fro, slowly and fast", "resists with the rate of the twist"),
    confusion_groups=(
        ConfusionGroup.TORSION_LOOP,
        ConfusionGroup.SOFT_MODE,
        ConfusionGroup.TORSION_OR_READING,
    ),
    plot=Plot(PlotKind.TORSION, Abscissa.TORSION),
)
