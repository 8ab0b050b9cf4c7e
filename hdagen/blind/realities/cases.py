"""The cases of a seed, of each family and kind. Drawing them simulates nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from hdagen.blind.realities import joint_arms, model_arms, rigid_joints, two_joint_arms
from hdagen.blind.realities.population import FRICTION_KIND, JOINT, MODEL, Population


class Robot(Protocol):
    """A robot as its file states it."""

    def toml(self) -> str:
        """Write the text of the robot.toml."""

    def noise(self) -> Mapping[str, float]:
        """Standard deviation of the noise of each channel that the gap is measured on."""


class Case(Protocol):
    """A case before it is simulated."""

    @property
    def name(self) -> str:
        """Name of the case's folder; it reveals nothing."""

    @property
    def kind(self) -> str:
        """A kind of `hdagen.blind.realities.population`."""

    @property
    def robot(self) -> Robot:
        """The robot whose file the diagnosis sees."""

    def label(self) -> dict[str, Any]:
        """The truth that is sealed."""

    def true_diagnosis(self) -> dict[str, Any] | None:
        """A diagnosis.json that states the truth; None where no diagnosis.json can."""


def draw_cases(seed: str, population: Population, count: int) -> tuple[Case, ...]:
    """Draw the first cases of a population.

    Args:
        seed: the seed of the check.
        population: family, kind, background and model.
        count: how many cases.

    Returns:
        The cases, in an order that the seed decides; a larger ``count`` appends to them.

    """
    if population.kind == FRICTION_KIND:
        return rigid_joints.draw_joint_cases(seed, count)
    if population.family == MODEL:
        return model_arms.draw_model_cases(seed, population, count)
    if population.family == JOINT:
        return joint_arms.draw_joint_arm_cases(seed, population, count)
    return two_joint_arms.draw_arm_cases(seed, population, count)
