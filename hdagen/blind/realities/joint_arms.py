"""Chains of one to three joints at joint scale, as logs of robots in the field have them: angle and effort, gravity on.

Ratios are 1 and rotors are armatures; half of the chains have springs that the robot file states. Drawing simulates
nothing. Legend: J joints; torques at the joint, N m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdagen.blind.realities.effect_sizes import EffectSize
from hdagen.blind.realities.joint_effects import JOINT_EFFECTS, NEVER_AT_JOINTS, draw_unknown_joint_torque
from hdagen.blind.realities.joint_motion import JointMotion, compute_link_torques, draw_joint_motion
from hdagen.blind.realities.misstated_numbers import (
    EFFECT_SHARE,
    WrongNumber,
    draw_wrong_numbers,
    misstate_numbers,
    restore_numbers,
)
from hdagen.blind.realities.population import Population
from hdagen.blind.realities.random_streams import draw_log_uniform, purpose_digest, seeded_generator
from hdagen.blind.realities.rigid_joints import SERIES_SPRING_KEYS, JointRobot
from hdagen.blind.realities.two_joint_arms import (
    LARGEST_SIZE,
    MOST_DEVIATIONS,
    PARAMETER_SCATTER,
    SMALLEST_SIZE,
    SMALLEST_SIZE_OF_TWO,
    TrueEffect,
    label_truth,
)

CHAIN_RATES = (100, 200, 250, 500, 1000)  # Hz, of logs
CHAIN_SIZING_SECONDS = 15.0  # s of the log's motion, over which usual torque and speed are taken
SCATTERED_CHAIN_PARAMETERS = (
    "mass",
    "center_of_mass",
    "inertia",
    "motor_inertia",
    "coulomb_friction",
    "viscous_friction",
    "flexspline_stiffness",
    "torsional_damping",
)
CHAIN_GRAVITY = (0.0, -9.81)  # m/s²
_STIFF_RATIO = 1e4  # of the wave generator's spring by the flexspline's: as good as none
_SPRING_DAMPING = 0.1  # damping ratio of a spring against its link


@dataclass(frozen=True)
class JointArmCase:
    """A case before it is simulated. ``robot`` as its file states it; ``rate`` of the log, Hz; ``commanded``: the log
    has commands; ``truth``: the effects to find; ``background``: size of every other effect; ``speeds``, rad/s, that
    each joint's motion seldom passes; ``seed`` of everything else; ``numbers`` of the file that are wrong."""

    name: str
    kind: str
    robot: JointRobot
    rate: int
    commanded: bool
    truth: tuple[TrueEffect, ...]
    background: float
    speeds: tuple[float, ...]
    seed: int
    numbers: tuple[WrongNumber, ...] = ()

    @property
    def machine(self) -> JointRobot:
        """The robot as a right file would state it; true parameters scatter about it."""
        return replace(self.robot, joints=tuple(restore_numbers(self.robot.joints, self.numbers)))

    def draw_motion(self, which: str, seconds: float) -> JointMotion:
        """Draw the motion of the log or of the hold-out.

        Args:
            which: "log" or "hold_out".
            seconds: length of the motion, s.

        Returns:
            The reference of all joints.

        """
        return draw_joint_motion(seeded_generator(str(self.seed), "motion", which), self.speeds, seconds)

    def label(self) -> dict[str, Any]:
        """The truth that is sealed."""
        return label_truth(self.kind, self.numbers, self.truth, self.background, self.seed)

    def true_diagnosis(self) -> None:
        """None: no diagnosis.json can state the truth, as the model has other formulas."""

    def true_joints(self) -> list[dict[str, float]]:
        """The true base parameters, a joint each."""
        rng, true = seeded_generator(str(self.seed), "base"), []
        for joint in self.machine.joints:
            off = rng.standard_normal(len(SCATTERED_CHAIN_PARAMETERS))
            scale = 1.0 + PARAMETER_SCATTER * np.clip(off, -MOST_DEVIATIONS, MOST_DEVIATIONS)
            known = dict(zip(SCATTERED_CHAIN_PARAMETERS, scale.tolist(), strict=True))
            true.append({key: value * known.get(key, 1.0) for key, value in joint.items()})
        return true

    def effect_parameters(self, seconds: float) -> dict[tuple[str, int], dict[str, float]]:
        """Draw the parameters of every effect in reality.

        Args:
            seconds: length of the log, s, whose reach places walls.

        Returns:
            Parameters by effect and joint (from 1; 0 is the whole arm), SI.

        """
        bases, found = self._describe_joints(seconds), {}
        truth = {(one.effect, one.joint): one.size for one in self.truth}
        for effect, size in JOINT_EFFECTS.items():
            for joint in list_places(size, len(bases)):
                multiple = truth.get((effect, joint), 0.0 if effect in NEVER_AT_JOINTS else self.background)
                if multiple and (effect != "stiffness" or SERIES_SPRING_KEYS[0] in bases[joint - 1]):
                    rng = seeded_generator(str(self.seed), effect, joint)
                    found[effect, joint] = size.draw(multiple * size.typical, rng, bases[max(joint, 1) - 1])
        for one in self.truth:
            if one.effect == "unknown":
                rng = seeded_generator(str(self.seed), "unknown", one.joint)
                usual = bases[one.joint - 1]["usual_torque"]
                found["unknown", one.joint] = draw_unknown_joint_torque(one.size, rng, usual)
        return found

    def _describe_joints(self, seconds: float) -> list[dict[str, float]]:
        """The right file's numbers of each joint with usual torque, usual speed and reach of the log's motion."""
        joints, motion = self.machine.joints, self.draw_motion("log", CHAIN_SIZING_SECONDS)
        torque, speed = find_usual_motion(joints, motion)
        reached = self.draw_motion("log", seconds).position
        return [
            {**joint, "usual_torque": t, "usual_speed": v, "lowest": float(low), "highest": float(high)}
            for joint, t, v, low, high in zip(
                joints, torque, speed, reached.min(axis=0), reached.max(axis=0), strict=True
            )
        ]


