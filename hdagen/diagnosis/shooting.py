"""Shooting: what the model predicts in the windows, and how that changes with each parameter, first state and torque.

A lane is one simulation. Derivatives are differences of lanes: dry friction sticks exactly, so a difference over the
size that matters is wanted, not a slope at a point. Lanes run side by side, as many as a vector of the library has, and
such groups in threads; the compiled rollout lets go of the interpreter.

A lane in which an effect is there that remembers goes through all windows, others through those alone that are looked
at; so do lanes near one of which the memory is known, as far as they change nothing that remembers.

Memories that the build slows to the robot file's step are slowed as far as the step of the lanes asks for. A lane that
reads what is no number, or has a window that flies apart and stays where it was last within its limits, is counted as
failed.

Legend: T rows, W windows, K windows that are looked at, of R rows, S of them looked at, M channels, L lanes that run at
once, m positions and velocities of the state.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from queue import SimpleQueue
from threading import Lock

import numpy as np

from hdagen import late
from hdagen.diagnosis.asked import asked
from hdagen.diagnosis.portion import Mask
from hdagen.diagnosis.record import Record
from hdagen.plant import DECAYS, Arm, Array
from hdagen.readings import Rows, joint_angles, limits, mechanical, memories, places, unread
from hdagen.together import THREADS, together
from hdagen.torques import full_torsion, torque_per_input

TWISTED = 0.7  # of the torsion at which the spring law ends, that a window may begin with
MEMORY = 2**28  # bytes at most for the lanes of a thread, so that a long log runs fewer at once
FEW = 2  # lanes that are faster one by one than in a vector
HIGHEST, MARGIN = 0.999, 1.5  # quantile of the torque that motion asks for, and how much more a lane may come to
STAGES = 4  # whose outcome is kept
DRIVES = {"motor_current", "motor_torque"}  # what is read of inputs alone
PROMPT = DRIVES | {"motor_position", "joint_position"}  # of positions, too


@dataclass(frozen=True, eq=False)
class Lane:
    """One simulation: parameters (np), first states (W, m), torque (T, n) added at the motors, N m, and impulses on the
    links, N m s: (T, n), each at its row. ``memory``: effects' own states (K, nx − m) with which the windows that are
    looked at begin; without, those in which the windows before leave them."""

    p: Array
    begun: Array
    torque: Array | None = None
    impulse: Array | None = None
    memory: Array | None = None


@dataclass(frozen=True, eq=False)
class Course:
    """Windows that a lane goes through: ``rows`` of the record that it takes inputs from, ``many``; ``edges`` of the
    windows in them; ``size`` how many rows lie in windows, and which of those in windows that are looked at (``seen``);
    which of the record's ``windows`` they are."""

    rows: Rows | slice
    many: int
    edges: Rows
    size: int
    windows: Rows | slice
    seen: Rows | slice

    @classmethod
    def whole(cls, record: Record) -> Course:
        """All windows of a record."""
        seen = np.searchsorted(record.rows, record.rows_of(record.kept))
        return cls(slice(None), len(record.time), record.edges, len(record.rows), slice(None), seen)

    @classmethod
    def brief(cls, record: Record) -> Course:
        """Those alone that are looked at, a row between them: none begins as the one before ends."""
        first, end = record.starts[record.kept], record.ends[record.kept]
        rows = np.concatenate([np.append(np.arange(a, b), a) for a, b in zip(first, end, strict=True)])
        ends = np.cumsum(end - first + 1) - 1
        return cls(
            rows, len(rows), np.stack([ends - (end - first), ends], 1), len(rows) - len(ends), record.kept, slice(None)
        )


