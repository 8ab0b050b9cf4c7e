"""A log as the fit uses it: inputs, measured channels with their noise, and windows with an initial state each.

Of a long or dense log the fit uses only some windows and some of their rows, which bounds time and memory. The other
windows are simulated only where an effect has a memory of its own.

Legend: T rows, R rows in windows, W windows, K selected windows, S sampled rows in them, M channels; m positions and
velocities of the state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.data_quality.log_repair import split_at_long_gaps
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.split import LogPortion, Mask
from hdagen.log.channel_statistics import compute_channel_statistics
from hdagen.log.column_map import is_command_channel, name_command_channel
from hdagen.log.measured_log import Log
from hdagen.prediction.channel_noise import compute_channel_noise, compute_channel_timing_noise, measure_shown_noise
from hdagen.prediction.driving_inputs import find_driving_channel, read_driving_inputs
from hdagen.prediction.input_interpolation import judge_interpolation
from hdagen.prediction.measurement_model import Readings, Rows, complete_state, count_mechanical_states
from hdagen.prediction.window_replay import find_window_starts

CHANNEL_QUANTITIES = ("motor_current", "motor_torque", "motor_position", "joint_position", "joint_torque")


@dataclass(frozen=True, eq=False)
class WindowedRecord:
    """A log cut into windows.

    ``shown`` (T): rows that the fit may use. ``command`` (T, nu): held from row k to row k + 1; ``before`` (n): the
    input before row 0. ``measured`` (T, M) with standard deviations ``noise`` (M); windows run from rows ``starts`` (W)
    to ``ends`` (W) and begin in the measured states ``initial_states`` (W, nx). ``clock_noise`` (T, M): noise of each
    value that the log's clock causes; ``noise`` contains its mean. ``input_noise`` (n): standard deviation, N m at the
    motor, of a measured input from one row to the next; 0 for a command.
    """

    log: Log
    visible_rows: Mask
    time: Array
    command: Array
    initial_input: Array
    names: tuple[str, ...]
    outputs: tuple[tuple[str, int], ...]
    measured: Array
    noise: Array
    starts: Rows
    ends: Rows
    initial_states: Array
    clock_noise: Array
    input_noise: Array

    @cached_property
    def rows(self) -> Rows:
        """Rows that lie in windows (R), window by window."""
        return self.rows_of(np.arange(len(self.starts)))

    def rows_of(self, windows: Rows) -> Rows:
        """List the rows of some windows, window by window.

        Args:
            windows: places of the windows.

        Returns:
            Rows of the log.

        """
        return np.concatenate([np.arange(self.starts[w], self.ends[w]) for w in windows])

    @cached_property
    def selected_windows(self) -> Rows:
        """Selected windows (K), spread evenly over those whose rows the fit may all use."""
        whole = [bool(self.visible_rows[a:b].all()) for a, b in zip(self.starts, self.ends, strict=True)]
        may = np.flatnonzero(whole)
        wanted = round(DATA.selected_rows / float(np.mean(self.ends - self.starts)))
        count = min(max(wanted, DATA.fewest_selected_windows), DATA.most_selected_windows, len(may))
        return may[np.unique(np.linspace(0, len(may) - 1, count).round().astype(int))]

    @cached_property
    def sampled_rows(self) -> list[Rows]:
        """Sampled rows of each selected window, as places in ``rows``."""
        begins = np.concatenate([[0], np.cumsum(self.ends - self.starts)])
        values = int((self.ends - self.starts)[self.selected_windows].sum()) * len(self.names)
        stride = max(1, math.ceil(values / DATA.most_sampled_values))
        return [np.arange(begins[w], begins[w + 1], stride) for w in self.selected_windows]

    @cached_property
    def samples(self) -> Array:
        """Measured values of the sampled rows (S, M)."""
        return self.measured[self.rows[np.concatenate(self.sampled_rows)]]

    def subtract_prediction(self, seen: Array) -> Array:
        """Subtract predicted readings from the measured ones, limited to each channel's range. A simulation that
        diverges or yields no number counts as wrong by the whole range.

        Args:
            seen: predicted readings (…, S, M), in the channels' units.

        Returns:
            The differences, of the same shape.

        """
        return np.asarray(
            np.clip(
                np.where(np.isfinite(seen), self.samples - seen, self.channel_ranges),
                -self.channel_ranges,
                self.channel_ranges,
            )
        )

    @cached_property
    def channel_ranges(self) -> Array:
        """Range of each channel (M)."""
        return np.asarray(np.ptp(self.samples, axis=0))

    @cached_property
    def sample_noise(self) -> Array:
        """Standard deviation of each sampled value (S, M). A channel that repeats a value in a window counts it once;
        the part that the clock causes follows the speed."""
        repetitions = []
        for rows in self.sampled_rows:
            values = self.measured[self.rows[rows]]
            repetitions.append(
                np.broadcast_to(np.sqrt(len(rows) / (1 + (np.diff(values, axis=0) != 0).sum(0))), values.shape)
            )
        if not self.log.time_uncertainty:
            return np.concatenate(repetitions) * self.noise
        rows = self.rows[np.concatenate(self.sampled_rows)]
        moved = self.clock_noise[rows]
        sensor = np.sqrt(np.maximum(self.noise**2 - np.mean(self.clock_noise[self.visible_rows] ** 2, axis=0), 0.0))
        return np.hypot(np.concatenate(repetitions) * sensor, moved)

    @cached_property
    def joints_without_command(self) -> tuple[int, ...]:
        """Joints whose commands are not logged, so that their measured inputs drive the model."""
        joints = range(1, self.log.n_joints + 1)
        return tuple(j for j in joints if not is_command_channel(find_driving_channel(self.log, j, "command") or ""))

    @property
    def window_edges(self) -> Rows:
        """First row and end of each window (W, 2)."""
        return np.stack([self.starts, self.ends], 1).astype(np.int32)

    @property
    def time_steps(self) -> Array:
        """Time from each row to the next (T), s; the last one repeats the one before."""
        dt = np.diff(self.time)
        return np.append(dt, dt[-1])


def cut_windows(arm: Arm, seen: LogPortion, window: float) -> WindowedRecord:
    """Cut the fitted portion of a log into windows.

    Args:
        arm: the compiled model.
        seen: rows that the fit may use.
        window: length of a window, s.

    Returns:
        The record.

    Raises:
        LogError: the log lacks an input or a position.

    """
    log = seen.log
    command, _ = read_driving_inputs(arm, log, "command")
    names, outputs = [], []
    driven = {name for name in arm.input_names[: arm.n] if name in log and name_command_channel(name) in log}
    for j in range(1, arm.n + 1):
        for quantity in CHANNEL_QUANTITIES:
            name = f"{quantity}_{j}"
            if name in log and (quantity not in ("motor_current", "motor_torque") or name in driven):
                names.append(name)
                outputs.append((quantity, j))
    measured = np.stack([log[name] for name in names], 1)
    noise = np.array(
        [_measure_noise(arm, seen, name, name in driven) or measure_shown_noise(log, name, seen.rows) for name in names]
    )
    starts = np.union1d(find_window_starts(log.time, window), [first for first, _ in split_at_long_gaps(log.time)])
    ends = np.append(starts[1:], len(log))
    period = log.period
    whole = ends - starts >= DATA.shortest_last_window * window / period  # windows that are long enough
    starts, ends = starts[whole], ends[whole]
    before = command[0, : arm.n].copy()
    for j, name in enumerate(arm.input_names[: arm.n]):
        if name in log:
            before[j] = log[name][0]
    return WindowedRecord(
        log,
        seen.rows,
        log.time,
        command,
        before,
        tuple(names),
        tuple(outputs),
        measured,
        noise,
        starts,
        ends,
        _estimate_initial_states(arm, log, starts),
        np.stack([compute_channel_timing_noise(arm, log, name) for name in names], 1),
        _input_noise(arm, log),
    )


def _measure_noise(arm: Arm, seen: LogPortion, name: str, driven: bool) -> float:
    """Estimate the noise of a channel; ``driven``: a torque that is logged beside its own command."""
    if "torque" not in name:
        return compute_channel_noise(arm, seen.log, name, seen.rows)
    if driven:
        return _measure_following_noise(seen.log, name, seen.rows)
    return compute_channel_statistics(name, seen.log[name][seen.rows]).noise


def _input_noise(arm: Arm, log: Log) -> Array:
    """Estimate the uncertainty of each joint's measured input (n), N m at the motor: sensor noise, and changes between
    rows."""
    found, gains = np.zeros(arm.n), compute_torque_per_input(arm)
    for j in range(1, arm.n + 1):
        name = find_driving_channel(log, j, "command")
        if name is not None and not is_command_channel(name):
            uncertainty = judge_interpolation(arm, log, j, log[name]).uncertainty
            if "torque" not in name:
                uncertainty = gains[j - 1] * uncertainty
            found[j - 1] = uncertainty
    return found


def _measure_following_noise(log: Log, name: str, shown: Mask) -> float:
    """Estimate the noise of a measured torque that follows its command: the residual of the best filter of the command.
    It holds the sensor's noise and the error of the torque loop, which no data sheet states and which is much
    larger."""
    command = log[name_command_channel(name)]
    # with more the fit would take the noise, too
    most = max(int(shown.sum()) // CHANNEL_CHECK.least_rows_per_term - 2, 0)
    lags = np.arange(min(max(round(DATA.following_time / log.period), 1), most) + 1)
    past = np.stack([np.append(np.full(k, command[0]), command[: len(command) - k]) for k in lags], 1)
    A = np.column_stack([past, np.ones(len(command))])[shown]
    coefficients, _, rank, _ = np.linalg.lstsq(A, log[name][shown], rcond=None)
    left = log[name][shown] - A @ coefficients
    spread = float(np.sqrt(left @ left / max(len(left) - rank, 1)))
    return max(spread, compute_channel_statistics(name, log[name][shown]).noise)


def measure_usual_torque(arm: Arm, record: WindowedRecord) -> Array:
    """Measure the usual size of each motor's commanded torque.

    Args:
        arm: the compiled model.
        record: the log in windows.

    Returns:
        Root mean square (n), N m.

    """
    size = [float(np.sqrt(np.mean(record.command[:, j] ** 2))) for j in range(arm.n)]
    return np.asarray(size * compute_torque_per_input(arm))


def _estimate_initial_states(arm: Arm, log: Log, starts: Rows) -> Array:
    """Estimate the state (W, nx) at each window's start by a parabola through the rows about it."""
    readings = Readings.from_log(arm, log)
    x = np.zeros((len(starts), arm.nx))
    known: set[int] = set()
    reach, parts = max(3, round(DATA.initial_state_reach / log.period)), np.array(split_at_long_gaps(log.time))
    within = parts[np.searchsorted(parts[:, 0], starts, side="right") - 1]  # no parabola reaches over a gap
    for k, place in enumerate(readings.state_indices):
        name = arm.state_names[place]
        if "position" not in name:
            continue
        rate = arm.index(name.replace("position", "velocity"))
        for w, (row, (first, end)) in enumerate(zip(starts, within, strict=True)):
            span = slice(max(first, row - reach), min(end, row + reach + 1))
            t = log.time[span] - log.time[row]
            fit = np.polyfit(t, readings.measured[span, k] / readings.factors[k], 2)
            x[w, place], x[w, rate] = fit[2], fit[1]
        known |= {place, rate}
    x[:, : count_mechanical_states(arm)] = complete_state(arm, x, known)[:, : count_mechanical_states(arm)]
    if starts[0] == 0:  # a log that starts this slowly starts at rest
        for k, name in enumerate(arm.state_names[: count_mechanical_states(arm)]):
            if "velocity" in name and abs(x[0, k]) < 1e-2 * arm.manifest["state"][k]["bound"]:
                x[0, k] = 0.0
    return x
