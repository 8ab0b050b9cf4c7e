"""Cogging and torque ripple. Legend: θ motor angle; k order; a, b sine and cosine amplitudes, N m."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """a_1 sin kθ + b_1 cos kθ + a_2 sin 2kθ + b_2 cos 2kθ."""
    angle = p["ripple_order"] * s.motor_position
    once = p["ripple_sine"] * ca.sin(angle) + p["ripple_cosine"] * ca.cos(angle)
    return once + p["ripple_sine_twice"] * ca.sin(2 * angle) + p["ripple_cosine_twice"] * ca.cos(2 * angle)


EFFECT = Effect(
    name="torque_ripple",
    port=Port.MOTOR,
    parameters=(
        Parameter(
            "ripple_sine", "N m", 0.0, -50.0, 50.0, "amplitude at the motor", typical=0.15, scale="coulomb_friction"
        ),
        Parameter(
            "ripple_cosine", "N m", 0.0, -50.0, 50.0, "amplitude at the motor", typical=0.15, scale="coulomb_friction"
        ),
        Parameter(
            "ripple_sine_twice",
            "N m",
            0.0,
            -50.0,
            50.0,
            "amplitude at the motor",
            typical=0.15,
            scale="coulomb_friction",
        ),
        Parameter(
            "ripple_cosine_twice",
            "N m",
            0.0,
            -50.0,
            50.0,
            "amplitude at the motor",
            typical=0.15,
            scale="coulomb_friction",
        ),
        Parameter(
            "ripple_order",
            "1",
            6.0,
            1.0,
            200.0,
            "cycles a turn of the motor",
            starts=(6.0, 1.0, 2.0, 12.0),
            is_motor_order=True,
        ),
    ),
    amplitudes=("ripple_sine", "ripple_cosine", "ripple_sine_twice", "ripple_cosine_twice"),
    equation=compute_torque,
    citation="Holtz, Springob, IEEE Trans. Ind. Electron. 43 (1996) 694; size: 1 to 2 % of the rated torque, which"
    " is 0.1 to 0.2 of a harmonic drive's running torque",
    experiment=Experiment("creep over several turns of the motor", "comes back with them in the current"),
    confusion_groups=(ConfusionGroup.PERIODIC,),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.MOTOR_ANGLE),
)
