"""Working memory of a thread that simulates lanes.

Legend: L lanes that run at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.diagnosis.inference.rollout import WindowSchedule


@dataclass(frozen=True, eq=False)
class Workspace:
    """Working memory of one thread for L lanes: ``inputs`` from each row to the next, ``constants`` (L, nc), and
    states."""

    inputs: Array
    constants: Array
    states: Array

    @classmethod
    def allocate(cls, arm: Arm, record: WindowedRecord, most_bytes: int) -> Workspace:
        """Allocate the memory for lanes of a record on an arm, as many as ``most_bytes`` hold, at least one."""
        shapes = ((len(record.time) + len(record.selected_windows), arm.nu), arm.c.shape, (len(record.rows), arm.nx))
        lanes = min(arm.module.batch_width, max(1, most_bytes // (8 * sum(map(math.prod, shapes)))))
        return cls(*(np.empty((lanes, *shape)) for shape in shapes))

    def buffers_for(self, course: WindowSchedule, lanes: int) -> tuple[Array, Array]:
        """Return memory for the inputs (L, rows, nu) and the states (L, rows in windows, nx) of ``lanes`` on a
        course."""
        inputs = (lanes, course.row_count, self.inputs.shape[2])
        states = (lanes, course.state_count, self.states.shape[2])
        return (
            self.inputs.reshape(-1)[: math.prod(inputs)].reshape(inputs),
            self.states.reshape(-1)[: math.prod(states)].reshape(states),
        )
