"""The time that a diagnosis may take: where it is up, the best so far stands, and a list says what was not tried."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from typing import Any

from hdagen.arm.build_loader import PlantError


class TimeUpError(PlantError):
    """The time was up before there was anything to state; the message is a sentence."""


class TimeBudget:
    """The time of one diagnosis, which counts from when this is made.

    Nothing is interrupted: whoever begins a step of a fit, or a part of the search, asks first whether the time is up.
    A part of it is kept for the statement, which is made of what was found until then.

    Attributes:
        seconds: the whole time, s; infinite where there is no limit.
        not_tried: by each part that was left out, the effects (name@joint) that it was left out for, if it is for some.

    """

    def __init__(self, seconds: float | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        if seconds is not None and not (math.isfinite(seconds) and seconds > 0.0):
            raise PlantError(f"within {seconds:g}: possible is a positive number of seconds; give one.")
        self.seconds = math.inf if seconds is None else seconds
        self.not_tried: dict[str, dict[str, None]] = {}
        self._clock, self._kept = clock, 0.0
        self._started_at = clock()

    @property
    def passed(self) -> float:
        """The time that has passed, s."""
        return self._clock() - self._started_at

    @property
    def is_up(self) -> bool:
        """Whether the time that is not kept for the statement is up."""
        return self.passed >= self.seconds - self._kept

    def keep_for_statement(self, seconds: float) -> None:
        """Keep a part of the time for the statement.

        Args:
            seconds: the part, s.

        """
        self._kept = seconds

    def is_left_out(self, part: str, effects: Iterable[str] = ()) -> bool:
        """Tell whether a part of the diagnosis has to be left out, and note that it was not tried.

        Args:
            part: the part in words.
            effects: the effects (name@joint) that it is for.

        Returns:
            Whether the time is up.

        """
        if not self.is_up:
            return False
        self.note_untried(part, effects)
        return True

    def note_untried(self, part: str, effects: Iterable[str] = ()) -> None:
        """Note a part that was not tried.

        Args:
            part: the part in words.
            effects: the effects (name@joint) that it is for.

        """
        self.not_tried.setdefault(part, {}).update(dict.fromkeys(effects))

    def require_time(self, done: str) -> None:
        """Refuse to go on where the whole time is up.

        Args:
            done: that there is not even, in words.

        Raises:
            TimeUpError: the time is up.

        """
        if self.passed >= self.seconds:
            raise TimeUpError(
                f"within {self.seconds:g} s not even {done} was done, for which it took {self.passed:.1f} s; give more "
                "time, or a shorter log."
            )

    def describe_untried(self) -> list[dict[str, Any]]:
        """Describe what was not tried, as diagnosis.json has it.

        Returns:
            Each part, with the effects that it was left out for.

        """
        return [{"part": part, "effects": list(effects)} for part, effects in self.not_tried.items()]
