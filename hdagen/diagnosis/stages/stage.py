"""The stages of a diagnosis by name, as whoever follows it is told of them."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum


class Stage(Enum):
    """A stage of a diagnosis; the value says in words what happens in it.

    The rounds of a race come again with each race: of single effects, of pairs and of sets of three. The search for
    springs is a second search, and LONG_HORIZON belongs to verdicts of something unknown alone.
    """

    MODELS = "load the models"
    DATA = "prepare the data"
    DIRECT_EVIDENCE = "find direct evidence"
    NULL_MODEL = "fit the null model"
    SCREENING = "screen all effects"
    RACE_ROUND_1 = "fit the leading effects, round 1"
    RACE_ROUND_2 = "fit the leading effects, round 2"
    RACE_ROUND_3 = "fit the leading effects, round 3"
    RIVALS = "fit the rivals of the leading set"
    CLOSE_CALLS = "settle close calls"
    SPRINGS = "search with springs in rigid joints"
    LONG_WINDOWS = "predict long windows"
    HOLDOUT = "replay held-out motion"
    LONG_HORIZON = "search long windows"
    ALTERNATIVES = "rank the alternatives"
    LOCATION = "locate the gap"
    REPORT = "write the report"


StageListener = Callable[[Stage], None]


def ignore_stage(stage: Stage) -> None:
    """Take no notice of a stage.

    Args:
        stage: that begins.

    """
