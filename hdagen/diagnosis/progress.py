"""Progress of a diagnosis: the stage in words, and roughly the time left.

The number of effects that will be tried is unknown at first, so the time left is that of a log in which two were tried;
a log without an effect is done sooner.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from threading import Lock

from hdagen.diagnosis.stages.stage import Stage

# share of the time that has passed when a stage begins, for a log of 10 s in which two effects were tried together
STAGE_SHARES = {
    Stage.MODELS: 0.0,
    Stage.DATA: 0.02,
    Stage.DIRECT_EVIDENCE: 0.03,
    Stage.NULL_MODEL: 0.04,
    Stage.SCREENING: 0.125,
    Stage.RIVALS: 0.72,
    Stage.CLOSE_CALLS: 0.8,
    Stage.LONG_WINDOWS: 0.82,
    Stage.HOLDOUT: 0.84,
    Stage.LONG_HORIZON: 0.86,
    Stage.ALTERNATIVES: 0.88,
    Stage.LOCATION: 0.96,
    Stage.REPORT: 0.97,
}
RACE_SHARES = {  # the same of a round in the first, the second and the third race
    Stage.RACE_ROUND_1: (0.33, 0.52, 0.66),
    Stage.RACE_ROUND_2: (0.36, 0.56, 0.67),
    Stage.RACE_ROUND_3: (0.41, 0.59, 0.68),
}
RACE_COUNT = 3  # races that the shares are for; further ones count as the last
SECOND_SEARCH_SHARE = 0.5  # the same when the second search begins, of a rigid drive with a spring
LEAST_SHARE_DONE = 0.05  # share of the time that has passed, from which the time left is printed


def print_stage(passed: float, words: str) -> None:
    """Print a line to standard error, at once.

    Args:
        passed: Time that has passed, s.
        words: The stage, and the time left.

    """
    print(f"{passed:5.1f} s  {words}\n", end="", file=sys.stderr)


class Progress:
    """Shows each stage with the time that has passed and the time left, from any thread."""

    def __init__(
        self, show: Callable[[float, str], None] = print_stage, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.show, self.clock, self.lock, self.started_at = show, clock, Lock(), clock()
        self.share_done, self.search_offset, self.races = 0.0, 0.0, 0

    def __call__(self, stage: Stage) -> None:
        """Show a stage.

        Args:
            stage: that begins.

        """
        with self.lock:
            passed = self.clock() - self.started_at
            self._enter_stage(stage)
            left = ""
            if self.share_done >= LEAST_SHARE_DONE:
                left = f", about {max(passed * (1.0 - self.share_done) / self.share_done, 1.0):.0f} s left"
            self.show(passed, stage.value + left)

    def _enter_stage(self, stage: Stage) -> None:
        if stage is Stage.SPRINGS:
            self.share_done = self.search_offset = SECOND_SEARCH_SHARE
            self.races = 0
            return
        if stage is Stage.RACE_ROUND_1:
            self.races = min(self.races + 1, RACE_COUNT)
        share = self.search_offset + (1.0 - self.search_offset) * self._share_before(stage)
        self.share_done = max(self.share_done, share)

    def _share_before(self, stage: Stage) -> float:
        """Share of one search's time that has passed when a stage begins."""
        if stage in RACE_SHARES:
            return RACE_SHARES[stage][max(self.races, 1) - 1]
        return STAGE_SHARES[stage]
