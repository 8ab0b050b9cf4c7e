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

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from queue import SimpleQueue
from threading import Lock

import numpy as np

from hdagen.arm import delayed_sensors
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import MOST_MEMORY_DECAYS, Arm
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.diagnosis.data.required_torque import compute_required_torque
from hdagen.diagnosis.data.split import Mask
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.diagnosis.inference.initial_states import InitialStates
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.inference.rollout import PreparedRollout, Rollout, WindowSchedule
from hdagen.diagnosis.inference.rollout_workspace import Workspace
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.prediction.measurement_model import (
    Rows,
    count_mechanical_states,
    find_memory_amplitudes,
    find_parameter_indices,
    get_state_limits,
    read_joint_angles,
)
from hdagen.support.parallel import THREAD_COUNT, map_in_threads

WORKSPACE_BYTES = 2**28  # bytes at most for the lanes of a thread, so that a long log runs fewer at once
DRIVE_QUANTITIES = {"motor_current", "motor_torque"}  # readings that depend on inputs alone
DRIVE_AND_POSITION_QUANTITIES = DRIVE_QUANTITIES | {
    "motor_position",
    "joint_position",
}  # readings that depend on inputs or positions alone


@dataclass(eq=False)
class MultipleShooting:
    """Simulates the lanes of one record on one model; ``rollout_count`` and ``failure_count`` count them. Fits that are
    made with it take no further step when the time of ``budget`` is up."""

    arm: Arm
    record: WindowedRecord
    longest_step: float = 1e-3  # s, a step of integration
    budget: TimeBudget = field(default_factory=TimeBudget)
    workspaces: SimpleQueue[Workspace] = field(init=False)
    rollout_count: int = field(init=False, default=0)  # lanes
    failure_count: int = field(init=False, default=0)  # of them

    def __post_init__(self) -> None:
        record, self.m = self.record, count_mechanical_states(self.arm)
        torque = np.abs(compute_required_torque(self.arm, record).torque)
        load = LIKELIHOOD.torque_margin * np.quantile(torque, LIKELIHOOD.torque_quantile, axis=0)
        self.initial_states = InitialStates(self.arm, record, load)
        # the robot file's own step was checked by the build and is always short enough
        stable = max(self.arm.stability.longest_step_under_load(self.arm, load), self.arm.step_size)
        self.longest_step = min(self.longest_step, stable)
        self.all_windows, self.selected_windows = (
            WindowSchedule.all_windows(record),
            WindowSchedule.selected_windows(record),
        )
        self.steps = record.time_steps
        self.rows = record.rows_of(record.selected_windows)
        self.begins = self.selected_windows.edges[:, 0] - np.arange(len(record.selected_windows))
        self.sampled_states = np.searchsorted(self.rows, record.rows[np.concatenate(record.sampled_rows)])
        self.sampled_rows = self.rows[self.sampled_states]  # sampled rows of the record
        self.command = np.ascontiguousarray(record.command[:, : self.arm.n])
        self.workspaces = SimpleQueue()
        for _ in range(THREAD_COUNT):
            self.workspaces.put(seat := Workspace.allocate(self.arm, record, WORKSPACE_BYTES))
        self.width = len(seat.inputs)
        self.zero_memory = np.zeros((len(record.selected_windows), self.arm.nx - self.m))
        self.path = delayed_sensors.SampledPath(record.time[self.rows], self.begins)
        self.joint_speed_indices = [self.arm.index(f"joint_velocity_{j}") for j in range(1, self.arm.n + 1)]
        self.speed_indices = [k for k, name in enumerate(self.arm.state_names) if "velocity" in name]
        self.state_limits = get_state_limits(self.arm)
        self.gains = compute_torque_per_input(self.arm)
        self.input_cache: dict[bytes, tuple[Array, Array]] = {}
        effects, whole = self.arm.manifest["effects"], ("amplitudes", "shapes")
        self.input_parameters = find_parameter_indices(self.arm, (e for e in effects if e["place"] == "input"), *whole)
        self.memory_parameters = find_parameter_indices(self.arm, (e for e in effects if e["states"]), *whole)
        self.memory_amplitudes = find_memory_amplitudes(self.arm)
        self.counter_lock = Lock()

    def _arm_with(self, p: Array) -> Arm:
        """Return the arm with parameters ``p``. Its slowed states all take the longest step of any lane: otherwise
        lanes of other steps would differ by that, too."""
        if "memory_step" in self.arm.parameters.described:
            p = p.copy()
            p[self.arm.parameters.index("memory_step")] = self.longest_step / MOST_MEMORY_DECAYS
        return self.arm.with_parameters(p)

    def predict(self, lane: Rollout) -> Array:
        """Predict the readings of one lane.

        Args:
            lane: the simulation.

        Returns:
            Readings (S, M) in the channels' units.

        """
        return self.predict_all([lane])[0]

    def predict_with_memory(self, lane: Rollout) -> tuple[Array, Array]:
        """Predict the readings of one lane and keep the memory of its effects.

        Args:
            lane: the simulation.

        Returns:
            Readings (S, M), and the effects' own states (K, nx − m) at which the selected windows begin.

        """
        ready = self._prepare_lane(lane)
        with self._borrow_workspace() as seat:
            x = self._integrate_group(seat, [ready])[0]
            return self._read_channels(ready, x), x[self.begins, self.m :].copy()

    def predict_near(self, base: Rollout, lanes: Sequence[Rollout]) -> list[Array]:
        """Predict the readings of lanes near one whose memory is known. A lane with the same parameters of effects with
        memory begins its windows with that memory. Its other changes affect the memory little, and an initial state or
        a torque should only act in its own window.

        Args:
            base: the lane whose memory is known.
            lanes: the lanes near it.

        Returns:
            Readings (S, M) of each lane.

        """
        own = base.p[self.memory_parameters]

        def with_known_memory(lane: Rollout) -> Rollout:
            if np.array_equal(lane.p[self.memory_parameters], own):
                return replace(lane, memory=base.memory)
            return lane

        return self.predict_all([with_known_memory(lane) for lane in lanes])

    def predict_all(self, lanes: Sequence[Rollout]) -> list[Array]:
        """Predict the readings of many lanes.

        Args:
            lanes: the simulations.

        Returns:
            Readings (S, M) of each lane.

        """
        alike: dict[tuple[float, bool, bool], list[int]] = {}
        for k, lane in enumerate(lanes):  # the lanes beside one do not change its step
            kind = self._integration_step(lane), lane.impulse is not None, self._has_unknown_memory(lane)
            alike.setdefault(kind, []).append(k)
        groups = [group for same in alike.values() for group in self._split_into_groups(same)]
        readings = map_in_threads(lambda group: self._run_group([lanes[k] for k in group]), groups)
        found = {
            k: read for group, reads in zip(groups, readings, strict=True) for k, read in zip(group, reads, strict=True)
        }
        return [found[k] for k in range(len(lanes))]

    def _split_into_groups(self, lanes: list[int]) -> list[list[int]]:
        """Split lanes into groups of about one size that run at once."""
        most = self.width
        if len(lanes) <= LIKELIHOOD.sequential_rollouts:
            most = 1
        return [group.tolist() for group in np.array_split(lanes, -(-len(lanes) // most))]

    def _integration_step(self, lane: Rollout) -> float:
        """Return the longest stable step of a lane, s."""
        return min(self.longest_step, self.arm.stability.longest_step(lane.p))

    def _has_unknown_memory(self, lane: Rollout) -> bool:
        """Tell whether an effect of the lane remembers the motion before the selected windows."""
        return lane.memory is None and bool(lane.p[self.memory_amplitudes].any())

    def simulate_states(self, lane: Rollout) -> Array:
        """Simulate one lane.

        Args:
            lane: the simulation.

        Returns:
            Its states (R, nx).

        """
        with self._borrow_workspace() as seat:
            return self._integrate_group(seat, [self._prepare_lane(lane)])[0].copy()

    def measured_initial_states(self, p: Array) -> Array:
        """Read the initial states from the sensors; a side of a gear that has none is where the robot file's parameters
        place it.

        Args:
            p: parameters (np) of the sensors.

        Returns:
            Positions and velocities (W, m) at the windows' starts.

        """
        return self.initial_states.read(self.arm.with_parameters(p))

    def filtered_initial_states(self, p: Array, windows: Rows | None = None) -> Array:
        """Read the initial states from the sensors; a side of a gear that has none is where the parameters place it.

        Args:
            p: parameters (np) of the whole model.
            windows: places of the windows where they do; elsewhere the robot file's parameters place it. Default: the
                selected windows.

        Returns:
            Positions and velocities (W, m) at the windows' starts.

        """
        if windows is None:
            windows = self.record.selected_windows
        return self.initial_states.filter(self._arm_with(p), windows)

    def nominal_start(self) -> tuple[Array, Array]:
        """Return the robot file's parameters (np) and the measured initial states (W, m)."""
        p = self.arm.p.copy()
        return p, self.measured_initial_states(p)

    @contextmanager
    def _borrow_workspace(self) -> Iterator[Workspace]:
        """Lend working memory that no other thread uses meanwhile."""
        seat = self.workspaces.get()
        try:
            yield seat
        finally:
            self.workspaces.put(seat)

    def _run_group(self, lanes: Sequence[Rollout]) -> list[Array]:
        """Predict the readings (S, M) of each lane of a group."""
        group = [self._prepare_lane(lane) for lane in lanes]
        with self._borrow_workspace() as seat:
            states = self._integrate_group(seat, group)
            return [self._read_channels(one, x) for one, x in zip(group, states, strict=True)]

    def _prepare_lane(self, lane: Rollout) -> PreparedRollout:
        """Prepare the arm and the inputs of a lane."""
        arm = self._arm_with(lane.p)
        return PreparedRollout(lane, arm, *self._effective_inputs(arm))

    def _integrate_group(self, seat: Workspace, group: Sequence[PreparedRollout]) -> list[Array]:
        """Simulate the states (R, nx) of each lane of a group."""
        lanes = [one.lane for one in group]
        many, course, memory, jump = len(lanes), self.all_windows, None, None
        if not self._has_unknown_memory(lanes[0]):
            course, memory = self.selected_windows, np.stack([self._memory_of(lane) for lane in lanes])
        inputs, states = seat.buffers_for(course, many)
        steps = self.steps[course.rows]
        if lanes[0].impulse is not None:
            jump = np.zeros((many, course.row_count, self.arm.nx))
        for k, (one, lane) in enumerate(zip(group, lanes, strict=True)):
            seat.constants[k] = one.arm.c
            self._fill_inputs(one, course.rows, inputs[k])
            if jump is not None and lane.impulse is not None:
                kicked = np.einsum("tij,tj->ti", self.inverse_mass_matrix[course.rows], lane.impulse[course.rows])
                jump[k][:, self.joint_speed_indices] = kicked
        begun, c = np.stack([lane.initial_states[course.windows] for lane in lanes]), seat.constants[:many]
        step = self._integration_step(lanes[0])  # the lanes of a group share their step
        x = self.arm.rollout_windows(
            begun, course.edges, inputs, steps, step, self.state_limits, jump, c, states, memory
        )
        return [one[course.selected_states] for one in x]

    def _memory_of(self, lane: Rollout) -> Array:
        """Return the effects' own states (K, nx − m) with which a lane's windows begin, 0 if it has none."""
        if lane.memory is None:
            return self.zero_memory
        return lane.memory

    def _effective_inputs(self, arm: Arm) -> tuple[Array, Array]:
        """Compute the effective inputs of the commands, and the readings of them (T, n each). The last few results are
        kept."""
        key = arm.p[self.input_parameters].tobytes()
        found = self.input_cache.get(key)  # threads share it
        if found is None:
            found = arm.apply_input_stage(self.command, self.steps, self.record.initial_input)
            measured = [j - 1 for j in self.record.joints_without_command]
            found[0][:, measured] = self.command[:, measured]
            if len(self.input_cache) >= LIKELIHOOD.most_cached_inputs:
                self.input_cache.clear()
            self.input_cache[key] = found
        return found

    def _fill_inputs(self, ready: PreparedRollout, rows: Rows | slice, inputs: Array) -> None:
        """Write the effective inputs of a lane into ``inputs`` (rows, nu)."""
        n = self.arm.n
        inputs[:] = _take_rows(self.record.command, rows)
        inputs[:, :n] = _take_rows(ready.inputs, rows)
        if ready.lane.torque is not None:
            inputs[:, :n] += ready.lane.torque[rows] / self.gains

    def _read_channels(self, ready: PreparedRollout, x: Array) -> Array:
        """Compute the readings (S, M) of a lane from its states ``x`` (R, nx)."""
        lane, arm = ready.lane, ready.arm
        if {quantity for quantity, _ in self.record.outputs} <= DRIVE_AND_POSITION_QUANTITIES:
            readings = delayed_sensors.read_positions(arm, self.path, x)
        else:
            inputs = np.empty((len(x), arm.nu))
            self._fill_inputs(ready, self.rows, inputs)
            readings = delayed_sensors.read_sensors(arm, self.path.time, x, inputs, self.begins)
        acted, samples = ready.input_readings, np.empty((len(self.sampled_states), len(self.record.outputs)))
        for k, (quantity, j) in enumerate(self.record.outputs):
            if quantity in DRIVE_QUANTITIES:
                samples[:, k] = acted[:, j - 1].take(self.sampled_rows)
            else:
                samples[:, k] = readings[quantity][:, j - 1].take(self.sampled_states)
        if not np.isfinite(lane.p).all():
            samples[:] = np.nan
        with self.counter_lock:
            self.rollout_count += 1
        if not np.isfinite(samples).all() or self._has_diverged(x).any():
            self.count_failure()
        return samples

    def count_failure(self) -> None:
        """Count a failed simulation, from any thread."""
        with self.counter_lock:
            self.failure_count += 1

    def _has_diverged(self, x: Array) -> Mask:
        """Find the windows (K) whose states (R, nx) end constant at a nonzero speed: those diverged."""
        ends = np.append(self.begins[1:], len(x)) - 1
        return np.asarray((x[ends] == x[ends - 1]).all(1) & x[ends][:, self.speed_indices].any(1))

    @cached_property
    def inverse_mass_matrix(self) -> Array:
        """Inverse mass matrix (T, n, n) at the measured angles: the response to an impulse on the links."""
        arm, q = self.arm, read_joint_angles(self.arm, self.record.log)
        return np.asarray(np.linalg.inv(arm.evaluate("mass_matrix", q=q)["M"].reshape(-1, arm.n, arm.n)), float)


def _take_rows(of: Array, rows: Rows | slice) -> Array:
    """Return ``of[rows]``; whole rows are copied several times as fast this way as by an index."""
    if isinstance(rows, slice):
        return of[rows]
    return of.take(rows, 0)
