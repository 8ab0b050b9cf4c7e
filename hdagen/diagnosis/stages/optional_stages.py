"""Optional stages of a diagnosis: where one fails, or there is no time for it, the report says so, and everything found
before it stays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from numpy.linalg import LinAlgError

from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.data_table import LogError

Made = TypeVar("Made")


@dataclass
class Attempts:
    """Runs optional stages.

    Attributes:
        budget: the time of the diagnosis.
        failures: a sentence for each stage that failed.

    """

    budget: TimeBudget = field(default_factory=TimeBudget)
    failures: list[str] = field(default_factory=list)

    def attempt(self, stage: str, work: Callable[[], Made], otherwise: Made) -> Made:
        """Run one stage, and note it where it fails.

        Args:
            stage: name of the stage, for the sentence.
            work: the stage.
            otherwise: the result where it fails.

        Returns:
            The result of ``work``, or ``otherwise``.

        """
        try:
            return work()
        except (PlantError, LogError, LinAlgError) as error:
            self.failures.append(f"Left out, as it failed: {stage}. {error}")
            return otherwise

    def attempt_in_time(self, stage: str, work: Callable[[], Made], otherwise: Made) -> Made:
        """Run one stage, and note it where it fails or the time is up.

        Args:
            stage: name of the stage, for the sentence.
            work: the stage.
            otherwise: the result without it.

        Returns:
            The result of ``work``, or ``otherwise``.

        """
        if self.budget.is_left_out(stage):
            return otherwise
        return self.attempt(stage, work, otherwise)
