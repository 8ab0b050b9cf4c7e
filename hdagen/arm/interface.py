"""A compiled arm as ratings and step limits see it: its description, its parameters, and its functions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from numpy.typing import ArrayLike

from hdagen.arm.arm_parameters import Parameters
from hdagen.arm.arrays import Array
from hdagen.arm.effect_catalogue import EffectCatalogue


class ArmInterface(Protocol):
    """What is asked of an arm beside its simulation; `hdagen.arm.compiled_arm.Arm` has it."""

    n: int
    parameters: Parameters
    effects: EffectCatalogue

    @property
    def manifest(self) -> Mapping[str, Any]:
        """The build's description of itself."""

    def with_parameters(self, p: Array) -> ArmInterface:
        """The same arm with the parameters ``p`` (np)."""

    def evaluate(self, name: str, **inputs: ArrayLike) -> dict[str, Array]:
        """The outputs of one of the build's functions by name."""
