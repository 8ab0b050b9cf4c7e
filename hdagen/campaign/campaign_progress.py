"""How far a run is: the count, the rate of late, the time left."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from hdagen.campaign.task import Outcome, Status

_LEAST_INTERVAL = 1.0  # s between lines on tasks that went well
_RATE_WINDOW = 50  # ends of tasks that the rate is taken over


class CampaignProgress:
    """Says a line when tasks end, at most one a second, and one for each that is refused or failed."""

    def __init__(self, count: int, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._count = count
        self._say = say
        self._clock = clock
        self._done = 0
        self._ends = deque([clock()], _RATE_WINDOW)
        self._last_line = float("-inf")

    def note_end(self, name: str, outcome: Outcome) -> None:
        """Note that a task ended.

        Args:
            name: Name of the task.
            outcome: How it ended.

        """
        self._done += 1
        now = self._clock()
        self._ends.append(now)
        is_quiet = outcome.status is Status.DONE and self._done < self._count
        if is_quiet and now - self._last_line < _LEAST_INTERVAL:
            return
        self._last_line = now
        rate = (len(self._ends) - 1) / max(now - self._ends[0], 1e-3)
        left = (self._count - self._done) / rate
        self._say(
            f"{name}: {outcome.status.value}; {self._done} of {self._count}, {format_rate(rate)}, about "
            f"{format_duration(left)} left"
        )


def format_rate(rate: float) -> str:
    """Write a rate of tasks.

    Args:
        rate: Tasks a second.

    Returns:
        The rate by the second, minute or hour, whichever has a number from 1 on.

    """
    for factor, unit in ((1, "s"), (60, "min"), (3600, "h")):
        if rate * factor >= 1 or unit == "h":
            return f"{rate * factor:.3g}/{unit}"
    return ""


def format_duration(seconds: float) -> str:
    """Write a duration in the unit that a reader would choose.

    Args:
        seconds: The duration, s.

    Returns:
        Number and unit.

    """
    for longest, factor, unit in ((90, 1, "s"), (5400, 60, "min")):
        if seconds < longest:
            return f"{seconds / factor:.0f} {unit}"
    return f"{seconds / 3600:.1f} h"
