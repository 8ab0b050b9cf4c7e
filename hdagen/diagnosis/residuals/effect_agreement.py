"""The agreement between an effect as the log shows it and as the model adds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.residuals.explanation_settings import EXPLANATION


@dataclass(frozen=True)
class Agreement:
    """How well an effect explains the residual that a log shows.

    ``explained`` is R², the share of the square of the residual that the effect takes away, below 0 where it adds to
    it. ``slope`` is the residual over the effect's part in the model, 1 where they are alike, with its standard
    ``slope_error``; both are NaN where the effect adds nothing.
    """

    explained_share: float
    slope: float
    slope_error: float

    @property
    def is_contradicted(self) -> bool:
        """Whether the log surely shows more than twice, or less than half, of what the effect adds."""
        reach = EXPLANATION.sure_standard_errors * self.slope_error
        return (
            self.slope - reach > EXPLANATION.contradicting_ratio
            or self.slope + reach < 1.0 / EXPLANATION.contradicting_ratio
        )

    def describe(self, beyond: str = "") -> str:
        """Say the agreement in a caption.

        Args:
            beyond: the model without the effect, as words, where the points lie beyond one.

        Returns:
            A sentence, and a warning where the log contradicts the effect.

        """
        shown = f"Of what the log shows{beyond and f' beyond {beyond}'}"
        said = f"{shown} the effect explains {100 * self.explained_share:.0f} % (R² = {self.explained_share:.2f})."
        if not self.is_contradicted:
            return said
        return (
            f"{said} Warning: the log shows {self.slope:.2g} times what the effect adds. As fitted it is not what "
            "this picture shows: something else may be at work, beside it or in its place."
        )


def measure_agreement(shown: Array, added: Array) -> Agreement:
    """Compare the residual of a log without an effect with the part that the effect adds in the model.

    Args:
        shown: the residual (K,), in the order of time.
        added: the effect's part (K,), at the same instants and in the same unit.

    Returns:
        Their agreement; the error of the slope is that of the mean over blocks of time, as neighbours are alike.

    """
    total, size = float(shown @ shown), float(added @ added)
    left = shown - added
    explained = 0.0
    if total > 0.0:
        explained = 1.0 - float(left @ left) / total
    if size == 0.0:
        return Agreement(explained, np.nan, np.nan)
    slope = float(added @ shown) / size
    parts = zip(
        np.array_split(added, EXPLANATION.slope_blocks),
        np.array_split(shown - slope * added, EXPLANATION.slope_blocks),
        strict=True,
    )
    off = np.array([part @ rest for part, rest in parts]) / size
    return Agreement(
        explained, slope, float(np.sqrt(off @ off * EXPLANATION.slope_blocks / (EXPLANATION.slope_blocks - 1)))
    )
