"""Optional stages of a diagnosis: where one fails, the report says so, and everything found before it stays."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeVar

from numpy.linalg import LinAlgError

from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.log.data_table import LogError

Made = TypeVar("Made")


@dataclass
class Attempts:
    """Runs optional stages; ``failures`` has a sentence for each stage that was left out."""

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

    def report_failed_simulations(self, shootings: Iterable[MultipleShooting]) -> None:
        """Note how many simulations of a fit failed, if any did.

        Args:
            shootings: the simulators of the fit.

        """
        every = list(shootings)
        run, failed = sum(one.rollout_count for one in every), sum(one.failure_count for one in every)
        if failed:
            self.failures.append(
                f"In {failed} of {run} simulations of the fit the model flew apart or gave no number: such a motion "
                "counts as wrong as can be, and the search went on without it."
            )
