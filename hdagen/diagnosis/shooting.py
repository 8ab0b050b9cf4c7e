"""Shooting: what the model predicts in every window, and how that changes with each parameter, first state and torque.

A lane is one simulation of all windows. Derivatives are differences of lanes: dry friction sticks exactly, so a
difference over the size that matters is wanted, not a slope at a point. Lanes run side by side, as many as a vector of
the library has, and such groups in threads; the compiled rollout lets go of the interpreter.

Legend: T rows, R rows in windows, W windows, M channels, L lanes that run at once, m positions and velocities of the
state.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
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
FEW = 2  # lanes that are faster one by one than in a vector
PROMPT = {"motor_current", "motor_position", "joint_position"}  # what is read of positions and inputs alone


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
        self.rows, self.edges, self.steps = self.record.rows, self.record.edges, self.record.steps
        self.begins = np.concatenate([[0], np.cumsum(self.record.ends - self.record.starts)[:-1]])
        self.path = late.Path(self.record.time[self.rows], self.begins)
        self.speeds = [self.arm.index(f"joint_velocity_{j}") for j in range(1, self.arm.n + 1)]
        self.limit = limits(self.arm)
        described = self.arm.parameters.described
        gains = [described.get(f"torque_constant_{j}") for j in range(1, self.arm.n + 1)]
        self.gains = np.array([gain.nominal if gain else 1.0 for gain in gains])  # N m of a unit of the input
        self.most_twisted = TWISTED * full_torsion(self.arm)[[j - 1 for j in self.arm.manifest["flexible"]]]

    def predict(self, lane: Lane) -> Array:
        """What the channels read (R, M) in one lane."""
        return self.all([lane])[0]

    def all(self, lanes: Sequence[Lane]) -> list[Array]:
        """What the channels read (R, M) in each lane."""
        order = sorted(range(len(lanes)), key=lambda k: lanes[k].impulse is not None)  # those with impulses together
        most = 1 if len(lanes) <= FEW else self.arm.module.batch_width
        groups = [g.tolist() for g in np.array_split(order, -(-len(lanes) // most))] if lanes else []
        with ThreadPoolExecutor(THREADS) as pool:
            seen = list(pool.map(lambda group: self._run([lanes[k] for k in group]), groups))
        found = dict(zip(order, (one for group in seen for one in group), strict=True))
        return [found[k] for k in range(len(lanes))]

    def states(self, lane: Lane) -> Array:
        """The states (R, nx) of one lane."""
        with self._lent() as arm:
            inputs, _, constants = self._inputs(arm, [lane])
            return self._roll(arm, [lane], inputs, constants)[0]

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

    @contextmanager
    def _lent(self) -> Iterator[Arm]:
        """An arm that no other thread uses meanwhile."""
        arm = self.arms.get()
        try:
            yield arm
        finally:
            self.arms.put(arm)

    def _run(self, lanes: Sequence[Lane]) -> list[Array]:
        with self._lent() as arm:
            inputs, shown, constants = self._inputs(arm, lanes)
            states = self._roll(arm, lanes, inputs, constants)
            return [self._read(arm, *one) for one in zip(lanes, states, inputs, shown, strict=True)]

    def _read(self, arm: Arm, lane: Lane, x: Array, inputs: Array, shown: Array) -> Array:
        """What the channels read (R, M) in the states ``x`` (R, nx) of one lane."""
        arm._prepare(lane.p)
        if {quantity for quantity, _ in self.record.outputs} <= PROMPT:
            seen = late.positions(arm, self.path, x)
        else:
            seen = late.read(arm, self.path.time, x, inputs[self.rows], self.begins)
        seen["motor_current"] = shown[self.rows]
        return np.stack([seen[quantity][:, j - 1] for quantity, j in self.record.outputs], 1)

    def _inputs(self, arm: Arm, lanes: Sequence[Lane]) -> tuple[Array, Array, Array]:
        """Of each lane what acts from each row to the next (L, T, nu), what a current sensor reads in each row
        (L, T, n), and the constants (L, nc)."""
        record, n = self.record, arm.n
        inputs = np.empty((len(lanes), *record.command.shape))
        shown = np.empty((len(lanes), len(record.time), n))
        constants = np.empty((len(lanes), len(arm.c)))
        for k, lane in enumerate(lanes):
            arm._prepare(lane.p)
            constants[k] = arm.c
            inputs[k, :, n:] = record.command[:, n:]
            inputs[k, :, :n], shown[k] = arm.acting(record.command[:, :n], self.steps, record.before)
            if lane.torque is not None:
                inputs[k, :, :n] += lane.torque / self.gains
        return inputs, shown, constants

    def _roll(self, arm: Arm, lanes: Sequence[Lane], inputs: Array, constants: Array) -> Array:
        """The states (L, R, nx), the effects' own carried from window to window."""
        jump = None
        if any(lane.impulse is not None for lane in lanes):
            jump = np.zeros((len(lanes), len(self.record.time), arm.nx))
            for k, lane in enumerate(lanes):
                if lane.impulse is not None:
                    jump[k][:, self.speeds] = np.einsum("tij,tj->ti", self.mobility, lane.impulse)
        begun = np.stack([lane.begun for lane in lanes])
        return arm.windows(begun, self.edges, inputs, self.steps, self.most, self.limit, jump, constants)

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