@dataclass(frozen=True, eq=False)
class Seat:
    """Memory that one thread works in, for L lanes: ``inputs``, what acts from each row to the next, ``constants``
    (L, nc), and states."""

    inputs: Array
    constants: Array
    states: Array

    @classmethod
    def of(cls, arm: Arm, record: Record) -> Seat:
        """For lanes of a record on an arm."""
        shapes = ((len(record.time) + len(record.kept), arm.nu), arm.c.shape, (len(record.rows), arm.nx))
        lanes = min(arm.module.batch_width, max(1, MEMORY // (8 * sum(map(math.prod, shapes)))))
        return cls(*(np.empty((lanes, *shape)) for shape in shapes))

    def room(self, course: Course, lanes: int) -> tuple[Array, Array]:
        """Memory for the inputs (L, rows, nu) and states (L, rows in windows, nx) of ``lanes`` on a course."""
        inputs = (lanes, course.many, self.inputs.shape[2])
        states = (lanes, course.size, self.states.shape[2])
        return (
            self.inputs.reshape(-1)[: math.prod(inputs)].reshape(inputs),
            self.states.reshape(-1)[: math.prod(states)].reshape(states),
        )


@dataclass(eq=False)
class Shooting:
    """All lanes of one record on one model."""

    arm: Arm
    record: Record
    most: float = 1e-3  # s, a step of integration
    seats: SimpleQueue[Seat] = field(init=False)
    run: int = field(init=False, default=0)  # lanes
    failed: int = field(init=False, default=0)  # of them

    def __post_init__(self) -> None:
        record, self.m = self.record, mechanical(self.arm)
        self.most = min(self.most, max(self._carried(), self.arm.step_size))
        self.whole, self.brief = Course.whole(record), Course.brief(record)
        self.steps = record.steps
        self.rows = record.rows_of(record.kept)
        self.begins = self.brief.edges[:, 0] - np.arange(len(record.kept))
        self.looked = np.searchsorted(self.rows, record.rows[np.concatenate(record.looked)])
        self.shown = self.rows[self.looked]  # of the record, those that are looked at
        self.command = np.ascontiguousarray(record.command[:, : self.arm.n])
        self.seats = SimpleQueue()
        for _ in range(THREADS):
            self.seats.put(seat := Seat.of(self.arm, record))
        self.width = len(seat.inputs)
        self.none = np.zeros((len(record.kept), self.arm.nx - self.m))
        self.path = late.Path(record.time[self.rows], self.begins)
        self.speeds = [self.arm.index(f"joint_velocity_{j}") for j in range(1, self.arm.n + 1)]
        self.moving = [k for k, name in enumerate(self.arm.state_names) if "velocity" in name]
        self.limit = limits(self.arm)
        self.gains = torque_per_input(self.arm)
        self.most_twisted = TWISTED * full_torsion(self.arm)[[j - 1 for j in self.arm.manifest["flexible"]]]
        self.acted: dict[bytes, tuple[Array, Array]] = {}
        effects, whole = self.arm.manifest["effects"], ("amplitudes", "shapes")
        self.staging = places(self.arm, (e for e in effects if e["place"] == "input"), *whole)
        self.remembering = places(self.arm, (e for e in effects if e["states"]), *whole)
        self.loudness = memories(self.arm)
        self.counting = Lock()

    def _carried(self) -> float:
        """The step, s, that carries the springs under what the record's motion asks for; the robot file's own was
        looked at by the build, and is short enough."""
        torque = np.abs(asked(self.arm, self.record).torque)
        return self.arm.carried.loaded(self.arm, MARGIN * np.quantile(torque, HIGHEST, axis=0))

    def _at(self, p: Array) -> Arm:
        """The arm with parameters ``p``, its memories slowed as far as the longest step of any lane asks for: lanes of
        other steps would differ by that, too."""
        if "memory_step" in self.arm.parameters.described:
            p = p.copy()
            p[self.arm.parameters.place("memory_step")] = self.most / DECAYS
        return self.arm.at(p)

    def predict(self, lane: Lane) -> Array:
        """What the channels read (S, M) in one lane."""
        return self.all([lane])[0]

    def recalled(self, lane: Lane) -> tuple[Array, Array]:
        """What the channels read (S, M) in one lane, and the effects' own states (K, nx − m) with which the windows
        that are looked at begin."""
        with self._seat() as seat:
            x = self._states(seat, [lane])[0]
            return self._read(lane, x), x[self.begins, self.m :].copy()

    def near(self, base: Lane, lanes: Sequence[Lane]) -> list[Array]:
        """What the channels read (S, M) in lanes near one whose memory is known. Those that have what remembers as it
        does begin their windows with that: what else they change, they change little in it, and a first state or a
        torque should only tell of its own window."""
        own = base.p[self.remembering]
        alike = [np.array_equal(lane.p[self.remembering], own) for lane in lanes]
        return self.all([replace(o, memory=base.memory) if a else o for o, a in zip(lanes, alike, strict=True)])

    def all(self, lanes: Sequence[Lane]) -> list[Array]:
        """What the channels read (S, M) in each lane."""
        alike: dict[tuple[float, bool, bool], list[int]] = {}
        for k, lane in enumerate(lanes):  # a lane takes its own step in whatever company
            kind = self._step(lane), lane.impulse is not None, self._remembers(lane)
            alike.setdefault(kind, []).append(k)
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
        return min(self.most, self.arm.carried.longest(lane.p))

    def _remembers(self, lane: Lane) -> bool:
        """Whether an effect is there that remembers what was before the windows that are looked at."""
        return lane.memory is None and bool(lane.p[self.loudness].any())

    def states(self, lane: Lane) -> Array:
        """The states (R, nx) of one lane."""
        with self._seat() as seat:
            return self._states(seat, [lane])[0].copy()

    def begun(self, p: Array) -> Array:
        """First states (W, m) as measured by sensors of parameters ``p``, no spring twisted further than it bears."""
        x = unread(self.arm.at(p), self.record.begun.copy(), range(1, self.arm.n + 1))
        for j, most in zip(self.arm.manifest["flexible"], self.most_twisted, strict=True):
            motor, joint = (self.arm.index(f"{side}_position_{j}") for side in ("motor", "joint"))
            base = x[:, motor] / self.arm.parameters[f"ratio_{j}"]
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
        """What the channels read (S, M) in each of the lanes of a group."""
        with self._seat() as seat:
            return [self._read(lane, x) for lane, x in zip(lanes, self._states(seat, lanes), strict=True)]

    def _states(self, seat: Seat, lanes: Sequence[Lane]) -> list[Array]:
        """The states (R, nx) of each lane."""
        remembers, many = self._remembers(lanes[0]), len(lanes)
        course = self.whole if remembers else self.brief
        inputs, states = seat.room(course, many)
        steps = self.steps[course.rows]
        memory = None if remembers else np.stack([self.none if lane.memory is None else lane.memory for lane in lanes])
        jump = np.zeros((many, course.many, self.arm.nx)) if lanes[0].impulse is not None else None
        for k, lane in enumerate(lanes):
            arm = self._at(lane.p)
            seat.constants[k] = arm.c
            self._drive(arm, lane, course.rows, inputs[k])
            if jump is not None and lane.impulse is not None:
                kicked = np.einsum("tij,tj->ti", self.mobility[course.rows], lane.impulse[course.rows])
                jump[k][:, self.speeds] = kicked
        begun, c = np.stack([lane.begun[course.windows] for lane in lanes]), seat.constants[:many]
        step = self._step(lanes[0])  # that of all of them
        x = self.arm.windows(begun, course.edges, inputs, steps, step, self.limit, jump, c, states, memory)
        return [one[course.seen] for one in x]

    def _acted(self, arm: Arm) -> tuple[Array, Array]:
        """What commands make act, and what each row shows of it (T, n each), on an arm; the last few are kept."""
        key = arm.p[self.staging].tobytes()
        found = self.acted.get(key)  # threads share it
        if found is None:
            found = arm.acting(self.command, self.steps, self.record.before)
            measured = [j - 1 for j in self.record.uncommanded]
            found[0][:, measured] = self.command[:, measured]
            if len(self.acted) >= STAGES:
                self.acted.clear()
            self.acted[key] = found
        return found

    def _drive(self, arm: Arm, lane: Lane, rows: Rows | slice, inputs: Array) -> None:
        """What acts in a lane, at whose parameters the arm stands, into ``inputs`` (rows, nu)."""
        n = arm.n
        inputs[:] = _rows(self.record.command, rows)
        inputs[:, :n] = _rows(self._acted(arm)[0], rows)
        if lane.torque is not None:
            inputs[:, :n] += lane.torque[rows] / self.gains

    def _read(self, lane: Lane, x: Array) -> Array:
        """What the channels read (S, M) in a lane that is in the states ``x`` (R, nx)."""
        arm = self._at(lane.p)
        if {quantity for quantity, _ in self.record.outputs} <= PROMPT:
            seen = late.positions(arm, self.path, x)
        else:
            inputs = np.empty((len(x), arm.nu))
            self._drive(arm, lane, self.rows, inputs)
            seen = late.read(arm, self.path.time, x, inputs, self.begins)
        acted, told = self._acted(arm)[1], np.empty((len(self.looked), len(self.record.outputs)))
        for k, (quantity, j) in enumerate(self.record.outputs):
            drives = quantity in DRIVES
            told[:, k] = acted[:, j - 1].take(self.shown) if drives else seen[quantity][:, j - 1].take(self.looked)
        told[:] = told if np.isfinite(lane.p).all() else np.nan
        with self.counting:
            self.run += 1
        if not np.isfinite(told).all() or self._stayed(x).any():
            self.fail()
        return told

    def fail(self) -> None:
        """Counts what has failed, from any thread."""
        with self.counting:
            self.failed += 1

    def _stayed(self, x: Array) -> Mask:
        """Of which windows (K) the states (R, nx) stay at the end though they move: those fly apart."""
        ends = np.append(self.begins[1:], len(x)) - 1
        return np.asarray((x[ends] == x[ends - 1]).all(1) & x[ends][:, self.moving].any(1))

    @cached_property
    def mobility(self) -> Array:
        """The inverse of the mass matrix (T, n, n) where the arm was measured: what an impulse on the links does."""
        arm, q = self.arm, joint_angles(self.arm, self.record.log)
        return np.asarray(np.linalg.inv(arm.evaluate("mass_matrix", q=q)["M"].reshape(-1, arm.n, arm.n)), float)


def _rows(of: Array, rows: Rows | slice) -> Array:
    """``of[rows]``: whole rows are taken several times as fast as by an index."""
    return of[rows] if isinstance(rows, slice) else of.take(rows, 0)
