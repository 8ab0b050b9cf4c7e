"""Shooting: what the model predicts in every window, and how that changes with each parameter, first state and torque.

A lane is one simulation of all windows. Derivatives are differences of lanes: dry friction sticks exactly, so a
difference over the size that matters is wanted, not a slope at a point. Lanes run side by side, as many as a vector of
the library has, and such groups in threads; the compiled rollout lets go of the interpreter.

Legend: T rows, R rows in windows, W windows, M channels, L lanes that run at once, m positions and velocities of the
state.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from queue import SimpleQueue

import numpy as np

from hdagen import late
from hdagen.diagnosis.record import Record
from hdagen.diagnosis.together import THREADS, together
from hdagen.plant import Arm, Array
from hdagen.readings import full_torsion, joint_angles, limits, mechanical, torque_per_input, unread

TWISTED = 0.7  # of the torsion at which the spring law ends, that a window may begin with
MEMORY = 2**28  # bytes at most for the lanes of a thread, so that a long log runs fewer at once
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


@dataclass(frozen=True, eq=False)
class Seat:
    """What one thread works with: an arm, and memory for L lanes. ``inputs`` (L, T, nu): what acts from each row to
    the next; ``shown`` (L, T, n): what a current sensor reads in each row; ``constants`` (L, nc); states ``x``
    (L, R, nx)."""

    arm: Arm
    inputs: Array
    shown: Array
    constants: Array
    x: Array

    @classmethod
    def of(cls, arm: Arm, record: Record) -> Seat:
        """With an arm of its own and new memory, in which the record's forces at the tip stand."""
        rows, within = len(record.time), len(record.rows)
        shapes = ((rows, arm.nu), (rows, arm.n), arm.c.shape, (within, arm.nx))
        lanes = min(arm.module.batch_width, max(1, MEMORY // (8 * sum(map(math.prod, shapes)))))
        seat = cls(Arm(arm.folder), *(np.empty((lanes, *shape)) for shape in shapes))
        seat.inputs[..., arm.n :] = record.command[:, arm.n :]
        return seat


@dataclass(eq=False)
class Shooting:
    """All lanes of one record on one model."""

    arm: Arm
    record: Record
    most: float = 1e-3  # s, a step of integration
    seats: SimpleQueue[Seat] = field(init=False)

    def __post_init__(self) -> None:
        self.m = mechanical(self.arm)
        self.rows, self.edges, self.steps = self.record.rows, self.record.edges, self.record.steps
        whole = self.rows[-1] - self.rows[0] + 1 == len(self.rows)  # no row between windows
        self.within = slice(self.rows[0], self.rows[-1] + 1) if whole else self.rows
        self.command = np.ascontiguousarray(self.record.command[:, : self.arm.n])
        self.seats = SimpleQueue()
        for _ in range(THREADS):
            self.seats.put(seat := Seat.of(self.arm, self.record))
        self.width = len(seat.x)
        self.begins = np.concatenate([[0], np.cumsum(self.record.ends - self.record.starts)[:-1]])
        self.path = late.Path(self.record.time[self.rows], self.begins)
        self.speeds = [self.arm.index(f"joint_velocity_{j}") for j in range(1, self.arm.n + 1)]
        self.limit = limits(self.arm)
        self.gains = torque_per_input(self.arm)
        self.most_twisted = TWISTED * full_torsion(self.arm)[[j - 1 for j in self.arm.manifest["flexible"]]]

    def predict(self, lane: Lane) -> Array:
        """What the channels read (R, M) in one lane."""
        return self.all([lane])[0]

    def all(self, lanes: Sequence[Lane]) -> list[Array]:
        """What the channels read (R, M) in each lane."""
        alike: dict[tuple[float, bool], list[int]] = {}
        for k, lane in enumerate(lanes):  # a lane takes its own step in whatever company
            alike.setdefault((self._step(lane), lane.impulse is not None), []).append(k)
        groups = [group for same in alike.values() for group in self._split(same)]
        seen = together(lambda group: self._run([lanes[k] for k in group]), groups)
        found = {
            k: read for group, reads in zip(groups, seen, strict=True) for k, read in zip(group, reads, strict=True)
        }
        return [found[k] for k in range(len(lanes))]

    def _split(self, lanes: list[int]) -> list[list[int]]:
        """Groups that run at once, of about one size."""
        most = 1 if len(lanes) <= FEW else self.width
        return [group.tolist() for group in np.array_split(lanes, -(-len(lanes) // most))]

    def _step(self, lane: Lane) -> float:
        """The longest step of a lane, s."""
        return min(self.most, self.arm.damping.longest_step(lane.p))

    def states(self, lane: Lane) -> Array:
        """The states (R, nx) of one lane."""
        with self._seat() as seat:
            return self._states(seat, [lane])[0].copy()

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
    def _seat(self) -> Iterator[Seat]:
        """One that no other thread uses meanwhile."""
        seat = self.seats.get()
        try:
            yield seat
        finally:
            self.seats.put(seat)

    def _run(self, lanes: Sequence[Lane]) -> list[Array]:
        """What the channels read (R, M) in each of the lanes of a group."""
        with self._seat() as seat:
            x = self._states(seat, lanes)
            return [self._read(seat, k, lane, x[k]) for k, lane in enumerate(lanes)]

    def _states(self, seat: Seat, lanes: Sequence[Lane]) -> Array:
        """The states (L, R, nx), the effects' own carried from window to window."""
        jump, many = None, len(lanes)
        for k, lane in enumerate(lanes):
            self._inputs(seat, k, lane)
            if lane.impulse is not None:
                jump = np.zeros((many, len(self.steps), seat.arm.nx)) if jump is None else jump
                jump[k][:, self.speeds] = np.einsum("tij,tj->ti", self.mobility, lane.impulse)
        begun, c, x = np.stack([lane.begun for lane in lanes]), seat.constants[:many], seat.x[:many]
        step = self._step(lanes[0])  # that of all of them
        return seat.arm.windows(begun, self.edges, seat.inputs[:many], self.steps, step, self.limit, jump, c, x)

    def _inputs(self, seat: Seat, k: int, lane: Lane) -> None:
        """Lane k's inputs and constants."""
        arm, n = seat.arm, seat.arm.n
        arm._prepare(lane.p)
        seat.constants[k] = arm.c
        acting, seat.shown[k] = arm.acting(self.command, self.steps, self.record.before)
        seat.inputs[k, :, :n] = acting if lane.torque is None else acting + lane.torque / self.gains

    def _read(self, seat: Seat, k: int, lane: Lane, x: Array) -> Array:
        """What the channels read (R, M) in lane k, which is in the states ``x`` (R, nx)."""
        seat.arm._prepare(lane.p)
        if {quantity for quantity, _ in self.record.outputs} <= PROMPT:
            seen = late.positions(seat.arm, self.path, x)
        else:
            seen = late.read(seat.arm, self.path.time, x, seat.inputs[k][self.within], self.begins)
        seen["motor_current"] = seat.shown[k][self.within]
        return np.stack([seen[quantity][:, j - 1] for quantity, j in self.record.outputs], 1)

    @cached_property
    def mobility(self) -> Array:
        """The inverse of the mass matrix (T, n, n) where the arm was measured: what an impulse on the links does."""
        arm, q = self.arm, joint_angles(self.arm, self.record.log)
        return np.asarray(np.linalg.inv(arm.evaluate("mass_matrix", q=q)["M"].reshape(-1, arm.n, arm.n)), float)
