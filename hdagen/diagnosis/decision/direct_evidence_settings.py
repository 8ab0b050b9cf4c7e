"""Effects that show without any fit."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class DirectEvidenceSettings:
    """Effects that show without any fit."""

    largest_remaining_share: float = declare_setting(
        0.5,
        "of the error without it (rms)",
        "an effect must leave as much at most: it explains three quarters of the variance",
    )
    folds: int = declare_setting(
        4, "parts", "parts of a log, each of which is predicted from the others: cross-validation"
    )


DIRECT_EVIDENCE = DirectEvidenceSettings()
