"""The paper's kinematic torsion over the output's turn. Legend: s place in the turn, θ/(2πN) less its whole turns,
in [0, 1); a_i coefficients, rad."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torsion_error(s: Signals, p: Mapping[str, Any]) -> Any:
    """Σ_i a_i (s^i − s), i = 2…5: a polynomial that is continued from turn to turn; its linear part is a ratio
    error."""
    turn = s.motor_position / (2 * ca.pi * s.ratio)
    place = turn - ca.floor(turn)
    return sum(p[name] * (place**i - place) for i, name in enumerate(COEFFICIENT_NAMES, 2))


COEFFICIENT_NAMES = ("kinematic_square", "kinematic_cube", "kinematic_fourth", "kinematic_fifth")

EFFECT = Effect(
    name="kinematic_torsion",
    port=Port.TORSION,
    parameters=tuple(
        Parameter(name, "rad", 0.0, -0.1, 0.1, "coefficient over a turn of the output", typical=5e-4)
        for name in COEFFICIENT_NAMES
    ),
    amplitudes=COEFFICIENT_NAMES,
    equation=compute_torsion_error,
    citation="paper (13), Fig. 14; size: 1 arcmin from peak to peak, Harmonic Drive, CSG/CSF catalogue (2018)",
    suits_rigid_drive=False,
    experiment=Experiment(
        "turn the motor slowly without load, with both encoders", "comes back with the output's turn"
    ),
    confusion_groups=(
        ConfusionGroup.PERIODIC,
        ConfusionGroup.TORSION_LOOP,
        ConfusionGroup.ANGLE_ERROR,
    ),
    plot=Plot(PlotKind.TORSION, Abscissa.TORSION),
)
