"""Sizes of the effect that a case of an imported model withholds, by what its motion asks of the joint.

Legend: torques at the joint, N m or N; angles, rad or m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdagen.blind.realities.model_arms import RATE, ModelCase
from hdagen.blind.realities.random_streams import draw_log_uniform, seeded_generator
from hdagen.blind.realities.space_model import measure_gear, measure_inertia

Values = dict[str, float]
SOFTEST_TORQUE = 50.0  # N m, up to which a spring yields in proportion to the joint's usual torque
FASTEST_GEAR = 1500.0  # rad/s, of a link against its rotor, which MuJoCo's step carries
PLAY_GIVE = 0.1  # of the play's width, that its stops yield at the usual torque
PLAY_DAMPING_RATIO = 0.3  # of the stops of the play
LEAST_FREE_SHARE = 0.25  # smallest distance to a wall, as a share of the reach


@dataclass(frozen=True)
class UsualMotion:
    """What a motion without the effect asks of a joint: ``torque`` and ``speed``, rms; ``peak`` torque; the positions
    ``start``, ``lowest`` and ``highest``."""

    torque: float
    speed: float
    peak: float
    start: float
    lowest: float
    highest: float

    @classmethod
    def from_log(cls, log: Mapping[str, np.ndarray], joint: int) -> UsualMotion:
        """Measure a log.

        Args:
            log: columns (T,) by name.
            joint: its number, from 1.

        Returns:
            What the log shows of the joint.

        """
        torque, position = log[f"motor_torque_{joint}"], log[f"joint_position_{joint}"]
        return cls(
            torque=float(np.sqrt(np.mean(torque**2))),
            speed=float(np.sqrt(np.mean(np.gradient(position, 1 / RATE) ** 2))),
            peak=float(np.abs(torque).max()),
            start=float(position[0]),
            lowest=float(position.min()),
            highest=float(position.max()),
        )


def draw_effect(case: ModelCase, without: Mapping[str, np.ndarray]) -> Values:
    """Draw the parameters of a case's effect; its size is the case's.

    Args:
        case: the case.
        without: the log of the same motion without it, which sizes what has no size of its own.

    Returns:
        The parameters, SI.

    """
    rng = seeded_generator(str(case.seed), "effect")

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** case.size)

    usual = UsualMotion.from_log(without, max(case.joint, 1))
    match case.effect:
        case "coulomb_friction":
            return {"torque": between(0.1, 0.5) * usual.torque}
        case "viscous_friction":
            return {"coefficient": between(0.1, 0.5) * usual.torque / usual.speed}
        case "payload":
            place = rng.uniform(-0.05, 0.05, 3)
            mass = between(0.05, 0.2) * sum(one["mass"] for one in case.robot.table["joint"][-3:])
            return {"mass": mass, **dict(zip("xyz", map(float, place), strict=True))}
        case "gravity_tilt":
            return {"angle": between(0.02, 0.08), "about": float(rng.uniform(0.0, 2.0 * math.pi))}
        case "command_delay" | "current_loop_lag":
            return {"time": between(0.002, 0.01)}
        case "current_saturation":
            return {"limit": between(0.5, 0.85) * usual.peak}
        case "motor_inertia":
            return _draw_rotor(case, between(1.5, 3.0), between(0.1, 0.5))
        case "missing_compliance":
            return _draw_compliance(case, between(2e-3, 8e-3), rng, usual)
        case "backlash":
            return _draw_play(case, between(2e-3, 8e-3), usual)
        case "cable_spring":
            rest = usual.start + float(rng.uniform(-0.4, 0.4))
            return {"stiffness": between(0.1, 0.4) * usual.torque, "rest": rest}
        case "contact":
            return _draw_contact(between(0.05, 0.2), rng, usual)
        case "encoder_eccentricity":
            return {"share": between(5e-4, 2e-3), "phase": float(rng.uniform(-math.pi, math.pi))}
    raise AssertionError(case.effect)


def _draw_rotor(case: ModelCase, factor: float, share: float) -> Values:
    """The true rotor, kg m²: a multiple of the stated one, or a share of what the joint moves where none is stated."""
    table = case.robot.table
    stated = float(table["joint"][case.joint - 1]["drive"]["motor_inertia"])
    return {"inertia": factor * stated or share * measure_inertia(table, case.joint)}


def _draw_compliance(case: ModelCase, yields: float, rng: np.random.Generator, usual: UsualMotion) -> Values:
    """A spring that ``yields``, rad, at the usual torque."""
    ease = measure_gear(case.robot.table, case.joint)
    frequency = min(math.sqrt(min(usual.torque, SOFTEST_TORQUE) / yields * ease), FASTEST_GEAR)
    damping = 2.0 * float(rng.uniform(0.05, 0.2)) * frequency / ease
    return {"compliance": ease / frequency**2, "damping": damping}


def _draw_play(case: ModelCase, width: float, usual: UsualMotion) -> Values:
    """A play between stops that yield little: ``compliance`` and ``damping`` of either."""
    ease = measure_gear(case.robot.table, case.joint)
    frequency = min(math.sqrt(usual.torque / (PLAY_GIVE * width) * ease), FASTEST_GEAR)
    damping = 2.0 * PLAY_DAMPING_RATIO * frequency / ease
    return {"width": width, "compliance": ease / frequency**2, "damping": damping}


def _draw_contact(depth: float, rng: np.random.Generator, usual: UsualMotion) -> Values:
    """A stop ``depth`` inside the reach on one side; the arm begins outside of it."""
    side = float(rng.choice([-1.0, 1.0]))
    reach = {1.0: usual.highest - usual.start, -1.0: usual.start - usual.lowest}
    if reach[side] <= depth:
        side = -side
    angle = usual.start + side * max(reach[side] - depth, LEAST_FREE_SHARE * reach[side])
    stiffness = usual.torque * draw_log_uniform(rng, 10.0, 40.0)
    return {"angle": angle, "side": side, "stiffness": stiffness, "damping": 0.02 * stiffness}