def find_usual_motion(joints: Sequence[Mapping[str, float]], motion: JointMotion) -> tuple[list[float], list[float]]:
    """Find usual torque and speed of each joint.

    Args:
        joints: base parameters, SI.
        motion: the reference.

    Returns:
        Torques without friction, N m, and speeds, rad/s, both rms.

    """
    asked = compute_link_torques(joints, CHAIN_GRAVITY, motion.position, motion.velocity, motion.acceleration)
    torque, speed = (np.sqrt(np.mean(x**2, axis=0)) for x in (asked, motion.velocity))
    return torque.tolist(), speed.tolist()


def list_places(size: EffectSize, count: int) -> tuple[int, ...]:
    """List the joints at which an effect may be.

    Args:
        size: the effect.
        count: number of joints.

    Returns:
        Numbers of joints; 0 for the whole arm.

    """
    return {"each": tuple(range(1, count + 1)), "last": (count,), "arm": (0,)}[size.joints]


def draw_joint_arm_cases(seed: str, population: Population, count: int) -> tuple[JointArmCase, ...]:
    """Draw the first cases of a population.

    Args:
        seed: the seed of the check.
        population: of the family of joints.
        count: how many cases.

    Returns:
        The cases, in an order that the seed decides; a larger ``count`` appends to them.

    """
    own = population.seed_family(seed)
    return tuple(_draw_case(own, population, index) for index in range(count))


def _draw_case(seed: str, population: Population, index: int) -> JointArmCase:
    rng = seeded_generator(seed, population.kind, index)
    wanted = _choose_effects(seed, population.kind, index, rng)
    count, rate = int(rng.integers(1, 4)), int(rng.choice(CHAIN_RATES))
    elastic = bool(rng.random() < 0.5)
    if "stiffness" in wanted or "missing_compliance" in wanted:
        elastic = "stiffness" in wanted
    commanded = "command_delay" in wanted or bool(rng.random() < 0.7)
    speeds = tuple(draw_log_uniform(rng, 0.8, 3.0) for _ in range(count))
    least = SMALLEST_SIZE_OF_TWO if population.kind == "unknown+one" else SMALLEST_SIZE
    truth = tuple(_draw_effect(effect, count, rng, least) for effect in wanted)
    seed_of_case = int(rng.integers(2**62))
    motion = draw_joint_motion(seeded_generator(str(seed_of_case), "motion", "log"), speeds, CHAIN_SIZING_SECONDS)
    joints = _draw_chain(rng, count, motion, elastic)
    numbers: tuple[WrongNumber, ...] = ()
    if population.kind == "rough":
        numbers = draw_wrong_numbers(rng, joints, [str(one) for one in truth])
    name = f"chain-{purpose_digest(seed, population.kind, index, 'robot').hex()[:10]}"
    encoder = "motor" if elastic else "joint"
    robot = JointRobot(name, CHAIN_GRAVITY, tuple(misstate_numbers(joints, numbers)), encoder, False)
    folder = purpose_digest(seed, population.kind, index, "name").hex()[:16]
    background = population.size_background(index)
    return JointArmCase(
        folder, population.kind, robot, rate, commanded, truth, background, speeds, seed_of_case, numbers
    )


