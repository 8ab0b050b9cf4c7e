"""The population that the cases of a check are drawn from: a family of realities, a kind, and a background."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

DRIVETRAIN, MAXWELL, JOINT = FAMILIES = ("drivetrain", "maxwell", "joint")
MODEL = "model"  # the family of a model that the caller names
EVERY_FAMILY = (*FAMILIES, MODEL)
FRICTION_KIND = "joint"  # friction of rigid joints: a kind of the family of joints with robots of its own
BACKGROUND_SIZE = 0.04  # of every typical size, where a kind has a background and none is asked for
BACKGROUNDS = (0.0, 0.02, 0.04, 0.08)  # that can be asked for, in typical sizes
_LOG_SECONDS = {DRIVETRAIN: 10.0, MAXWELL: 10.0, JOINT: 15.0, MODEL: 20.0}  # usual length of a log, s
_FRICTION_LOG_SECONDS = 24.0  # the same of the kind `FRICTION_KIND`, s
ARM_KINDS = ("single", "background", "none", "unknown", "unknown+one", "pair", "rough", "task")
KINDS_OF_FAMILY = {
    DRIVETRAIN: ARM_KINDS,
    MAXWELL: ARM_KINDS,
    JOINT: (*(kind for kind in ARM_KINDS if kind != "task"), FRICTION_KIND),
    MODEL: ("single", "none"),
}
KINDS = tuple(dict.fromkeys(kind for kinds in KINDS_OF_FAMILY.values() for kind in kinds))


@dataclass(frozen=True)
class Population:
    """Where cases are drawn from.

    Attributes:
        kind: one of the family's `KINDS_OF_FAMILY`.
        family: one of `EVERY_FAMILY`.
        background: size of every other effect, in typical sizes; None: as the kind usually has it.
        model: the path of the URDF, the MJCF or the robot.toml of the family `MODEL`.

    """

    kind: str
    family: str = DRIVETRAIN
    background: float | None = None
    model: str = ""

    @property
    def name(self) -> str:
        """The key of the population in files that pool checks; of the first family without a background, its kind."""
        words = [] if self.family == DRIVETRAIN or self.kind == FRICTION_KIND else [self.family]
        if self.model:
            words.append(Path(self.model).stem)
        words.append(self.kind)
        if self.background is not None:
            words.append(f"{self.background:g}")
        return " ".join(words)

    @property
    def seconds(self) -> float:
        """Usual length of a log, s."""
        return _FRICTION_LOG_SECONDS if self.kind == FRICTION_KIND else _LOG_SECONDS[self.family]

    def seed_family(self, seed: str) -> str:
        """Derive the seed of the family, so that no two families draw the same cases.

        Args:
            seed: the seed of a check.

        Returns:
            The seed itself in the first family.

        """
        if self.family == DRIVETRAIN:
            return seed
        return f"{seed}\0{self.family}"

    def size_background(self, index: int) -> float:
        """Size the background of a case.

        Args:
            index: of the case; usually every other case without an effect has a background.

        Returns:
            Size of every other effect, in typical sizes.

        """
        if self.background is not None:
            return self.background
        if self.kind == "background" or (self.kind == "none" and index % 2):
            return BACKGROUND_SIZE
        return 0.0


def read_population(stated: Mapping[str, Any]) -> Population:
    """Read a population from a request or a report, which may be older than the families.

    Args:
        stated: has the kind, and may have family, background and model.

    Returns:
        The population.

    """
    kind, background, model = str(stated["kind"]), stated.get("background"), str(stated.get("model") or "")
    usual = MODEL if model else JOINT if kind == FRICTION_KIND else DRIVETRAIN
    return Population(kind, stated.get("family") or usual, None if background is None else float(background), model)
