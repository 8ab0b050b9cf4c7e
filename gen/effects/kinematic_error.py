"""The wave generator's kinematic error. Legend: θ motor angle; a_k, b_k sine and cosine amplitudes, rad at the
joint."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, EncoderTerm, Experiment, Plot, PlotKind, Residual
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torsion_error(s: Signals, p: Mapping[str, Any]) -> Any:
    """Σ_k a_k sin kθ + b_k cos kθ, k = 1, 2, 4 (once, twice and four times a turn of the wave generator)."""
    theta = s.motor_position
    return sum(
        p[f"kinematic_sine_{word}"] * ca.sin(k * theta) + p[f"kinematic_cosine_{word}"] * ca.cos(k * theta)
        for k, word in HARMONIC_ORDERS
    )


HARMONIC_ORDERS = ((1, "once"), (2, "twice"), (4, "four"))
HARMONIC_NAMES = tuple(f"kinematic_{part}_{word}" for _, word in HARMONIC_ORDERS for part in ("sine", "cosine"))

EFFECT = Effect(
    name="kinematic_error",
    port=Port.TORSION,
    parameters=tuple(
        Parameter(
            name,
            "rad",
            0.0,
            -2e-3,
            2e-3,
            "amplitude at the joint",
            typical=1.5e-4,
            encoder_term=EncoderTerm(name.replace("kinematic", "motor")),
        )
        for name in HARMONIC_NAMES
    ),
    amplitudes=HARMONIC_NAMES,
    equation=compute_torsion_error,
    citation="Tuttle, Seering, Nonlinear model of a harmonic drive, IEEE Trans. Robot. Autom. 12 (1996) 368; "
    "size: 1 arcmin from peak to peak, Harmonic Drive, CSG/CSF catalogue (2018)",
    suits_rigid_drive=False,
    experiment=Experiment(
        "run at several constant speeds with both encoders", "comes back with the motor's turn at any speed"
    ),
    confusion_groups=(
        ConfusionGroup.PERIODIC,
        ConfusionGroup.ANGLE_ERROR,
    ),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.MOTOR_ANGLE),
    residual=Residual.GEAR_ANGLE,
)
