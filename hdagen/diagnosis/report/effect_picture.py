"""A picture of an effect, with how far the log follows it."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.diagnosis.residuals.effect_agreement import Agreement


@dataclass(frozen=True)
class EffectPicture:
    """A figure in HTML, and the agreement of log and fitted effect in it.

    Attributes:
        markup: of the figure; "" where there is nothing to show.
        agreement: None where the figure compares nothing.

    """

    markup: str
    agreement: Agreement | None = None
