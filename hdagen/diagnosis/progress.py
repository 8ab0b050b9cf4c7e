"""Progress of a diagnosis: the stage by its name, and roughly the time left.

The number of effects that will be tried is unknown at first, so the time left is that of a log in which two were tried;
a log without an effect is done sooner.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable
from threading import Lock

# share of the time that has passed when a stage begins, for a log of 10 s in which two effects were tried together
STAGE_SHARES = {
    "model": 0.0,
    "what the log suggests": 0.03,
    "screening": 0.125,
    "going on with": 0.8,
    "prediction over long windows": 0.82,
    "replay of held-out motion": 0.84,
    "what works all the time": 0.86,
    "what is tolerated": 0.88,
    "where and when": 0.96,
    "report": 0.97,
}
# the same of the rounds of each race, and of those from where the leader stands
RACE_SHARES, REFIT_SHARES = ((0.33, 0.36, 0.41), (0.52, 0.56, 0.59), (0.66, 0.67, 0.68)), (0.72, 0.74, 0.77)
ROUND_PATTERN = re.compile(r"fitting [^,]*, (from [^,]*, )?round (\d) of")
SPRING_STAGE, SECOND_SEARCH_SHARE = (
    "a spring in what",
    0.5,
)  # stage of a second search, of a rigid drive with a spring; its share
LEAST_SHARE_DONE = 0.05  # share of the time that has passed, from which the time left is printed


class Progress:
    """Prints each stage with the time and the time left, from any thread."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock, self.lock, self.started_at = clock, Lock(), clock()
        self.share_done, self.search_offset, self.races, self.round = 0.0, 0.0, 0, 0

    def __call__(self, stage: str) -> None:
        """Print a line for a stage.

        Args:
            stage: its sentence.

        """
        with self.lock:
            passed = self.clock() - self.started_at
            self._enter_stage(stage)
            left = ""
            if self.share_done >= LEAST_SHARE_DONE:
                left = f", about {max(passed * (1.0 - self.share_done) / self.share_done, 1.0):.0f} s left"
            print(f"{passed:5.1f} s  {stage}{left}\n", end="", file=sys.stderr)  # a line at once

    def _enter_stage(self, stage: str) -> None:
        if stage.startswith(SPRING_STAGE):
            self.share_done = self.search_offset = SECOND_SEARCH_SHARE
            self.races = self.round = 0
            return
        self.share_done = max(
            self.share_done, self.search_offset + (1.0 - self.search_offset) * self._share_before(stage)
        )

    def _share_before(self, stage: str) -> float:
        if not (found := ROUND_PATTERN.match(stage)):
            return next((share for words, share in STAGE_SHARES.items() if stage.startswith(words)), 0.0)
        number = int(found[2])
        if found[1]:
            return REFIT_SHARES[number - 1]
        if number < self.round:
            self.races = min(self.races + 1, len(RACE_SHARES) - 1)
        self.round = number
        return RACE_SHARES[self.races][number - 1]
