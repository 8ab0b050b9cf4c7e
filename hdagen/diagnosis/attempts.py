"""Stages that a diagnosis can do without: what one of them fails by is said, and what was found until then stays."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeVar

from numpy.linalg import LinAlgError

from hdagen.diagnosis.shooting import Shooting
from hdagen.log import LogError
from hdagen.plant import PlantError

Made = TypeVar("Made")


@dataclass
class Attempts:
    """``failures``: a sentence for everything that was left out."""

    failures: list[str] = field(default_factory=list)

    def attempt(self, stage: str, work: Callable[[], Made], otherwise: Made) -> Made:
        """What ``work`` makes; ``otherwise`` where it fails, and a sentence about the ``stage``."""
        try:
            return work()
        except (PlantError, LogError, LinAlgError) as error:
            self.failures.append(f"Left out, as it failed: {stage}. {error}")
            return otherwise

    def count(self, shootings: Iterable[Shooting]) -> None:
        """A sentence about the simulations of a fit that failed, if any did."""
        run, failed = (sum(each) for each in zip(*((one.run, one.failed) for one in shootings), strict=True))
        if failed:
            self.failures.append(
                f"In {failed} of {run} simulations of the fit the model flew apart or gave no number: such a motion "
                "counts as wrong as can be, and the search went on without it."
            )
