"""What is found in a log, and what must be known of its robot to find it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum


class Severity(Enum):
    """REFUSE: nothing right can come of it. WARN: look at it. NOTE: good to know."""

    REFUSE = "refuse"
    WARN = "warn"
    NOTE = "note"


@dataclass(frozen=True)
class Finding:
    """One thing found in a log: a stable name, the joint (0: the whole log), and a sentence that says what to do."""

    severity: Severity
    name: str
    joint: int
    sentence: str


@dataclass(frozen=True)
class Machine:
    """What triage must know of a robot, one entry a joint; None where the robot file does not say."""

    ratios: tuple[float, ...]
    resolutions: Mapping[str, float]  # by column name
    max_currents: tuple[float | None, ...]
    position_limits: tuple[tuple[float, float] | None, ...]
    prismatic: tuple[bool, ...]
