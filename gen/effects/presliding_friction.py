"""Dry friction that builds up over a displacement. Legend: a share, δ angle at the motor, rad; z bristle in [−1, 1]."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals, State
from gen.effects.state_rate_limit import limit_displacement


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """a · level · (direction − z): the bristle takes the place of the sign of the speed;
    ż = (θ̇ − |θ̇| z) / max(δ, |θ̇| h), h a step, for at such speeds nothing can tell it from at once."""
    z = s.states["bristle"]
    rate = (s.motor_velocity - ca.fabs(s.motor_velocity) * z) / limit_displacement(
        p["presliding_angle"], s.motor_velocity, p
    )
    return p["presliding_share"] * s.friction_level * (s.direction - z), (rate,)


EFFECT = Effect(
    name="presliding_friction",
    port=Port.MOTOR,
    parameters=(
        Parameter(
            "presliding_share",
            "1",
            0.0,
            0.0,
            1.0,
            "share of dry friction that builds up over a displacement",
            typical=1.0,
        ),
        Parameter(
            "presliding_angle",
            "rad",
            2e-4,
            1e-7,
            10.0,
            "motor angle over which it builds up",
            starts=(2e-4, 5e-5, 1e-3, 5e-3),
            scale="ratio",
        ),
    ),
    amplitudes=("presliding_share",),
    equation=compute_torque,
    citation="Dahl, TOR-0158 (1968); Canudas de Wit et al., IEEE Trans. Autom. Control 40 (1995) 419, (1)-(3); size: "
    "all of it does",
    states=(State("bristle", "1", 1.0, "deflection against the displacement", is_stiff=True, is_rate_limited=True),),
    experiment=Experiment("reverse within a few encoder steps", "is a spring before the joint breaks away"),
    confusion_groups=(ConfusionGroup.REVERSAL,),
    plot=Plot(PlotKind.FRICTION, Abscissa.MOTOR_TRAVEL),
    is_friction=True,
    presupposes="coulomb_friction",
)
