"""What a diagnosis comes to: its decision, its content, and what a report draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hdagen.diagnosis.decision.posterior import Decision
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque
from hdagen.diagnosis.search.effect_search import SearchResult
from hdagen.prediction.window_replay import Replay


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The search's result, the held-out motion, and its replay ``after`` the verdict."""

    search: SearchResult
    decision: Decision
    content: dict[str, Any]
    holdout: HoldoutMotion
    after: Replay
    residual_torque: ResidualTorque  # ``holdout`` through the models before and after
    failures: tuple[str, ...]  # a sentence for every stage and simulation that failed