def _choose_effects(seed: str, kind: str, index: int, rng: np.random.Generator) -> tuple[str, ...]:
    """Choose the effects of a case; of one effect, every effect occurs once in each block."""
    names = list(JOINT_EFFECTS)
    if kind == "none" or (kind == "rough" and rng.random() >= EFFECT_SHARE):
        return ()
    if kind == "unknown":
        return ("unknown",)
    if kind == "pair":
        first, second = (str(one) for one in rng.choice(names, 2, replace=False))
        if {first, second} == {"stiffness", "missing_compliance"}:  # no file has a spring and calls the joint rigid
            return first, "payload"
        return first, second
    block, place = divmod(index, len(names))
    order = seeded_generator(seed, kind, "order", block).permutation(len(names))
    one = names[int(order[place])]
    return (one, "unknown") if kind == "unknown+one" else (one,)


def _draw_effect(effect: str, count: int, rng: np.random.Generator, least: float) -> TrueEffect:
    places = tuple(range(1, count + 1))
    if effect != "unknown":
        places = list_places(JOINT_EFFECTS[effect], count)
    return TrueEffect(effect, int(rng.choice(places)), draw_log_uniform(rng, least, LARGEST_SIZE))


def _draw_chain(
    rng: np.random.Generator, count: int, motion: JointMotion, elastic: bool
) -> tuple[dict[str, float], ...]:
    """Draw links, armatures, and what follows from the torques that the motion asks of them."""
    links: list[dict[str, float]] = []
    mass = draw_log_uniform(rng, 1.0, 8.0)
    for _ in range(count):
        length = float(rng.uniform(0.2, 0.45))
        center = length * float(rng.uniform(0.35, 0.6))
        own = mass * length**2 * float(rng.uniform(0.06, 0.12))
        armature = (own + mass * center**2) * draw_log_uniform(rng, 0.15, 0.8)
        stated = {"length": length, "mass": mass, "center_of_mass": center, "inertia": own, "motor_inertia": armature}
        links.append({**{key: round_digits(value) for key, value in stated.items()}, "ratio": 1.0})
        mass *= float(rng.uniform(0.5, 0.8))
    torque, speed = find_usual_motion(links, motion)
    return tuple(
        {**link, **_draw_friction(rng, t, v), **_draw_sensor(rng, t), **(_draw_spring(rng, link, t) if elastic else {})}
        for link, t, v in zip(links, torque, speed, strict=True)
    )


def _draw_friction(rng: np.random.Generator, torque: float, speed: float) -> dict[str, float]:
    return {
        "coulomb_friction": round_digits(torque * float(rng.uniform(0.08, 0.15))),
        "viscous_friction": round_digits(torque * float(rng.uniform(0.03, 0.06)) / speed),
    }


def _draw_sensor(rng: np.random.Generator, torque: float) -> dict[str, float]:
    """An encoder whose counts per turn are a power of two, and the noise of the effort."""
    resolution = 2.0 * math.pi / 2 ** round(math.log2(2.0 * math.pi / draw_log_uniform(rng, 5e-6, 1.5e-4)))
    return {
        "resolution": resolution,
        "encoder_noise": round_digits(resolution * float(rng.uniform(0.0, 0.5))),
        "input_noise": round_digits(torque * draw_log_uniform(rng, 0.003, 0.01)),
    }


def _draw_spring(rng: np.random.Generator, link: Mapping[str, float], torque: float) -> dict[str, float]:
    """A spring that yields by 0.01 to 0.03 rad at the usual torque and stiffens a little."""
    stiffness = torque / draw_log_uniform(rng, 0.01, 0.03)
    inertia = link["inertia"] + link["mass"] * link["center_of_mass"] ** 2
    values = (
        stiffness,
        0.1 / torque,
        _STIFF_RATIO * stiffness,
        1e-3,
        2.0 * _SPRING_DAMPING * math.sqrt(stiffness * inertia),
    )
    return {key: round_digits(value) for key, value in zip(SERIES_SPRING_KEYS, values, strict=True)}


def round_digits(value: float, digits: int = 4) -> float:
    """Round a number as a robot file has it.

    Args:
        value: the number.
        digits: significant digits that stay.

    Returns:
        The rounded number.

    """
    return float(f"{value:.{digits}g}")
