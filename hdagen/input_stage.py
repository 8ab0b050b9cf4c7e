"""The input effects (delay, limits, sag, lag) one row after the other, as a simulation needs them.

`Arm.acting` does the same for a whole log at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hdagen.plant import Arm, Array


class InputStage:
    """From the command of a row to what acts over it. Without input effects the command itself."""

    def __init__(self, arm: Arm, before: ArrayLike) -> None:
        """``before`` (n): what had been commanded for ever."""
        self.command: Array = np.array(before, float)
        self.mean, self.end, self.h = self.command.copy(), self.command.copy(), np.ones(1)
        self.staged = arm.staged
        if arm.staged:
            state = arm.input_state(self.command)
            self.end = arm.evaluate("input_law", command=self.command)["current"]
            self._step = arm.module.bind("input_step", state, self.command, arm.c, self.h, self.mean, self.end)

    def step(self, command: Array, h: float) -> Array:
        """The mean (n) over the row of what acts when ``command`` (n) is held for ``h`` s; `end` (n) is then what a
        sensor reads at the next row."""
        if not self.staged:
            self.end = command.copy()
            return command
        self.command[:], self.h[0] = command, h
        self._step.run()
        return self.mean
