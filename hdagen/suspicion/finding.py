"""What is found in a log, and what must be known of its robot to find it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class Severity(Enum):
    """REFUSE: nothing right can come of it. WARN: look at it. NOTE: good to know."""

    REFUSE = "refuse"
    WARN = "warn"
    NOTE = "note"


@dataclass(frozen=True)
class Finding:
    """One thing found in a log: a stable name, the joint (0: the whole log), and a sentence that says what to do.

    ``repair`` is what to do as tables of a columns.toml, by column; empty where only a person can tell.
    """

    severity: Severity
    name: str
    joint: int
    sentence: str
    repair: Mapping[str, Any] = field(default_factory=dict, hash=False)


def in_words(repair: Mapping[str, Any]) -> str:
    """Tables of a columns.toml in a sentence: ``unit = "deg" under [motor_position_1]``."""
    parts = []
    for column, table in repair.items():
        if column == "ignore":
            names = ", ".join(f'"{name}"' for name in table)
            parts.append(f"ignore = [{names}]")
            continue
        keys = (
            f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value:.16g}" for key, value in table.items()
        )
        parts.append(f"{' and '.join(keys)} under [{column}]")
    return " and ".join(parts)


@dataclass(frozen=True)
class Machine:
    """What triage must know of a robot, one entry a joint; None where the robot file does not say."""

    ratios: tuple[float, ...]
    resolutions: Mapping[str, float]  # by column name
    max_currents: tuple[float | None, ...]
    position_limits: tuple[tuple[float, float] | None, ...]
    prismatic: tuple[bool, ...]
