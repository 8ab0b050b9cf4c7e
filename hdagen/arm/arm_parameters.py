"""Parameters of a compiled arm by name, each with its unit, bounds and tolerance."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping
from copy import copy
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hdagen.arm.arrays import Array, is_number
from hdagen.arm.build_loader import PlantError
from hdagen.support.messages import join_nearest_names


class UnknownParameter(PlantError, KeyError):
    """No parameter has that name: a PlantError for people, a KeyError for code that uses a mapping."""

    __str__ = Exception.__str__  # a KeyError would quote the sentence


VECTOR_ENTRIES = {  # of the robot file's lists of numbers, as the model names them
    "gravity": ("x", "y", "z"),
    "center_of_mass": ("x", "y", "z"),
    "inertia": ("xx", "yy", "zz", "xy", "xz", "yz"),
}


@dataclass(frozen=True)
class Parameter:
    """A parameter of the model.

    Attributes:
        name: Its name.
        joint: The joint's number; 0 for the whole arm.
        unit: Its unit.
        nominal: The robot file's value.
        low: The smallest value.
        high: The largest value.
        tolerance: The standard deviation of the robot file's value, as a share of ``reference_size``.
        reference_size: The size of the robot file's value; of an entry of a vector that of the vector.
        meaning: A phrase on it.
        effect: The effect whose amplitude or shape it is, if any.
        role: "base" (a key of the robot file), "amplitude" or "shape".
        typical: The usual difference from nominal.
        everywhere: The small difference that every machine has, where that is another than ``typical``.
        starts: For a shape, the values from which a search starts.
        is_guess: Whether the robot file's value is often a guess, so that the true one may be any multiple.
        search_unit: Of a shape, the step of a search, where a share of its value or range will not do.
        is_motor_order: Whether it counts cycles a turn of the motor: small steps do not lead from one to another.
        is_reading_delay: Whether it is the time, s, by which the joint's encoder is read late.
        encoder_term: How it shows in the difference between the encoders of its joint, if it does.
        equivalent: A key of the robot file from which a small change of this parameter cannot be told, if any.
        offset: With it, the parameter is the number that the robot file states: of a lumped inertia
            mass·center_of_mass².

    """

    name: str
    joint: int
    unit: str
    nominal: float
    low: float
    high: float
    tolerance: float
    reference_size: float
    meaning: str
    effect: str | None = None
    role: str = "base"
    typical: float | None = None
    everywhere: float | None = None
    starts: tuple[float, ...] = ()
    is_guess: bool = False
    search_unit: float | None = None
    is_motor_order: bool = False
    is_reading_delay: bool = False
    encoder_term: str | None = None
    equivalent: str | None = None
    offset: float = 0.0

    @property
    def stated(self) -> float:
        """The number that the robot file states."""
        return self.nominal + self.offset

    @property
    def deviation(self) -> float:
        """The standard deviation of the robot file's value, in its unit."""
        return self.tolerance * self.reference_size

    def compute_factor(self, value: float) -> float:
        """Compute the factor by which the robot file's number is wrong.

        Args:
            value: The true value of the parameter.

        Returns:
            Truth over file.

        """
        return (value + self.offset) / self.stated


class ParameterOwner(Protocol):
    """What has the values that `Parameters` names: a compiled arm."""

    p: Array

    def _set_parameters(self, p: Array) -> None:
        """Take the values ``p`` (np) from the next call on."""


class Parameters(MutableMapping[str, float]):
    """The arm's parameters by name; setting one takes effect at the next call. Values outside the bounds are
    refused."""

    def __init__(self, arm: ParameterOwner, described: dict[str, Parameter]) -> None:
        self._arm, self.described = arm, described
        self._indices = {name: k for k, name in enumerate(described)}

    def for_arm(self, arm: ParameterOwner) -> Parameters:
        """Make the same mapping for another arm.

        Args:
            arm: An arm of the same build.

        Returns:
            The mapping of its parameters.

        """
        other = copy(self)
        other._arm = arm
        return other

    def __getitem__(self, name: str) -> float:
        return float(self._arm.p[self.index(name)])

    def __setitem__(self, name: str, value: float) -> None:
        self.update({name: value})

    def update(self, *given: Any, **more: float) -> None:
        """Set several parameters at once, all of them or none.

        Args:
            given: A mapping of names to values, as `dict.update` takes it.
            more: Values by name.

        Raises:
            PlantError: A name is unknown or a value outside its bounds; every problem is listed.

        """
        values = dict(*given, **more)
        problems = []
        for name, value in values.items():
            self.index(name)
            described = self.described[name]
            if not is_number(value) or not described.low <= value <= described.high:
                problems.append(
                    f"parameter {name}: {value} {described.unit} is not within [{described.low:g}, "
                    f"{described.high:g}]; take a value inside, or change the robot file and build again."
                )
        if problems:
            raise PlantError("\n".join(problems))
        p = self._arm.p.copy()
        for name, value in values.items():
            p[self.index(name)] = value
        self._arm._set_parameters(p)

    def index(self, name: str) -> int:
        """Find the index of a parameter in p.

        Args:
            name: The parameter's name.

        Returns:
            The index.

        Raises:
            UnknownParameter: There is no such parameter.

        """
        if name not in self._indices:
            raise UnknownParameter(
                f"no parameter named {name}; there are {join_nearest_names([name], list(self.described))}."
            )
        return self._indices[name]

    def clip_to_bounds(self, p: Array) -> Array:
        """Clip parameters to their bounds.

        Args:
            p: (np), parameters.

        Returns:
            (np), each value moved to the nearest within its parameter's bounds.

        """
        low, high = np.array([(q.low, q.high) for q in self.described.values()]).T
        return np.clip(p, low, high)

    def reset(self) -> None:
        """Set all parameters back to the robot file's values."""
        self._arm._set_parameters(np.array([q.nominal for q in self.described.values()]))

    def __delitem__(self, name: str) -> None:
        raise PlantError("a parameter cannot be deleted; set its amplitude to 0.")

    def __iter__(self) -> Iterator[str]:
        return iter(self.described)

    def __len__(self) -> int:
        return len(self.described)
