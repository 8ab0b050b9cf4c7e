"""The effects of joints at joint scale: usual sizes in multiples of the joint's own torque, friction and speed.

A draw knows of its joint, beside the keys of its tables, ``usual_torque`` (rms of the motion, N m), ``usual_speed``
(rms, rad/s), and the angles ``lowest`` and ``highest`` that the motion reaches, rad.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from hdagen.blind.realities.effect_sizes import EffectSize, EffectValues
from hdagen.blind.realities.random_streams import draw_log_uniform

UNKNOWN_SHARE = 0.15  # usual size of a torque that no effect describes, as a share of the usual torque
UNKNOWN_JOINT_KINDS = ("beat", "detent", "snap", "product")
_SOFTEST_TORQUE = 50.0  # N m, up to which a missing spring yields in proportion to the joint's usual torque
_LEAST_FREE_SHARE = 0.25  # smallest distance to a wall, as a share of the reach


def _draw_sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _draw_coulomb(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"torque": amount * _draw_sign(rng) * base["coulomb_friction"]}


def _draw_viscous(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"coefficient": amount * base["viscous_friction"]}


def _draw_stribeck(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    speed = base["usual_speed"] * draw_log_uniform(rng, 0.05, 0.25)
    return {"torque": amount * base["coulomb_friction"], "speed": speed}


def _draw_one_sided(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"torque": amount * _draw_sign(rng) * base["coulomb_friction"]}


def _draw_load(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"share": amount}


def _draw_ripple(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    phase = float(rng.uniform(-math.pi, math.pi))
    return {"order": float(rng.integers(4, 25)), "torque": amount * base["coulomb_friction"], "phase": phase}


def _draw_delay(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"time": amount}


def _draw_payload(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"mass": amount * base["mass"]}


def _draw_tilt(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"angle": amount * _draw_sign(rng), "direction": 0.0}


def _draw_cable(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"stiffness": amount * base["usual_torque"], "rest": float(rng.uniform(-0.4, 0.4))}


def _draw_wall(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    """A wall inside the reach of the motion; deeper with size. The arm begins at 0, outside the wall."""
    side, reach = _draw_sign(rng), {1.0: base["highest"], -1.0: -base["lowest"]}
    if reach[side] <= amount:
        side = -side
    angle = side * max(reach[side] - amount, _LEAST_FREE_SHARE * reach[side])
    stiffness = base["usual_torque"] * draw_log_uniform(rng, 10.0, 40.0)
    return {"angle": angle, "side": side, "stiffness": stiffness, "damping": float(rng.uniform(0.2, 0.6))}


def _draw_compliance(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {
        "compliance": amount / min(base["usual_torque"], _SOFTEST_TORQUE),
        "damping_ratio": float(rng.uniform(0.05, 0.2)),
    }


def _draw_stiffness(amount: float, rng: np.random.Generator, base: Mapping[str, float]) -> EffectValues:
    return {"factor": 1.0 + amount * _draw_sign(rng)}


JOINT_EFFECTS: Mapping[str, EffectSize] = {
    "coulomb_friction": EffectSize("motor", 0.5, "of nominal", "as of arms", _draw_coulomb),
    "viscous_friction": EffectSize("motor", 2.0, "of nominal", "cold grease thickens several times", _draw_viscous),
    "stribeck_friction": EffectSize("motor", 0.4, "of Coulomb", "as of arms", _draw_stribeck),
    "asymmetric_friction": EffectSize("motor", 0.3, "of Coulomb", "as of arms", _draw_one_sided),
    "load_dependent_friction": EffectSize("motor", 0.15, "of transmitted torque", "efficiency of 85 %", _draw_load),
    "torque_ripple": EffectSize("motor", 0.4, "of Coulomb", "cogging of direct drives", _draw_ripple),
    "current_bias": EffectSize("motor", 0.4, "of Coulomb", "an effort that was not zeroed", _draw_one_sided),
    "command_delay": EffectSize("input", 6e-3, "s", "a middleware and a bus between controller and drive", _draw_delay),
    "stiffness": EffectSize("transmission", 0.35, "of nominal", "as of arms", _draw_stiffness),
    "missing_compliance": EffectSize(
        "transmission", 5e-3, "rad at usual torque", "a belt or a soft gear that the file calls rigid", _draw_compliance
    ),
    "payload": EffectSize("link", 0.3, "of the last link", "a gripper", _draw_payload, "last"),
    "gravity_tilt": EffectSize("link", math.radians(5.0), "rad", "a stand that was not levelled", _draw_tilt, "arm"),
    "cable_spring": EffectSize("link", 0.2, "of usual torque a rad", "a hose over the joint", _draw_cable),
    "contact": EffectSize("link", 0.15, "rad inside the reach", "a fixture in the way", _draw_wall),
}
NEVER_AT_JOINTS = ("contact", "missing_compliance", "command_delay")  # never in the background of joints


def draw_unknown_joint_torque(size: float, rng: np.random.Generator, usual_torque: float) -> EffectValues:
    """Draw a torque at a joint that no effect describes.

    Args:
        size: multiple of `UNKNOWN_SHARE`.
        rng: the random generator.
        usual_torque: of the joint, N m.

    Returns:
        Parameters of all kinds, SI; ``kind`` is an index of `UNKNOWN_JOINT_KINDS`.

    """
    return {
        "kind": float(rng.integers(len(UNKNOWN_JOINT_KINDS))),
        "torque": UNKNOWN_SHARE * size * usual_torque,
        "frequency": draw_log_uniform(rng, 1.0, 5.0),
        "order": float(rng.integers(12, 31)),
        "phase": float(rng.uniform(-math.pi, math.pi)),
        "play": float(rng.uniform(0.1, 0.3)),
    }
