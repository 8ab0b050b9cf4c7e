"""The wave generator's kinematic error. Legend: θ motor angle; a_k, b_k sine and cosine amplitudes, rad at the
joint."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effect import Effect, Parameter, Port, Signals


def angle(s: Signals, p: Mapping[str, Any]) -> Any:
    """Σ_k a_k sin kθ + b_k cos kθ, k = 1, 2 (once and twice per turn of the wave generator)."""
    theta = s.motor_position
    once = p["kinematic_sine_once"] * ca.sin(theta) + p["kinematic_cosine_once"] * ca.cos(theta)
    return once + p["kinematic_sine_twice"] * ca.sin(2 * theta) + p["kinematic_cosine_twice"] * ca.cos(2 * theta)


NAMES = ("kinematic_sine_once", "kinematic_cosine_once", "kinematic_sine_twice", "kinematic_cosine_twice")

EFFECT = Effect(
    name="kinematic_error",
    port=Port.TORSION,
    parameters=tuple(Parameter(name, "rad", 0.0, -2e-3, 2e-3, "amplitude at the joint") for name in NAMES),
    amplitudes=NAMES,
    equation=angle,
    citation="Tuttle, Seering, Nonlinear model of a harmonic drive, IEEE Trans. Robot. Autom. 12 (1996) 368",
    rigid=False,
)
