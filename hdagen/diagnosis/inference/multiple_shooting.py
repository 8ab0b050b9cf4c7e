"""Multiple shooting: predicted readings in short windows, and their change with each parameter, initial state and
torque.

A lane is one simulation. Derivatives are differences between lanes: dry friction sticks exactly, so a difference over
the size that matters is wanted, not a slope at a point. Lanes run side by side, as many as a vector of the compiled
library holds, and such groups run in threads; the compiled rollout releases the interpreter.

A lane whose effects have a memory runs through all windows, any other lane through the selected windows alone. Near a
lane whose memory is known, a lane that changes nothing of that memory runs through the selected windows, too.

A build may slow effects' own states to the robot file's step; here they are slowed as far as the lanes' longest step
requires. A lane counts as failed where a reading is no number, or where a window diverges and stays at its last state
within the limits.

Legend: T rows, W windows, K selected windows with R rows, S sampled rows of these, M channels, L lanes that run at
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

from hdagen.arm import delayed_sensors
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import DECAYS, Arm
from hdagen.arm.ratings import full_torsion, torque_per_input
from hdagen.diagnosis.data.required_torque import asked
from hdagen.diagnosis.data.split import Mask
from hdagen.diagnosis.data.windows import Record
from hdagen.prediction.measurement_model import Rows, joint_angles, limits, mechanical, memories, places, unread
from hdagen.support.parallel import THREADS, together

TWISTED = 0.7  # of the torsion at which the spring law ends: the largest torsion that a window begins with
MEMORY = 2**28  # bytes at most for the lanes of a thread, so that a long log runs fewer at once
FEW = 2  # lanes that run faster one by one than in a vector
HIGHEST, MARGIN = 0.999, 1.5  # quantile of the required torque, and the factor by which a lane may exceed it
STAGES = 4  # effective inputs that are kept for the next lanes
DRIVES = {"motor_current", "motor_torque"}  # readings that depend on inputs alone
PROMPT = DRIVES | {"motor_position", "joint_position"}  # readings that depend on inputs or positions alone


@dataclass(frozen=True, eq=False)
class Lane:
    """One simulation: parameters (np), initial states (W, m), torque (T, n) added at the motors, N m, and impulses on
    the links (T, n), N m s, each at its row. ``memory``: effects' own states (K, nx − m) at which the selected windows
    begin; without them the lane carries these states on from window to window."""

    p: Array
    begun: Array
    torque: Array | None = None
    impulse: Array | None = None
    memory: Array | None = None


@dataclass(frozen=True, eq=False)
class Course:
    """The windows of a lane: ``rows`` of the record that give its inputs, ``many`` of them; ``edges`` of the windows in
    these rows; ``size``: number of rows in windows; ``windows`` of the record; ``seen``: rows in selected windows,
    among those in windows."""

    rows: Rows | slice
    many: int
    edges: Rows
    size: int
    windows: Rows | slice
    seen: Rows | slice

    @classmethod
    def whole(cls, record: Record) -> Course:
        """Return the schedule of all windows of a record."""
        seen = np.searchsorted(record.rows, record.rows_of(record.kept))
        return cls(slice(None), len(record.time), record.edges, len(record.rows), slice(None), seen)

    @classmethod
    def brief(cls, record: Record) -> Course:
        """Return the schedule of the selected windows alone, with a row between them, as no window begins where the one
        before ends."""
        first, end = record.starts[record.kept], record.ends[record.kept]
        rows = np.concatenate([np.append(np.arange(a, b), a) for a, b in zip(first, end, strict=True)])
        ends = np.cumsum(end - first + 1) - 1
        return cls(
            rows, len(rows), np.stack([ends - (end - first), ends], 1), len(rows) - len(ends), record.kept, slice(None)
        )


@dataclass(frozen=True, eq=False)
class Seat:
    """Working memory of one thread for L lanes: ``inputs`` from each row to the next, ``constants`` (L, nc), and
    states."""

    inputs: Array
    constants: Array
    states: Array

    @classmethod
    def of(cls, arm: Arm, record: Record) -> Seat:
        """Allocate the memory for lanes of a record on an arm."""
        shapes = ((len(record.time) + len(record.kept), arm.nu), arm.c.shape, (len(record.rows), arm.nx))
        lanes = min(arm.module.batch_width, max(1, MEMORY // (8 * sum(map(math.prod, shapes)))))
        return cls(*(np.empty((lanes, *shape)) for shape in shapes))

    def room(self, course: Course, lanes: int) -> tuple[Array, Array]:
        """Return memory for the inputs (L, rows, nu) and the states (L, rows in windows, nx) of ``lanes`` on a
        course."""
        inputs = (lanes, course.many, self.inputs.shape[2])
        states = (lanes, course.size, self.states.shape[2])
        return (
            self.inputs.reshape(-1)[: math.prod(inputs)].reshape(inputs),
            self.states.reshape(-1)[: math.prod(states)].reshape(states),
        )


@dataclass(eq=False)
class Shooting:
    """Simulates the lanes of one record on one model; ``run`` and ``failed`` count them."""

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
        self.shown = self.rows[self.looked]  # sampled rows of the record
        self.command = np.ascontiguousarray(record.command[:, : self.arm.n])
        self.seats = SimpleQueue()
        for _ in range(THREADS):
            self.seats.put(seat := Seat.of(self.arm, record))
        self.width = len(seat.inputs)
        self.none = np.zeros((len(record.kept), self.arm.nx - self.m))
        self.path = delayed_sensors.Path(record.time[self.rows], self.begins)
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
        """Choose the longest step, s, that keeps the springs stable under the required torque. The robot file's own
        step was checked by the build and is always short enough."""
        torque = np.abs(asked(self.arm, self.record).torque)
        return self.arm.carried.loaded(self.arm, MARGIN * np.quantile(torque, HIGHEST, axis=0))

    def _at(self, p: Array) -> Arm:
        """Return the arm with parameters ``p``. Its slowed states all take the longest step of any lane: otherwise
        lanes of other steps would differ by that, too."""
        if "memory_step" in self.arm.parameters.described:
            p = p.copy()
            p[self.arm.parameters.place("memory_step")] = self.most / DECAYS
        return self.arm.at(p)

    def predict(self, lane: Lane) -> Array:
        """Predict the readings of one lane.

        Args:
            lane: the simulation.

        Returns:
            Readings (S, M) in the channels' units.

        """
        return self.all([lane])[0]

    def recalled(self, lane: Lane) -> tuple[Array, Array]:
        """Predict the readings of one lane and keep the memory of its effects.

        Args:
            lane: the simulation.

        Returns:
            Readings (S, M), and the effects' own states (K, nx − m) at which the selected windows begin.

        """
        with self._seat() as seat:
            x = self._states(seat, [lane])[0]
            return self._read(lane, x), x[self.begins, self.m :].copy()

    def near(self, base: Lane, lanes: Sequence[Lane]) -> list[Array]:
        """Predict the readings of lanes near one whose memory is known. A lane with the same parameters of effects with
        memory begins its windows with that memory. Its other changes affect the memory little, and an initial state or
        a torque should only act in its own window.

        Args:
            base: the lane whose memory is known.
            lanes: the lanes near it.

        Returns:
            Readings (S, M) of each lane.

        """
        own = base.p[self.remembering]

        def with_known_memory(lane: Lane) -> Lane:
            if np.array_equal(lane.p[self.remembering], own):
                return replace(lane, memory=base.memory)
            return lane

        return self.all([with_known_memory(lane) for lane in lanes])

    def all(self, lanes: Sequence[Lane]) -> list[Array]:
        """Predict the readings of many lanes.

        Args:
            lanes: the simulations.

        Returns:
            Readings (S, M) of each lane.

        """
        alike: dict[tuple[float, bool, bool], list[int]] = {}
        for k, lane in enumerate(lanes):  # the lanes beside one do not change its step
            kind = self._step(lane), lane.impulse is not None, self._remembers(lane)
            alike.setdefault(kind, []).append(k)
        groups = [group for same in alike.values() for group in self._split(same)]
        seen = together(lambda group: self._run([lanes[k] for k in group]), groups)
        found = {
            k: read for group, reads in zip(groups, seen, strict=True) for k, read in zip(group, reads, strict=True)
        }
        return [found[k] for k in range(len(lanes))]

    def _split(self, lanes: list[int]) -> list[list[int]]:
        """Split lanes into groups of about one size that run at once."""
        most = self.width
        if len(lanes) <= FEW:
            most = 1
        return [group.tolist() for group in np.array_split(lanes, -(-len(lanes) // most))]

    def _step(self, lane: Lane) -> float:
        """Return the longest stable step of a lane, s."""
        return min(self.most, self.arm.carried.longest(lane.p))

    def _remembers(self, lane: Lane) -> bool:
        """Tell whether an effect of the lane remembers the motion before the selected windows."""
        return lane.memory is None and bool(lane.p[self.loudness].any())

    def states(self, lane: Lane) -> Array:
        """Simulate one lane.

        Args:
            lane: the simulation.

        Returns:
            Its states (R, nx).

        """
        with self._seat() as seat:
            return self._states(seat, [lane])[0].copy()

    def begun(self, p: Array) -> Array:
        """Read the initial states from the sensors. No spring begins with more torsion than it bears.

        Args:
            p: parameters (np) of the sensors.

        Returns:
            Positions and velocities (W, m) at the windows' starts.

        """
        x = unread(self.arm.at(p), self.record.begun.copy(), range(1, self.arm.n + 1))
        for j, most in zip(self.arm.manifest["flexible"], self.most_twisted, strict=True):
            motor, joint = (self.arm.index(f"{side}_position_{j}") for side in ("motor", "joint"))
            base = x[:, motor] / self.arm.parameters[f"ratio_{j}"]
            x[:, joint] = base - np.clip(base - x[:, joint], -most, most)
        return x[:, : self.m]

    def begin(self) -> tuple[Array, Array]:
        """Return the robot file's parameters (np) and the measured initial states (W, m)."""
        p = self.arm.p.copy()
        return p, self.begun(p)

    @contextmanager
    def _seat(self) -> Iterator[Seat]:
        """Lend working memory that no other thread uses meanwhile."""
        seat = self.seats.get()
        try:
            yield seat
        finally:
            self.seats.put(seat)

    def _run(self, lanes: Sequence[Lane]) -> list[Array]:
        """Predict the readings (S, M) of each lane of a group."""
        with self._seat() as seat:
            return [self._read(lane, x) for lane, x in zip(lanes, self._states(seat, lanes), strict=True)]

    def _states(self, seat: Seat, lanes: Sequence[Lane]) -> list[Array]:
        """Simulate the states (R, nx) of each lane of a group."""
        many, course, memory, jump = len(lanes), self.whole, None, None
        if not self._remembers(lanes[0]):
            course, memory = self.brief, np.stack([self._memory_of(lane) for lane in lanes])
        inputs, states = seat.room(course, many)
        steps = self.steps[course.rows]
        if lanes[0].impulse is not None:
            jump = np.zeros((many, course.many, self.arm.nx))
        for k, lane in enumerate(lanes):
            arm = self._at(lane.p)
            seat.constants[k] = arm.c
            self._drive(arm, lane, course.rows, inputs[k])
            if jump is not None and lane.impulse is not None:
                kicked = np.einsum("tij,tj->ti", self.mobility[course.rows], lane.impulse[course.rows])
                jump[k][:, self.speeds] = kicked
        begun, c = np.stack([lane.begun[course.windows] for lane in lanes]), seat.constants[:many]
        step = self._step(lanes[0])  # the lanes of a group share their step
        x = self.arm.windows(begun, course.edges, inputs, steps, step, self.limit, jump, c, states, memory)
        return [one[course.seen] for one in x]

    def _memory_of(self, lane: Lane) -> Array:
        """Return the effects' own states (K, nx − m) with which a lane's windows begin, 0 if it has none."""
        if lane.memory is None:
            return self.none
        return lane.memory

    def _acted(self, arm: Arm) -> tuple[Array, Array]:
        """Compute the effective inputs of the commands, and the readings of them (T, n each). The last few results are
        kept."""
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
        """Write the effective inputs of a lane into ``inputs`` (rows, nu); the arm has the lane's parameters."""
        n = arm.n
        inputs[:] = _rows(self.record.command, rows)
        inputs[:, :n] = _rows(self._acted(arm)[0], rows)
        if lane.torque is not None:
            inputs[:, :n] += lane.torque[rows] / self.gains

    def _read(self, lane: Lane, x: Array) -> Array:
        """Compute the readings (S, M) of a lane from its states ``x`` (R, nx)."""
        arm = self._at(lane.p)
        if {quantity for quantity, _ in self.record.outputs} <= PROMPT:
            seen = delayed_sensors.positions(arm, self.path, x)
        else:
            inputs = np.empty((len(x), arm.nu))
            self._drive(arm, lane, self.rows, inputs)
            seen = delayed_sensors.read(arm, self.path.time, x, inputs, self.begins)
        acted, told = self._acted(arm)[1], np.empty((len(self.looked), len(self.record.outputs)))
        for k, (quantity, j) in enumerate(self.record.outputs):
            if quantity in DRIVES:
                told[:, k] = acted[:, j - 1].take(self.shown)
            else:
                told[:, k] = seen[quantity][:, j - 1].take(self.looked)
        if not np.isfinite(lane.p).all():
            told[:] = np.nan
        with self.counting:
            self.run += 1
        if not np.isfinite(told).all() or self._stayed(x).any():
            self.fail()
        return told

    def fail(self) -> None:
        """Count a failed simulation, from any thread."""
        with self.counting:
            self.failed += 1

    def _stayed(self, x: Array) -> Mask:
        """Find the windows (K) whose states (R, nx) end constant at a nonzero speed: those diverged."""
        ends = np.append(self.begins[1:], len(x)) - 1
        return np.asarray((x[ends] == x[ends - 1]).all(1) & x[ends][:, self.moving].any(1))

    @cached_property
    def mobility(self) -> Array:
        """Inverse mass matrix (T, n, n) at the measured angles: the response to an impulse on the links."""
        arm, q = self.arm, joint_angles(self.arm, self.record.log)
        return np.asarray(np.linalg.inv(arm.evaluate("mass_matrix", q=q)["M"].reshape(-1, arm.n, arm.n)), float)


def _rows(of: Array, rows: Rows | slice) -> Array:
    """Return ``of[rows]``; whole rows are copied several times as fast this way as by an index."""
    if isinstance(rows, slice):
        return of[rows]
    return of.take(rows, 0)
