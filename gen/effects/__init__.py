"""The effects, one file each. NOMINAL is in every model; ALL is what a robot file may state and a build may add."""

from gen.effect import Effect
from gen.effects import (
    coulomb_friction,
    current_bias,
    gravity,
    kinematic_error,
    payload,
    presliding_friction,
    rotor_coupling,
    springs,
    torsional_damping,
    transmission_hysteresis,
    viscous_friction,
)

NOMINAL: tuple[Effect, ...] = (
    coulomb_friction.EFFECT,
    viscous_friction.EFFECT,
    current_bias.EFFECT,
    springs.EFFECT,
    torsional_damping.EFFECT,
    gravity.EFFECT,
    payload.EFFECT,
)

ALL: tuple[Effect, ...] = (
    *NOMINAL,
    kinematic_error.EFFECT,
    presliding_friction.EFFECT,
    rotor_coupling.EFFECT,
    transmission_hysteresis.EFFECT,
)
