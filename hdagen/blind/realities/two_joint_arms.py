"""Two-joint arms, and cases of them with their true effects. Drawing them simulates nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import tomlkit

from hdagen.blind.realities.effect_sizes import EFFECT_SIZES, NEVER_IN_BACKGROUND, EffectSize, draw_unknown_torque
from hdagen.blind.realities.misstated_numbers import (
    EFFECT_SHARE,
    WrongNumber,
    draw_wrong_numbers,
    misstate_numbers,
    restore_numbers,
)
from hdagen.blind.realities.population import DRIVETRAIN, Population
from hdagen.blind.realities.random_streams import draw_log_uniform, purpose_digest, seeded_generator

SMALLEST_SIZE, LARGEST_SIZE = 0.5, 1.5  # smallest and largest size of a true effect, in typical sizes
SMALLEST_SIZE_OF_TWO = 0.7  # smallest size of a true effect beside an unknown one, in typical sizes
TOLERANCE = 0.05  # relative standard deviation that the robot file states
PARAMETER_SCATTER, MOST_DEVIATIONS = (
    0.04,
    2.5,
)  # relative standard deviation of the true parameters; the largest deviation in these
SCATTERED_PARAMETERS = (
    "mass",
    "center_of_mass",
    "inertia",
    "motor_inertia",
    "torque_constant",
    "viscous_friction",
    "coulomb_friction",
    "flexspline_stiffness",
    "flexspline_stiffening",
    "wave_generator_stiffness",
    "wave_generator_stiffening",
    "torsional_damping",
)  # without lengths, which are measured, and ratios, which are counted
NOMINAL_DRIVE = {  # CSG-17-100, docs/method/errata.md; motor of 52.5 mN m/A
    "ratio": 100.0,
    "motor_inertia": 1.289e-4,
    "torque_constant": 0.0525,
    "max_current": 15.0,
    "viscous_friction": 4e-5,
    "coulomb_friction": 0.037,
    "flexspline_stiffness": 9743.94,
    "flexspline_stiffening": 0.08313,
    "wave_generator_stiffness": 2.5517,
    "wave_generator_stiffening": 27.027,
    "torsional_damping": 6.0,
}
NOMINAL_SENSOR = {
    "motor_encoder_resolution": 2.0 * np.pi / 4096,
    "joint_encoder_resolution": 2.0 * np.pi / 2**20,
    "current_noise": 0.01,
}
LINK_KEYS = ("length", "mass", "center_of_mass", "inertia")
_UNSEEN_BY_TASK = ("contact", "current_saturation")  # sized by the ends of the motion, which a circle hardly touches


@dataclass(frozen=True)
class TwoJointArm:
    """A two-joint arm as its file states it. ``joints``: keys of the tables link, drive and sensor together, SI."""

    name: str
    gravity: tuple[float, float]
    joints: tuple[dict[str, float], dict[str, float]]

    def toml(self) -> str:
        """robot.toml."""
        document = tomlkit.document()
        document.update({"name": self.name, "gravity": list(self.gravity), "tolerance": TOLERANCE})
        tables = tomlkit.aot()
        for joint in self.joints:
            table = tomlkit.table()
            table.update({key: joint[key] for key in LINK_KEYS})
            table["drive"] = {key: joint[key] for key in NOMINAL_DRIVE}
            table["sensor"] = {key: float(joint[key]) for key in NOMINAL_SENSOR}
            tables.append(table)
        document["joint"] = tables
        return tomlkit.dumps(document)

    def noise(self) -> dict[str, float]:
        """Standard deviation of the noise of each channel that a model predicts."""
        found = {}
        for j, joint in enumerate(self.joints, 1):
            found[f"motor_current_{j}"] = joint["current_noise"]
            found[f"motor_position_{j}"] = joint["motor_encoder_resolution"] / math.sqrt(12.0)
            found[f"joint_position_{j}"] = joint["joint_encoder_resolution"] / math.sqrt(12.0)
        return found


@dataclass(frozen=True)
class TrueEffect:
    """An effect in reality: ``joint`` from 1, 0 for the whole arm; ``size`` in multiples of the typical one."""

    effect: str
    joint: int
    size: float

    def __str__(self) -> str:
        return f"{self.effect}@{self.joint}"


def label_truth(
    kind: str, numbers: Sequence[WrongNumber], truth: Sequence[TrueEffect], background: float, seed: int
) -> dict[str, Any]:
    """Label a case: the truth that is sealed.

    Args:
        kind: the kind of the case.
        numbers: the numbers of the robot file that are wrong.
        truth: the effects to find.
        background: size of every other effect.
        seed: of everything else.

    Returns:
        The label, as `hdagen.blind.scores` reads it.

    """
    label: dict[str, Any] = {
        "kind": kind,
        "verdict": [str(one) for one in (*numbers, *truth)],
        "sizes": [*(one.factor for one in numbers), *(one.size for one in truth)],
    }
    if numbers:
        label["numbers"] = {str(one): one.factor for one in numbers}
    return label | {"background": background, "seed": seed}


@dataclass(frozen=True)
class ArmCase:
    """A case before it is simulated. ``name`` of its folder; ``robot`` as its file states it; ``truth``: the effects to
    find; ``background``: size of every other effect; ``seed`` of everything else; ``numbers`` of the file that are
    wrong; ``family`` of the reality."""

    name: str
    kind: str
    robot: TwoJointArm
    truth: tuple[TrueEffect, ...]
    background: float
    seed: int
    numbers: tuple[WrongNumber, ...] = ()
    family: str = DRIVETRAIN

    @property
    def machine(self) -> TwoJointArm:
        """The robot as a right file would state it; true parameters scatter about it."""
        if not self.numbers:
            return self.robot
        first, second = restore_numbers(self.robot.joints, self.numbers)
        return replace(self.robot, joints=(first, second))

    def label(self) -> dict[str, Any]:
        """The truth that is sealed."""
        return label_truth(self.kind, self.numbers, self.truth, self.background, self.seed)

    def true_diagnosis(self) -> None:
        """None: no diagnosis.json can state the truth, as the model has other formulas."""


def draw_robots(seed: str) -> tuple[TwoJointArm, ...]:
    """Draw the robots of a check: two that lie flat and one that stands, of random size and meaningless name.

    Args:
        seed: the seed of the check.

    Returns:
        The robots as their files state them.

    """
    return tuple(_draw_robot(seed, at, gravity) for at, gravity in enumerate([(0.0, 0.0), (0.0, -9.81), (0.0, 0.0)]))


def _draw_robot(seed: str, at: int, gravity: tuple[float, float]) -> TwoJointArm:
    rng = seeded_generator(seed, "robot", at)
    links = []
    for mass, inertia in ((1.6, 0.03), (0.9, 0.012)):
        length = round(float(rng.uniform(0.14, 0.2)), 3)
        links.append(
            {
                "length": length,
                "mass": round(mass * float(rng.uniform(0.8, 1.25)), 3),
                "center_of_mass": round(length * float(rng.uniform(0.45, 0.6)), 3),
                "inertia": round(inertia * float(rng.uniform(0.75, 1.3)), 4),
            }
        )
    first, second = ({**link, **NOMINAL_DRIVE, **NOMINAL_SENSOR} for link in links)
    return TwoJointArm(f"arm-{purpose_digest(seed, 'robot', at).hex()[:10]}", gravity, (first, second))


def draw_arm_cases(seed: str, population: Population, count: int) -> tuple[ArmCase, ...]:
    """Draw the first cases of a population.

    Args:
        seed: the seed of the check.
        population: of a family of two-joint arms.
        count: how many cases.

    Returns:
        The cases, in an order that the seed decides; a larger ``count`` appends to them.

    """
    own = population.seed_family(seed)
    arms = draw_robots(own)
    return tuple(_draw_case(own, population, index, arms) for index in range(count))


def _draw_case(seed: str, population: Population, index: int, arms: Sequence[TwoJointArm]) -> ArmCase:
    kind = population.kind
    rng = seeded_generator(seed, kind, index)
    if kind == "none" or (kind == "rough" and rng.random() >= EFFECT_SHARE):
        truth: tuple[TrueEffect, ...] = ()
    elif kind == "unknown":
        truth = (TrueEffect("unknown", int(rng.integers(1, 3)), _draw_size(rng)),)
    elif kind == "pair":
        first, second = rng.choice(list(EFFECT_SIZES), 2, replace=False)
        truth = (_draw_effect(str(first), rng), _draw_effect(str(second), rng))
    else:
        least = SMALLEST_SIZE
        if kind == "unknown+one":
            least = SMALLEST_SIZE_OF_TWO
        names = [name for name in EFFECT_SIZES if kind != "task" or name not in _UNSEEN_BY_TASK]
        block, place = divmod(index, len(names))  # every effect occurs once in each block
        order = seeded_generator(seed, kind, "order", block).permutation(len(names))
        truth = (_draw_effect(names[int(order[place])], rng, least),)
        if kind == "unknown+one":
            truth = (*truth, TrueEffect("unknown", int(rng.integers(1, 3)), _draw_size(rng, least)))
    background = population.size_background(index)
    seed_of_case = int(rng.integers(2**62))
    name = purpose_digest(seed, kind, index, "name").hex()[:16]
    arm = arms[int(rng.integers(3))]
    numbers: tuple[WrongNumber, ...] = ()
    if kind == "rough":
        numbers = draw_wrong_numbers(rng, arm.joints, [str(one) for one in truth])
        first, second = misstate_numbers(arm.joints, numbers)
        arm = replace(arm, name=f"arm-{purpose_digest(seed, kind, index, 'robot').hex()[:10]}", joints=(first, second))
    return ArmCase(name, kind, arm, truth, background, seed_of_case, numbers, population.family)


def _draw_size(rng: np.random.Generator, least: float = SMALLEST_SIZE) -> float:
    return draw_log_uniform(rng, least, LARGEST_SIZE)


def _draw_effect(effect: str, rng: np.random.Generator, least: float = SMALLEST_SIZE) -> TrueEffect:
    joint = {"each": int(rng.integers(1, 3)), "last": 2, "arm": 0}[EFFECT_SIZES[effect].joints]
    return TrueEffect(effect, joint, _draw_size(rng, least))


def draw_true_parameters(robot: TwoJointArm, seed: int) -> list[dict[str, float]]:
    """Draw the true base parameters of a case.

    Args:
        robot: the robot as its file states it.
        seed: the seed of the case.

    Returns:
        Base parameters of each joint by the keys of its tables, SI.

    """
    rng = seeded_generator(str(seed), "base")
    true = []
    for joint in robot.joints:
        off = (
            np.clip(rng.standard_normal(len(SCATTERED_PARAMETERS)), -MOST_DEVIATIONS, MOST_DEVIATIONS)
            * PARAMETER_SCATTER
        )
        true.append(
            {**joint, **{key: joint[key] * (1.0 + float(d)) for key, d in zip(SCATTERED_PARAMETERS, off, strict=True)}}
        )
    return true


def draw_effect_parameters(
    case: ArmCase, ends: Mapping[int, Mapping[str, float]]
) -> dict[tuple[str, int], dict[str, float]]:
    """Draw the parameters of every effect in reality.

    Args:
        case: the drawn case.
        ends: limits of the motion by joint (from 1): ``peak`` current, A, ``lowest`` and ``highest`` angle, rad. They
            size saturation and walls.

    Returns:
        Parameters by effect and joint (from 1; 0 is the whole arm), SI.

    """
    truth = {(one.effect, one.joint): one.size for one in case.truth}
    found = {}
    for effect, size in EFFECT_SIZES.items():
        for joint in _joints_of(size):
            background = 0.0 if effect in NEVER_IN_BACKGROUND else case.background
            multiple = truth.get((effect, joint), background)
            if multiple:
                base = {**case.machine.joints[max(joint, 1) - 1], **ends[max(joint, 1)]}
                found[effect, joint] = size.draw(
                    multiple * size.typical, seeded_generator(str(case.seed), effect, joint), base
                )
    for one in case.truth:
        if one.effect == "unknown":
            found["unknown", one.joint] = draw_unknown_torque(
                one.size, seeded_generator(str(case.seed), "unknown", one.joint)
            )
    return found


def _joints_of(size: EffectSize) -> tuple[int, ...]:
    return {"each": (1, 2), "last": (2,), "arm": (0,)}[size.joints]
