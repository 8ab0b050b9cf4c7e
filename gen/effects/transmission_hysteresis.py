"""Rate-independent hysteresis of the flexspline. Legend: h amplitude, N m; δ angle over which it turns, rad; z state
in [−1, 1]."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals, State
from gen.effects.state_rate_limit import limit_displacement


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """h z with dz = (dφ − |dφ| z) / max(δ, |φ̇| h), h the step."""
    z = s.states["hysteresis"]
    rate = (s.torsion_rate - ca.fabs(s.torsion_rate) * z) / limit_displacement(p["hysteresis_angle"], s.torsion_rate, p)
    return p["hysteresis_torque"] * z, (rate,)


EFFECT = Effect(
    name="transmission_hysteresis",
    port=Port.TRANSMISSION,
    parameters=(
        Parameter(
            "hysteresis_torque", "N m", 0.0, 0.0, 100.0, "half the height of the torque-torsion loop", typical=2.0
        ),
        Parameter(
            "hysteresis_angle",
            "rad",
            1e-4,
            1e-6,
            1e-2,
            "torsion over which the loop turns after a reversal",
            starts=(1e-4, 3e-5, 3e-4, 1e-3),
        ),
    ),
    amplitudes=("hysteresis_torque",),
    equation=compute_torque,
    citation="Dahl, A solid friction model, Aerospace Corp. TOR-0158 (1968); paper Fig. 3b; "
    "size: half of K ψ of a CSG-17 (catalogue: loss of up to 2 arcmin)",
    states=(State("hysteresis", "1", 1.0, "share of the hysteresis torque", is_rate_limited=True),),
    suits_rigid_drive=False,
    experiment=Experiment("load the gear to and fro about several preloads", "remembers where the load turned"),
    confusion_groups=(
        ConfusionGroup.TORSION_LOOP,
        ConfusionGroup.TORSION_OR_READING,
        ConfusionGroup.REVERSAL,
    ),
    plot=Plot(PlotKind.TORSION, Abscissa.TORSION),
)
