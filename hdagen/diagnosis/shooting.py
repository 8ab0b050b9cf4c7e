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
from functools import cached_property
from queue import SimpleQueue

import numpy as np

from hdagen import late
from hdagen.diagnosis.record import Record
from hdagen.plant import Arm, Array
from hdagen.readings import full_torsion, limits, mechanical, unread

THREADS = 2
TWISTED = 0.7  # of the torsion at which the spring law ends, that a window may begin with


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
        self.begins = np.concatenate([[0], np.cumsum(self.record.ends - self.record.starts)[:-1]])
        self.speeds = [self.arm.index(f"joint_velocity_{j}") for j in range(1, self.arm.n + 1)]
        self.limit = limits(self.arm)
        self.most_twisted = TWISTED * full_torsion(self.arm)[[j - 1 for j in self.arm.manifest["flexible"]]]

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

    def begun(self, p: Array) -> Array:
        """First states (W, m) as measured by sensors of parameters ``p``, no spring twisted further than it bears."""
        arm, x = self.arm, self.record.begun.copy()
        arm._prepare(p)
        unread(arm, x, range(1, arm.n + 1))
        arm._prepare(np.array([q.nominal for q in arm.parameters.described.values()]))
        for j, most in zip(arm.manifest["flexible"], self.most_twisted, strict=True):
            motor, joint = (arm.index(f"{side}_position_{j}") for side in ("motor", "joint"))
            base = x[:, motor] / arm.parameters[f"ratio_{j}"]
            x[:, joint] = base - np.clip(base - x[:, joint], -most, most)
        return x[:, : self.m]

    def begin(self) -> tuple[Array, Array]:
        """The robot file's own parameters (np), and the first states (W, m) as measured."""
        p = self.arm.p.copy()
        return p, self.begun(p)

    def _run(self, lane: Lane) -> Array:
        arm = self.arms.get()
        try:
            inputs, at = self._inputs(arm, lane)
            states = self._roll(arm, lane, inputs)
            seen = late.read(arm, self.record.time[self.rows], states, inputs[self.rows], self.begins)
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
        jump = None
        if lane.impulse is not None:
            jump = np.zeros((len(self.record.time), arm.nx))
            jump[:, self.speeds] = np.einsum("tij,tj->ti", self.mobility, lane.impulse)
        return arm.windows(lane.begun, self.record.edges, inputs, self.steps, self.most, self.limit, jump)

    @cached_property
    def mobility(self) -> Array:
        """The inverse of the mass matrix (T, n, n) where the arm was measured: what an impulse on the links does."""
        arm, log = self.arm, self.record.log
        q = [
            log[f"joint_position_{j}"]
            if f"joint_position_{j}" in log
            else log[f"motor_position_{j}"] / arm.parameters[f"ratio_{j}"]
            for j in range(1, arm.n + 1)
        ]
        return np.asarray(
            np.linalg.inv(arm.evaluate("mass_matrix", q=np.stack(q, 1))["M"].reshape(-1, arm.n, arm.n)), float
        )
