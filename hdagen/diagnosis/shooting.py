"""Shooting: what the model predicts in every window, and how that changes with each parameter, first state and torque.

A lane is one simulation of all windows. Derivatives are differences of lanes: dry friction sticks exactly, so a
difference over the size that matters is wanted, not a slope at a point. Lanes run side by side in threads; the compiled
rollout lets go of the interpreter.

Legend: T rows, R rows in windows, W windows, M channels, m positions and velocities of the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from queue import SimpleQueue

import numpy as np

from hdagen.diagnosis.record import Record
from hdagen.plant import Arm, Array
from hdagen.readings import mechanical, within

THREADS = 2


@dataclass(frozen=True, eq=False)
class Lane:
    """One simulation: parameters (np), first states (W, m), torque (T, n) added at the motors, N m, and impulses on the
    links, N m s: (T, n), each at its row."""

    p: Array
    begun: Array
    torque: Array | None = None
    impulse: Array | None = None


@dataclass(eq=False)
class Shooting:
    """All lanes of one record on one model."""

    arm: Arm
    record: Record
    most: float = 1e-3  # s, a step of integration
    arms: SimpleQueue[Arm] = field(init=False)

    def __post_init__(self) -> None:
        self.arms = SimpleQueue()
        for _ in range(THREADS):
            self.arms.put(Arm(self.arm.folder))
        self.m = mechanical(self.arm)
        self.rows = self.record.rows
        self.steps = self.record.steps

    def predict(self, lane: Lane) -> Array:
        """What the channels read (R, M) in one lane."""
        return self.all([lane])[0]

    def all(self, lanes: Sequence[Lane]) -> list[Array]:
        """What the channels read (R, M) in each lane."""
        with ThreadPoolExecutor(THREADS) as pool:
            return list(pool.map(self._run, lanes))

    def states(self, lane: Lane) -> Array:
        """The states (R, nx) of one lane."""
        arm = self.arms.get()
        try:
            return self._roll(arm, lane, self._inputs(arm, lane)[0])
        finally:
            self.arms.put(arm)

    def _run(self, lane: Lane) -> Array:
        arm = self.arms.get()
        try:
            inputs, at = self._inputs(arm, lane)
            states = self._roll(arm, lane, inputs)
            seen = arm.outputs(states, inputs[self.rows])
        finally:
            self.arms.put(arm)
        columns = [at[self.rows, j - 1] if q == "motor_current" else seen[q][:, j - 1] for q, j in self.record.outputs]
        return np.stack(columns, 1)

    def _inputs(self, arm: Arm, lane: Lane) -> tuple[Array, Array]:
        """What acts from each row to the next (T, nu), and what a current sensor reads in each row (T, n)."""
        arm._prepare(lane.p)
        n = arm.n
        inputs = self.record.command.copy()
        if hasattr(arm, "acting"):
            inputs[:, :n], at = arm.acting(self.record.command[:, :n], self.steps, self.record.before)
        else:
            at = np.concatenate([self.record.before[None], inputs[:-1, :n]])
        if lane.torque is not None:
            for j in range(1, n + 1):
                gain = arm.parameters.described.get(f"torque_constant_{j}")
                inputs[:, j - 1] += lane.torque[:, j - 1] / (gain.nominal if gain else 1.0)
        return inputs, at

    def _roll(self, arm: Arm, lane: Lane, inputs: Array) -> Array:
        """The states (R, nx), the effects' own carried from window to window."""
        record, parts, hidden = self.record, [], np.zeros(arm.nx - self.m)
        for w, (first, end) in enumerate(zip(record.starts, record.ends, strict=True)):
            if w and record.ends[w - 1] != first:
                hidden = np.zeros_like(hidden)
            x = np.concatenate([lane.begun[w], hidden])
            path = self._window(arm, lane, x, inputs, int(first), int(end))
            good = within(arm, path)
            if not good.all():
                last = max(int(np.argmin(good)) - 1, 0)
                path[last + 1 :] = path[last]
            parts.append(path[:-1])
            hidden = path[-1, self.m :]
        return np.concatenate(parts)

    def _window(self, arm: Arm, lane: Lane, x: Array, inputs: Array, first: int, end: int) -> Array:
        """The states of one window (end − first + 1, nx)."""
        if lane.impulse is None or not lane.impulse[first:end].any():
            return arm.rollout(x, inputs[first:end], self.steps[first:end], exact=True, most=self.most)
        kicks = first + np.flatnonzero(lane.impulse[first:end].any(1))
        at, parts = first, []
        speeds = [arm.index(f"joint_velocity_{j}") for j in range(1, arm.n + 1)]
        places = [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]
        for row in [*kicks.tolist(), end]:
            if row > at:
                path = arm.rollout(x, inputs[at:row], self.steps[at:row], exact=True, most=self.most)
                parts.append(path[:-1])
                x, at = path[-1], row
            if row < end:
                M = arm.evaluate("mass_matrix", q=x[places])["M"].reshape(arm.n, arm.n)
                x = x.copy()
                x[speeds] += np.linalg.solve(M, lane.impulse[row])
        return np.concatenate([*parts, x[None]])
