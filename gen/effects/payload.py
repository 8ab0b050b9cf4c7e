"""A mass at the tip. Legend: m_p mass, kg."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_tip_mass(s: Signals, p: Mapping[str, Any]) -> Any:
    """m_p, a point at the end of the last link."""
    return p["payload_mass"]


EFFECT = Effect(
    name="payload",
    port=Port.MASS,
    parameters=(Parameter("payload_mass", "kg", 0.0, 0.0, 100.0, "point mass at the tip", typical=0.3),),
    amplitudes=("payload_mass",),
    equation=compute_tip_mass,
    citation="Lagrangian of the chain with a point mass at the tip; size: a small gripper, 0.3 kg",
    joints="last",
    experiment=Experiment("swap a known payload", "changes weight and inertia together"),
    confusion_groups=(
        ConfusionGroup.GAIN_OR_MASS,
        ConfusionGroup.POSE,
    ),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ACCELERATION),
)
