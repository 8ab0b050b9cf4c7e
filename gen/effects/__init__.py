"""The effects, one file each. NOMINAL is in every model; ALL is what a robot file may state and a build may add.

A new effect is a file beside the others, and its name in one of the two lists.
"""

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from gen.effects.effect import Effect

NOMINAL_NAMES = (
    "torque_constant",
    "coulomb_friction",
    "viscous_friction",
    "current_bias",
    "stiffness",
    "joint_damping",
    "gravity",
    "payload",
)
ADDED_NAMES = (  # along the signal chain; effects at one port add up in this order
    "command_delay",
    "current_saturation",
    "voltage_sag",
    "current_loop_lag",
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "position_dependent_friction",
    "thermal_friction",
    "presliding_friction",
    "quadratic_friction",
    "torque_ripple",
    "rotor_coupling",
    "kinematic_error",
    "kinematic_torsion",
    "transmission_ratio",
    "backlash",
    "missing_compliance",
    "transmission_hysteresis",
    "gravity_tilt",
    "cable_spring",
    "contact",
    "link_flexibility",
    "base_compliance",
    "encoder_eccentricity",
    "encoder_bias",
    "sensor_delay",
    "torque_sensor_gain",
)


if TYPE_CHECKING:
    NOMINAL: tuple[Effect, ...]
    ALL: tuple[Effect, ...]


@cache
def _load_effects(names: tuple[str, ...]) -> tuple[Effect, ...]:
    """The effects that the files of these names define; they need CasADi, which a robot file that is read does not."""
    return tuple(import_module(f"{__name__}.{name}").EFFECT for name in names)


def __getattr__(name: str) -> tuple[Effect, ...]:
    if name == "NOMINAL":
        return _load_effects(NOMINAL_NAMES)
    if name == "ALL":
        return _load_effects((*NOMINAL_NAMES, *ADDED_NAMES))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
