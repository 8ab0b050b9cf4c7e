"""Optional stages of a diagnosis: where one fails, the report says so, and everything found before it stays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from numpy.linalg import LinAlgError

from hdagen.arm.build_loader import PlantError
from hdagen.log.data_table import LogError

Made = TypeVar("Made")


@dataclass
class Attempts:
    """Runs optional stages.

    Attributes:
        failures: a sentence for each stage that was left out.

    """

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
