"""Numbers of a robot file that are wrong by a factor: which, by how much, and what the file then says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.blind.realities.random_streams import draw_log_uniform

MOST_WRONG_NUMBERS = 4
EFFECT_SHARE = 0.6  # share of cases with an effect beside the numbers


@dataclass(frozen=True)
class NumberRange:
    """The ``key`` in the robot file, and the ``low`` and ``high`` end of the ratio by which it is off, up or down."""

    key: str
    low: float
    high: float


# by the name that a verdict gives them; the least ratio is three tolerances away, or counts as an effect's usual size
NUMBER_RANGES: Mapping[str, NumberRange] = {
    "motor_inertia": NumberRange("motor_inertia", 1.3, 2.0),
    "mass": NumberRange("mass", 1.2, 1.5),
    "center_of_mass": NumberRange("center_of_mass", 1.2, 1.4),
    "inertia": NumberRange("inertia", 1.4, 2.0),
    "torque_constant": NumberRange("torque_constant", 1.15, 1.4),
    "coulomb_friction": NumberRange("coulomb_friction", 1.6, 6.0),
    "viscous_friction": NumberRange("viscous_friction", 1.8, 6.0),
    "stiffness": NumberRange("flexspline_stiffness", 1.4, 2.0),
    "joint_damping": NumberRange("torsional_damping", 2.0, 5.0),
}


@dataclass(frozen=True)
class WrongNumber:
    """A number of the file: its ``name`` in a verdict, its ``joint`` from 1, and the ``factor``, truth over file."""

    name: str
    joint: int
    factor: float

    def __str__(self) -> str:
        return f"{self.name}@{self.joint}"


def draw_wrong_numbers(
    rng: np.random.Generator, joints: Sequence[Mapping[str, float]], besides: Sequence[str] = ()
) -> tuple[WrongNumber, ...]:
    """Draw which numbers of a robot file are wrong.

    Args:
        rng: the random generator.
        joints: base parameters of each joint by the keys of its tables; one that is 0 or not there is not wrong.
        besides: name@joint of effects that are there, which stand for their number themselves.

    Returns:
        One to `MOST_WRONG_NUMBERS` numbers, each at one joint.

    """
    possible = [
        (name, j)
        for j, joint in enumerate(joints, 1)
        for name, limits in NUMBER_RANGES.items()
        if joint.get(limits.key) and f"{name}@{j}" not in besides
    ]
    count = int(rng.integers(1, MOST_WRONG_NUMBERS + 1))
    chosen = rng.choice(len(possible), min(count, len(possible)), replace=False)
    found = []
    for at in sorted(chosen.tolist()):
        name, joint = possible[at]
        ratio = draw_log_uniform(rng, NUMBER_RANGES[name].low, NUMBER_RANGES[name].high)
        found.append(WrongNumber(name, joint, float(ratio if rng.random() < 0.5 else 1.0 / ratio)))
    return tuple(found)


def misstate_numbers(joints: Sequence[Mapping[str, float]], wrong: Sequence[WrongNumber]) -> list[dict[str, float]]:
    """State the numbers as the wrong file does.

    Args:
        joints: base parameters that the file should state.
        wrong: the numbers that are wrong.

    Returns:
        Base parameters as the file states them.

    """
    return _scale_numbers(joints, {str(one): 1.0 / one.factor for one in wrong})


def restore_numbers(joints: Sequence[Mapping[str, float]], wrong: Sequence[WrongNumber]) -> list[dict[str, float]]:
    """Undo `misstate_numbers`.

    Args:
        joints: base parameters as the file states them.
        wrong: the numbers that are wrong.

    Returns:
        Base parameters that the file should state.

    """
    return _scale_numbers(joints, {str(one): one.factor for one in wrong})


def _scale_numbers(joints: Sequence[Mapping[str, float]], factors: Mapping[str, float]) -> list[dict[str, float]]:
    scaled = [dict(joint) for joint in joints]
    for name, factor in factors.items():
        effect, _, joint = name.partition("@")
        scaled[int(joint) - 1][NUMBER_RANGES[effect].key] *= factor
    return scaled
