"""What a seed stands for: cases of each kind, of the family that has it, drawn without simulating anything."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from hdagen.blind import arms, joints


class Robot(Protocol):
    """A robot as its file states it."""

    def toml(self) -> str:
        """robot.toml."""

    def noise(self) -> Mapping[str, float]:
        """Standard deviation of the noise of each channel that a gap is counted over."""


class Case(Protocol):
    """A case before it is simulated."""

    @property
    def name(self) -> str:
        """Of its folder; says nothing."""

    @property
    def kind(self) -> str:
        """One of `hdagen.blind.KINDS`."""

    @property
    def robot(self) -> Robot:
        """The robot whose file the diagnosis sees."""

    def label(self) -> dict[str, Any]:
        """What is sealed."""

    def true_set(self) -> dict[str, Any] | None:
        """What a diagnosis.json would hold that knows what is true; None where none can."""


def cases(seed: str, kind: str, count: int) -> tuple[Case, ...]:
    """The first ``count`` cases of a kind, in their own order; more of them begin with the same ones."""
    return joints.cases(seed, count) if kind == joints.KIND else arms.cases(seed, kind, count)
