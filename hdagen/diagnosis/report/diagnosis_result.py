"""What a diagnosis comes to: its decision, its content, and what a report draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hdagen.diagnosis.decision.posterior import Decision
from hdagen.diagnosis.holdout.unseen_motion import UnseenMotion
from hdagen.diagnosis.residuals.residual_torque import Sight
from hdagen.diagnosis.search.hypothesis_search import Search
from hdagen.prediction.window_replay import Replay


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The search's result, the held-out motion, and its replay ``after`` the verdict."""

    search: Search
    decision: Decision
    content: dict[str, Any]
    held_out: UnseenMotion
    after: Replay
    sight: Sight  # ``held_out`` through the models before and after
    left_out: tuple[str, ...]  # a sentence for every stage and simulation that failed
