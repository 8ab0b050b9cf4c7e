"""The effects of a reality: the place of each, its typical size with the source, and the draw of its parameters.

A true effect has 0.5 to 1.5 times its typical size, an effect of the background 0.04 times. The formulas stand in
`hdagen.blind.realities.drivetrain` and `hdagen.blind.realities.arm_reality`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hdagen.blind.realities.random_streams import draw_log_uniform

EffectValues = dict[str, float]
DrawEffect = Callable[[float, np.random.Generator, Mapping[str, float]], EffectValues]


@dataclass(frozen=True)
class EffectSize:
    """An effect's ``place``, ``typical`` size in ``unit``, and the ``source`` of that size.

    ``draw``: (amount, in ``unit``; generator; base parameters of the joint and limits of its motion) -> the effect's
    parameters. ``joints``: "each", "last" or "arm" (joint 0).
    """

    place: str
    typical: float
    unit: str
    source: str
    draw: DrawEffect
    joints: str = "each"


def _draw_sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _draw_coulomb_friction(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"torque": amount * _draw_sign(rng) * base["coulomb_friction"]}


def _draw_viscous_friction(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"coefficient": amount}


def _draw_stribeck_friction(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    torque = amount * base["coulomb_friction"]
    return {"torque": torque, "speed": draw_log_uniform(rng, 5.0, 25.0), "exponent": float(rng.uniform(0.7, 1.6))}


def _draw_asymmetric_friction(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"torque": amount * _draw_sign(rng) * base["coulomb_friction"], "speed": 1.0}


def _draw_load_dependent_friction(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"share": amount, "rounding": 1.0}


def _draw_presliding_friction(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"share": min(amount, 1.0), "angle": draw_log_uniform(rng, 0.05, 0.3), "damping": 0.02}


def _draw_thermal_friction(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    """``drop`` at the temperature that 3 W settle at; ``time`` constant, s, of the lubricant's heat balance."""
    return {"drop": amount, "time": draw_log_uniform(rng, 2.0, 8.0), "power": 3.0}


