"""One simulation, called a lane, and the windows of a record that it runs through.

Legend: T rows, W windows, K selected windows, m positions and velocities of the state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.prediction.measurement_model import Rows


@dataclass(frozen=True, eq=False)
class Rollout:
    """One simulation: parameters (np), initial states (W, m), torque (T, n) added at the motors, N m, and impulses on
    the links (T, n), N m s, each at its row. ``memory``: effects' own states (K, nx − m) at which the selected windows
    begin; without them the lane carries these states on from window to window."""

    p: Array
    initial_states: Array
    torque: Array | None = None
    impulse: Array | None = None
    memory: Array | None = None


@dataclass(frozen=True, eq=False)
class PreparedRollout:
    """A simulation with its arm, and the commands' effective inputs and readings of them (T, n each)."""

    lane: Rollout
    arm: Arm
    inputs: Array
    input_readings: Array


@dataclass(frozen=True, eq=False)
class WindowSchedule:
    """The windows of a lane: ``rows`` of the record that give its inputs, ``row_count`` of them; ``edges`` of the
    windows in these rows; ``state_count``: number of rows in windows; ``windows`` of the record; ``selected_states``:
    rows in selected windows, among those in windows."""

    rows: Rows | slice
    row_count: int
    edges: Rows
    state_count: int
    windows: Rows | slice
    selected_states: Rows | slice

    @classmethod
    def all_windows(cls, record: WindowedRecord) -> WindowSchedule:
        """Return the schedule of all windows of a record."""
        selected_states = np.searchsorted(record.rows, record.rows_of(record.selected_windows))
        return cls(slice(None), len(record.time), record.window_edges, len(record.rows), slice(None), selected_states)

    @classmethod
    def selected_windows(cls, record: WindowedRecord) -> WindowSchedule:
        """Return the schedule of the selected windows alone, with a row between them, as no window begins where the one
        before ends."""
        first, end = record.starts[record.selected_windows], record.ends[record.selected_windows]
        rows = np.concatenate([np.append(np.arange(a, b), a) for a, b in zip(first, end, strict=True)])
        ends = np.cumsum(end - first + 1) - 1
        return cls(
            rows,
            len(rows),
            np.stack([ends - (end - first), ends], 1),
            len(rows) - len(ends),
            record.selected_windows,
            slice(None),
        )
