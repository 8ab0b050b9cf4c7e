"""Dry friction that peaks at standstill, and fades as a Gauss curve (b = 0), as an exponential (b large), or between.

Legend: τ_s peak above Coulomb friction, N m; ω_s speed at which it has faded to 1/e, rad/s; b sharpness of the peak.
"""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_friction_level(s: Signals, p: Mapping[str, Any]) -> Any:
    """τ_s exp(−z² (1 + √(1 + b²)) / (1 + √(1 + b² z²))), z = θ̇/ω_s."""
    z2, b2 = (s.motor_velocity / p["stribeck_speed"]) ** 2, p["stribeck_sharpness"] ** 2
    return p["stribeck_torque"] * ca.exp(-z2 * (1 + ca.sqrt(1 + b2)) / (1 + ca.sqrt(1 + b2 * z2)))


EFFECT = Effect(
    name="stribeck_friction",
    port=Port.FRICTION,
    parameters=(
        Parameter(
            "stribeck_torque",
            "N m",
            0.0,
            0.0,
            50.0,
            "dry friction at rest above that in motion",
            typical=0.4,
            scale="coulomb_friction",
        ),
        Parameter(
            "stribeck_speed",
            "rad/s",
            0.05,
            1e-4,
            1000.0,
            "motor speed at which it has fallen to 1/e",
            starts=(0.05, 0.015, 0.15, 0.5),
            scale="ratio",
        ),
        Parameter(
            "stribeck_sharpness",
            "1",
            2.0,
            0.0,
            100.0,
            "of the peak: 0 Gauss' curve, 100 Tustin's exponential, 2 between",
            starts=(2.0,),
        ),
    ),
    amplitudes=("stribeck_torque",),
    equation=compute_friction_level,
    citation="Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083 (exponents 0.5 to 2); size: "
    "Kircanski, Goldenberg, Int. J. Robot. Res. 16 (1997) 214, harmonic drives",
    experiment=Experiment("run at constant speeds from creep on", "falls with speed at first"),
    confusion_groups=(
        ConfusionGroup.REVERSAL,
        ConfusionGroup.FRICTION_BY_SPEED,
    ),
    plot=Plot(PlotKind.FRICTION, Abscissa.MOTOR_SPEED),
    is_friction=True,
    presupposes="coulomb_friction",
)
