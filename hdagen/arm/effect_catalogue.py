"""How effects show themselves, as their files in `gen.effects` say: a build's manifest has it, whatever its model has.

Everything that a diagnosis knows of an effect beyond its equation stands here, and no other file knows one by name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Self


@dataclass(frozen=True)
class Experiment:
    """The experiment that shows one effect.

    Attributes:
        action: What to do, an imperative.
        observation: How the effect shows then, a phrase of which the effect is the subject.

    """

    action: str
    observation: str


@dataclass(frozen=True)
class Plot:
    """The plot that fits an effect: its kind, and the quantity on its abscissa."""

    kind: str
    abscissa: str


@dataclass(frozen=True)
class Wall:
    """An obstacle beyond an angle: the names of its stiffness and of its angle, and the side of the range (1 or −1)."""

    stiffness: str
    edge: str
    side: int


@dataclass(frozen=True)
class SeriesSpring:
    """A spring in a drive that the robot file calls rigid: names of its compliance and of its damping."""

    compliance: str
    damping: str


@dataclass(frozen=True)
class EffectTraits:
    """How one effect shows itself.

    Attributes:
        name: Its name.
        place: Where it acts: input, motor, transmission, link or sensor.
        amplitudes: Names of the parameters that, when all 0, remove it.
        experiment: The experiment that shows it.
        confusion_groups: Names of the groups of effects among which it is hard to tell in a log.
        plot: The plot that fits it.
        residual: The residual that shows it: "at_place", "gear_angle" or "torque_reading".
        is_friction: Whether it changes friction at the motor.
        presupposes: The effect without which it has no meaning, if any.
        twins: Effects from which it differs at standstill only.
        accumulating_state: Of an effect that comes over time, the state that is the share of it that is there.
        walls: Obstacles that it puts into the joint's range.
        series_spring: The spring that it gives to a drive which the robot file calls rigid.
        alternatives: Numbers of the robot file, at any joint, and effects at the same joint from which a motion may not
            part this number of the file.

    """

    name: str
    place: str
    amplitudes: tuple[str, ...]
    experiment: Experiment
    confusion_groups: tuple[str, ...]
    plot: Plot
    residual: str
    is_friction: bool
    presupposes: str | None
    twins: tuple[str, ...]
    accumulating_state: str | None
    walls: tuple[Wall, ...]
    series_spring: SeriesSpring | None
    alternatives: tuple[str, ...]

    @classmethod
    def from_manifest(cls, stated: Mapping[str, Any]) -> Self:
        """Read one entry of a manifest's catalogue.

        Args:
            stated: The entry.

        Returns:
            The traits.

        """
        read = dict(stated)
        for key in ("amplitudes", "confusion_groups", "twins", "alternatives"):
            read[key] = tuple(read[key])
        read["experiment"], read["plot"] = Experiment(**read["experiment"]), Plot(**read["plot"])
        read["walls"] = tuple(Wall(**wall) for wall in read["walls"])
        if read["series_spring"] is not None:
            read["series_spring"] = SeriesSpring(**read["series_spring"])
        return cls(**read)

    def is_twin_of(self, other: EffectTraits) -> bool:
        """Tell whether two effects differ at standstill only.

        Args:
            other: The other effect.

        Returns:
            Whether either names the other as its twin.

        """
        return other.name in self.twins or self.name in other.twins


class EffectCatalogue(Mapping[str, EffectTraits]):
    """The traits of every effect by name, along the signal chain."""

    def __init__(self, stated: Mapping[str, Any]) -> None:
        """Read the catalogue of a manifest.

        Args:
            stated: The manifest's ``catalogue``.

        """
        read = [EffectTraits.from_manifest(entry) for entry in stated["effects"]]
        self._traits = {traits.name: traits for traits in read}
        self.group_experiments = {group["name"]: str(group["experiment"]) for group in stated["confusion_groups"]}

    def __getitem__(self, name: str) -> EffectTraits:
        return self._traits[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._traits)

    def __len__(self) -> int:
        return len(self._traits)

    @property
    def series_springs(self) -> dict[str, SeriesSpring]:
        """The springs that effects give to drives which the robot file calls rigid, by the effect's name."""
        return {name: traits.series_spring for name, traits in self.items() if traits.series_spring}

    def find_group_experiment(self, one: str, other: str) -> str | None:
        """Find the experiment that tells two effects apart which look alike.

        Args:
            one: The name of an effect.
            other: That of another one.

        Returns:
            The experiment of the narrowest group that has both; None where no group has.

        """
        both = {*self[one].confusion_groups} & {*self[other].confusion_groups}
        return next((text for name, text in self.group_experiments.items() if name in both), None)
