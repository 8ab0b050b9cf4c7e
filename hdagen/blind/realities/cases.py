"""The cases of a seed: each kind belongs to a family of arms or of joints. Drawing them simulates nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from hdagen.blind.realities import rigid_joints, two_joint_arms


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
        """One of `hdagen.blind.KINDS`."""

    @property
    def robot(self) -> Robot:
        """The robot whose file the diagnosis sees."""

    def label(self) -> dict[str, Any]:
        """The truth that is sealed."""

    def true_diagnosis(self) -> dict[str, Any] | None:
        """A diagnosis.json that states the truth; None where no diagnosis.json can."""


def draw_cases(seed: str, kind: str, count: int) -> tuple[Case, ...]:
    """Draw the first cases of a kind.

    Args:
        seed: the seed of the check.
        kind: one of `hdagen.blind.KINDS`.
        count: how many cases.

    Returns:
        The cases, in an order that the seed decides; a larger ``count`` appends to them.

    """
    if kind == rigid_joints.KIND:
        return rigid_joints.draw_joint_cases(seed, count)
    return two_joint_arms.draw_arm_cases(seed, kind, count)