def _draw_torque_ripple(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    order = float(rng.choice([1, 2, 4, 6, 7, 8, 11, 12, 14]))
    phases = rng.uniform(0.0, 2.0 * math.pi, 2)
    return {
        "order": order,
        "torque": amount,
        "phase": float(phases[0]),
        "second_order": 2.0 * order,
        "second_torque": 0.3 * amount,
        "second_phase": float(phases[1]),
    }


def _draw_torque_constant(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"factor": 1.0 + amount * _draw_sign(rng)}


def _draw_current_bias(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"current": amount * _draw_sign(rng)}


def _draw_current_saturation(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    """A limit below ``peak``, the largest command of the same reality without it: size 0.5 cuts the top eighth, size
    1.5 the upper half, and in the background the limit is not reached."""
    return {"limit": base["peak"] / math.sqrt(amount)}


def _draw_current_loop_lag(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"time": amount}


def _draw_command_delay(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"time": amount}


def _draw_transmission_hysteresis(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"torque": amount, "angle": draw_log_uniform(rng, 1e-4, 3e-4)}


def _draw_kinematic_error(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    phases = rng.uniform(0.0, 2.0 * math.pi, 3)
    once = float(rng.uniform(0.2, 0.6))
    return {
        "twice": amount,
        "twice_phase": float(phases[0]),
        "once": once * amount,
        "once_phase": float(phases[1]),
        "fourth": 0.1 * amount,
        "fourth_phase": float(phases[2]),
    }


def _draw_backlash(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"width": amount}


def _draw_stiffness(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"factor": 1.0 + amount * _draw_sign(rng)}


def _draw_joint_damping(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"factor": 1.0 + amount}


def _draw_payload(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"mass": amount}


def _draw_gravity_tilt(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    """``angle`` of the base, rad; an arm that lies flat tilts towards ``direction``, a standing one in its plane."""
    return {"angle": amount * _draw_sign(rng), "direction": float(rng.uniform(-math.pi, math.pi))}


def _draw_cable_spring(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"stiffness": amount, "rest": float(rng.uniform(-0.3, 0.3))}


_LEAST_FREE_REACH = 0.2  # smallest distance to a wall, as a share of the reach


def _draw_contact(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    """A wall inside the reach of the motion, ``lowest`` … ``highest``; deeper and stiffer with size. The arm begins at
    0, outside the wall."""
    side, reach = _draw_sign(rng), {1.0: base["highest"], -1.0: -base["lowest"]}
    if reach[side] <= amount:
        side = -side
    angle = side * max(reach[side] - amount, _LEAST_FREE_REACH * reach[side])
    return {
        "angle": angle,
        "side": side,
        "stiffness": amount * draw_log_uniform(rng, 4e4, 1.6e5),
        "damping": float(rng.uniform(0.2, 0.6)),
    }


def _draw_encoder_eccentricity(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"share": amount, "phase": float(rng.uniform(-math.pi, math.pi))}


def _draw_sensor_delay(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"time": amount}


EFFECT_SIZES: dict[str, EffectSize] = {
    "coulomb_friction": EffectSize(
        "motor",
        0.5,
        "of nominal",
        "the starting torque of a cup gear moves by half with lubricant and wear",
        _draw_coulomb_friction,
    ),
    "viscous_friction": EffectSize(
        "motor",
        1e-4,
        "N m s/rad",
        "0.03 N m more no-load torque at 3000 turns a minute, as with cold grease",
        _draw_viscous_friction,
    ),
    "stribeck_friction": EffectSize(
        "motor",
        0.4,
        "of Coulomb",
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083",
        _draw_stribeck_friction,
    ),
    "asymmetric_friction": EffectSize(
        "motor",
        0.25,
        "of Coulomb",
        "differences by direction of 10 to 40 % are usual in geared joints",
        _draw_asymmetric_friction,
    ),
    "load_dependent_friction": EffectSize(
        "motor",
        0.2,
        "of transmitted torque",
        "efficiency of about 75 % of a CSG gear near rated torque",
        _draw_load_dependent_friction,
    ),
    "presliding_friction": EffectSize(
        "motor",
        0.6,
        "share",
        "Canudas de Wit et al., IEEE Trans. Autom. Control 40 (1995) 419",
        _draw_presliding_friction,
    ),
    "thermal_friction": EffectSize(
        "motor",
        0.5,
        "drop",
        "grease thins by half over some 20 K; the film warms in seconds, the housing later",
        _draw_thermal_friction,
    ),
    "torque_ripple": EffectSize(
        "motor", 4e-3, "N m", "4 % of the 0.105 N m that the motor gives at 2 A", _draw_torque_ripple
    ),
    "torque_constant": EffectSize(
        "motor",
        0.25,
        "of nominal",
        "10 % of a motor's data sheet, ferrite's 0.2 % a kelvin over 80 K",
        _draw_torque_constant,
    ),
    "current_bias": EffectSize("motor", 0.2, "A", "2 % of the range of a 10 A current sensor", _draw_current_bias),
    "current_saturation": EffectSize(
        "input", 2.6, "square of peak by limit", "a drive set for its motor's rating", _draw_current_saturation
    ),
    "current_loop_lag": EffectSize(
        "input", 2e-3, "s", "a current loop of 80 Hz, slow for a servo drive", _draw_current_loop_lag
    ),
    "command_delay": EffectSize("input", 2e-3, "s", "two cycles of a 1 kHz bus", _draw_command_delay),
    "transmission_hysteresis": EffectSize(
        "transmission",
        1.45,
        "N m",
        "half the catalogue's loss of 1 arcmin times its stiffness of 1e4 N m/rad",
        _draw_transmission_hysteresis,
    ),
    "kinematic_error": EffectSize(
        "transmission",
        2e-4,
        "rad",
        "transmission accuracy of 1.5 arcmin from peak to peak; "
        "Tuttle, Seering, IEEE Trans. Robot. Autom. 12 (1996) 368",
        _draw_kinematic_error,
    ),
    "backlash": EffectSize("transmission", 5e-4, "rad", "a worn coupling: 1.7 arcmin at the joint", _draw_backlash),
    "stiffness": EffectSize(
        "transmission",
        0.35,
        "of nominal",
        "catalogue stiffness is an average; gears measured differ by a third",
        _draw_stiffness,
    ),
    "joint_damping": EffectSize(
        "transmission",
        8.0,
        "of nominal",
        "what damps a spring of 1e4 N m/rad under 0.06 kg m² critically; no catalogue gives it",
        _draw_joint_damping,
    ),
    "payload": EffectSize("link", 0.5, "kg", "a small gripper", _draw_payload, "last"),
    "gravity_tilt": EffectSize(
        "link", math.radians(5.0), "rad", "a stand that was not levelled", _draw_gravity_tilt, "arm"
    ),
    "cable_spring": EffectSize("link", 2.0, "N m/rad", "a hose bundle over a joint of this size", _draw_cable_spring),
    "contact": EffectSize(
        "link", 0.12, "rad inside the reach", "a fixture in the way, of about 1e4 N m/rad", _draw_contact
    ),
    "encoder_eccentricity": EffectSize(
        "sensor", 5e-4, "rad", "a disc of 20 mm radius off its centre by 10 micrometres", _draw_encoder_eccentricity
    ),
    "sensor_delay": EffectSize("sensor", 2e-3, "s", "two cycles of a 1 kHz bus", _draw_sensor_delay),
}

NEVER_IN_BACKGROUND = ("contact",)  # never in the background: the smallest wall stops the arm as well
UNKNOWN_KINDS = ("product", "vibration", "hysteretic_cubic", "detent")
UNKNOWN_TYPICAL = 1.5  # N m at the joint: about the torque of the gear's hysteresis


def draw_unknown_torque(size: float, rng: np.random.Generator) -> EffectValues:
    """Draw a torque at a joint that no effect of the table describes.

    Args:
        size: multiple of `UNKNOWN_TYPICAL`.
        rng: the random generator.

    Returns:
        Parameters of all kinds, SI; ``kind`` is an index of `UNKNOWN_KINDS`.

    """
    torque = UNKNOWN_TYPICAL * size
    return {
        "kind": float(rng.integers(len(UNKNOWN_KINDS))),
        "torque": torque,
        "frequency": draw_log_uniform(rng, 1.5, 7.0),
        "order": float(rng.integers(12, 31)),
        "phase": float(rng.uniform(-math.pi, math.pi)),
        "play": float(rng.uniform(0.1, 0.25)),
    }
