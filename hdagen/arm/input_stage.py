"""The input effects (delay, limits, sag, lag) one row after the other, as a simulation needs them.

`Arm.acting` does the same for a whole log at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm


class InputStage:
    """The motor input that acts under a command, row after row; without input effects it is the command itself.

    Attributes:
        mean: (n), the mean of the acting input over the last row.
        end: (n), the acting input at the end of the last row, which a sensor reads at the next one.

    """

    def __init__(self, arm: Arm, before: ArrayLike) -> None:
        """Start after ``before`` (n) has been commanded for ever."""
        self.command: Array = np.array(before, float)
        self.mean, self.end, self.h = self.command.copy(), self.command.copy(), np.ones(1)
        self.has_input_stage = arm.has_input_stage
        if arm.has_input_stage:
            state = arm.start_input_stage(self.command)
            self.end = arm.evaluate("input_law", command=self.command)["current"]
            self._step = arm.module.bind("input_step", state, self.command, arm.c, self.h, self.mean, self.end)

    def step(self, command: Array, h: float) -> Array:
        """Hold a command for one row.

        Args:
            command: (n), A or N m.
            h: Length of the row, s.

        Returns:
            (n): the mean over the row of the input that acts.

        """
        if not self.has_input_stage:
            self.end = command.copy()
            return command
        self.command[:], self.h[0] = command, h
        self._step.run()
        return self.mean
