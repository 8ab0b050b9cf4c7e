"""Something stiff beyond an angle. Legend: q_a, q_b angles above and below which it is met; k_a, k_b stiffnesses, N
m/rad; c damping by depth, s/rad."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind, Wall
from gen.effects.effect import Effect, Parameter, Port, Signals

USUAL_SOFT_STIFFNESS = 3.0  # N m/rad, of a joint's cables: without an obstacle nothing stiffer is in its way


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """−k_a max(q − q_a, 0) (1 + c q̇)⁺ + k_b max(q_b − q, 0) (1 − c q̇)⁺: it damps and never holds back."""
    above = ca.fmax(s.joint_position - p["contact_above"], 0)
    below = ca.fmax(p["contact_below"] - s.joint_position, 0)
    rate = p["contact_damping"] * s.joint_velocity
    return p["contact_stiffness_below"] * below * ca.fmax(1 - rate, 0) - p["contact_stiffness_above"] * above * ca.fmax(
        1 + rate, 0
    )


EFFECT = Effect(
    name="contact",
    port=Port.LINK,
    parameters=(
        Parameter(
            "contact_stiffness_above",
            "N m/rad",
            0.0,
            0.0,
            100000.0,
            "of what is met above an angle",
            typical=100.0,
            sliding="N/m",
            everywhere=USUAL_SOFT_STIFFNESS,
        ),
        Parameter(
            "contact_stiffness_below",
            "N m/rad",
            0.0,
            0.0,
            100000.0,
            "of what is met below an angle",
            typical=100.0,
            sliding="N/m",
            everywhere=USUAL_SOFT_STIFFNESS,
        ),
        Parameter(
            "contact_above",
            "rad",
            1.0,
            -10.0,
            10.0,
            "joint angle above which it is met",
            starts=(1.0, 0.5, 0.0, 2.0),
            sliding="m",
            search_unit=0.02,
        ),
        Parameter(
            "contact_below",
            "rad",
            -1.0,
            -10.0,
            10.0,
            "joint angle below which it is met",
            starts=(-1.0, -0.5, 0.0, -2.0),
            sliding="m",
            search_unit=0.02,
        ),
        Parameter(
            "contact_damping",
            "s/rad",
            0.5,
            0.0,
            20.0,
            "of what is met, by its depth",
            starts=(0.5,),
            sliding="s/m",
        ),
    ),
    amplitudes=("contact_stiffness_above", "contact_stiffness_below"),
    equation=compute_torque,
    citation="Hunt, Crossley, J. Appl. Mech. 42 (1975) 440; size: foam or a hose, 1e4 N/m at 0.1 m",
    experiment=Experiment("approach both ends of the range slowly", "pushes beyond one angle only"),
    confusion_groups=(ConfusionGroup.RANGE_END,),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE),
    walls=(
        Wall("contact_stiffness_above", "contact_above", 1),
        Wall("contact_stiffness_below", "contact_below", -1),
    ),
)
