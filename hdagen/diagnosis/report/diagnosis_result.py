"""Everything that a diagnosis found, with the content of diagnosis.json and the motions that a report draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hdagen.diagnosis.decision.posterior import Decision
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.search.stored_searches import Searches
from hdagen.prediction.window_replay import Replay


@dataclass(frozen=True, eq=False)
class DiagnosisResult:
    """Everything that a diagnosis found.

    Attributes:
        search: every fitted set of effects, and the screening.
        searches: all searches, of which ``search`` is the one that stands.
        decision: the decision that the verdict stands on.
        content: of diagnosis.json.
        holdout: the held-out motion on which the gap is measured.
        after: its replay after the verdict.
        residual_torque: the held-out motion through the models before and after the verdict.
        failures: a sentence for every stage and simulation that failed.

    """

    search: SearchResult
    searches: Searches
    decision: Decision
    content: dict[str, Any]
    holdout: HoldoutMotion
    after: Replay
    residual_torque: ResidualTorque
    failures: tuple[str, ...]
