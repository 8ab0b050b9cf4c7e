"""Replay: a log simulated again, window after window, from its commands and the forces on its tip.

Each window starts at the state that the measurements up to its first row give (`hdagen.prediction.kalman_filter`);
inside a window no measurement counts. Row k's command is held to row k + 1; friction sticks exactly; the effects' own
states go on from window to window.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdagen.adoption import verdict
from hdagen.arm import delayed_sensors
from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import get_torque_constant
from hdagen.log.data_table import LogError, stream_columns
from hdagen.log.measured_log import Log, split_at_pauses
from hdagen.prediction.channel_noise import compute_channel_noise
from hdagen.prediction.driving_inputs import compute_effective_inputs, find_driving_channel, read_driving_inputs
from hdagen.prediction.kalman_filter import estimate_states
from hdagen.prediction.measurement_model import (
    Readings,
    Rows,
    are_within_limits,
    count_mechanical_states,
    find_memory_amplitudes,
)

REPLAY_WINDOW = 0.25  # s, the length of a window
LEAST_ERROR_MULTIPLE = 1e-3  # multiples of the noise that an error counts as at least
_WINDOW_ROUNDING = 1e-9  # share of a window: a row that lies a rounding error before a boundary starts the next one
_FIRST_ROWS_TIME = 0.01  # s of rows that show whether a log begins in motion
_LEAST_MOTION_FACTOR = 4.0  # times noise and curvature that the first speed moves a joint by then at least
_LEAST_MOTION_SHARE = 0.03  # share of the usual motion in as many rows, below which a joint is at rest


@dataclass(frozen=True, eq=False)
class Replay:
    """A log as the model would have written it.

    Attributes:
        columns: (T,) each: time and, by joint, motor_current (A; motor_torque, N m, where the log has torque),
            motor_position (rad at the rotor) and joint_position (rad or m).
        states: (T, nx), as the arm names them.
        errors: Root mean square of prediction less measurement, by channel, in its unit.
        noise: Standard deviation of each channel's noise.
        relative: Each error as a share of the measurement's own root mean square.
        starts: The first rows of the windows.
        beyond_law: The number of rows in which a torsion lay beyond the spring law.
        notes: Sentences that a reader must know.
        guessed: The first rows of the windows that begin at rest though the log is in motion there.
        inputs: The measured channels that drove the model, in which it cannot err.

    """

    columns: dict[str, Array]
    states: Array
    errors: dict[str, float]
    noise: dict[str, float]
    relative: dict[str, float]
    starts: Rows
    beyond_law: int
    notes: tuple[str, ...]
    guessed_starts: tuple[int, ...] = ()
    driving_channels: tuple[str, ...] = ()

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """The predicted columns by Arrow's C interface, as `pyarrow.table` and `polars.DataFrame` ask for it."""
        return stream_columns(self.columns, requested_schema)

    @property
    def counted_channels(self) -> list[str]:
        """The channels that a gap is counted over: those that the model can err in and whose noise is known."""
        return [name for name in self.errors if name not in self.driving_channels and self.noise.get(name)]

    @property
    def gap(self) -> float:
        """The gap of the errors, as `combine_channel_errors` computes it; NaN where no channel counts."""
        if not self.counted_channels:
            return math.nan
        return float(
            combine_channel_errors(np.array([self.errors[name] / self.noise[name] for name in self.counted_channels]))
        )

    def restrict_to_rows(self, log: Log, rows: NDArray[np.bool_], noise: Mapping[str, float]) -> Replay:
        """Compute the errors over some rows alone, in a noise that is given.

        Args:
            log: The log that was replayed.
            rows: (T), the rows that count.
            noise: Standard deviations of the channels that count, by name.

        Returns:
            The same replay with these errors.

        Raises:
            LogError: One of the channels is not logged.

        """
        if lacking := [name for name in noise if name not in self.errors]:
            raise LogError([f"{log.source}: {', '.join(lacking)} is counted and not logged; take the same log."])
        errors = {name: _compute_rms((self.columns[name] - log[name])[rows]) for name in noise}
        size = {name: _compute_rms(log[name][rows]) for name in noise}
        relative = {name: errors[name] / size[name] for name in errors if size[name]}
        return replace(self, errors=errors, noise=dict(noise), relative=relative)


def combine_channel_errors(multiples: Array) -> Array:
    """Compute the gap: the geometric mean of the channels' errors in multiples of their noise.

    Args:
        multiples: (…, channels), root mean square errors over the noise of each channel.

    Returns:
        (…), the gap.

    """
    return np.asarray(np.exp(np.log(np.maximum(multiples, LEAST_ERROR_MULTIPLE)).mean(-1)))


def replay(
    arm: Arm,
    log: Log,
    window: float = REPLAY_WINDOW,
    input: str = "command",
    with_: verdict.Verdict | str | Path | Mapping[str, Any] | None = None,
) -> Replay:
    """Replay a log on an arm, window after window.

    Args:
        arm: The arm.
        log: The log.
        window: The length of a window, s; inf: the whole log.
        input: "command" or "measured", the current or torque that drives the model.
        with_: A diagnosis.json, its content, or its verdict; effects and parameters are set in a copy of the arm.

    Returns:
        The replay.

    Raises:
        LogError: The log does not fit the arm.
        PlantError: The window, the input or the verdict cannot be used.

    """
    notes: list[str] = []
    if with_ is not None:
        arm, said = verdict.apply_verdict(
            arm, with_ if isinstance(with_, verdict.Verdict) else verdict.read_verdict(with_)
        )
        notes += said
    check_log_fits_arm(arm, log)
    inputs, said = read_driving_inputs(arm, log, input)
    notes += said
    begins: list[Rows] = []
    states: list[Array] = []
    shown: list[Array] = []
    guessed: list[int] = []
    for first, end in split_at_pauses(log.time, window):  # over a pause that is longer than a window nothing carries on
        part = log.rows(first, end)
        acting, at = compute_effective_inputs(arm, part, inputs[first:end], input)
        own = find_window_starts(part.time, window)
        readings = Readings.from_log(arm, part)
        x, said = _predict_windows(arm, part, readings, acting, own)
        if moving := _describe_initial_motion(part, readings):
            guessed.append(first)
            said.append(f"{moving}: the first window starts at rest.")
        notes += said
        begins.append(first + own)
        states.append(x)
        shown.append(at)
    found = compare_with_log(arm, log, np.concatenate(states), np.concatenate(shown), np.concatenate(begins), notes)
    driving = (find_driving_channel(log, j, input) for j in range(1, arm.n + 1))
    return replace(
        found, guessed_starts=tuple(guessed), driving_channels=tuple(name for name in driving if name in found.errors)
    )


def check_log_fits_arm(arm: Arm, log: Log) -> None:
    """Check that a log has the arm's joints, each with a position.

    Args:
        arm: The arm.
        log: The log.

    Raises:
        LogError: The log does not fit the arm.

    """
    problems = []
    if log.n_joints != arm.n:
        problems.append(
            f"{log.source}: the log has {log.n_joints} joint(s), the robot {arm.n}: "
            "take the robot's own log, or a columns.toml."
        )
    else:
        problems += [
            f"{log.source}: joint {j} has no position; log motor_position_{j} or joint_position_{j}."
            for j in range(1, arm.n + 1)
            if f"motor_position_{j}" not in log and f"joint_position_{j}" not in log
        ]
    if len(log) < 2:
        problems.append(f"{log.source}: {len(log)} row(s); a replay needs at least two.")
    if problems:
        raise LogError(problems)


def find_window_starts(time: Array, window: float) -> Rows:
    """Find the first rows of the windows: the first row at or after each multiple of the window's length.

    Args:
        time: (T), s.
        window: The length of a window, s; inf: the whole log.

    Returns:
        The rows, increasing, the first one 0.

    Raises:
        PlantError: The length is not positive.

    """
    if not (window > 0 and (math.isinf(window) or math.isfinite(window))):
        raise PlantError(
            f"the window must be longer than 0 s, not {window:g}: 0.25 is usual, inf takes the log as one."
        )
    number = np.floor((time - time[0]) / window + _WINDOW_ROUNDING)
    return np.flatnonzero(np.diff(number, prepend=-1.0))


def _predict_windows(arm: Arm, log: Log, readings: Readings, inputs: Array, starts: Rows) -> tuple[Array, list[str]]:
    """The states (T, nx) of all windows, and notes."""
    m = count_mechanical_states(arm)
    begun = np.stack([readings.state_at(arm, int(row)) for row in starts])
    if readings.measures_full_state(arm):
        states, stopped = _roll_out_windows(arm, log, inputs, starts, begun, carry=True)
        return states, ["Windows start at the logged positions and velocities.", *_note_stopped_windows(stopped)]
    notes, states, stopped = list[str](), np.zeros((len(log), arm.nx)), 0
    lost, rounds = np.zeros(len(starts), bool), 1
    if arm.p[
        find_memory_amplitudes(arm)
    ].any():  # the effects' own states, from windows that begin at the measured positions
        states, _ = _roll_out_windows(arm, log, inputs, starts, begun, carry=True)
        rounds = 2  # the second time the filters begin with the effects' states of the first
    for _ in range(rounds):
        if len(starts) > 1:
            found = estimate_states(arm, log, readings, inputs, starts[1:], states[:, m:])
            lost[1:] = np.isnan(found).any(1)
            begun[1:] = np.where(lost[1:, None], begun[1:], found)
        states, stopped = _roll_out_windows(arm, log, inputs, starts, begun)
    if lost.any():
        notes.append(f"{lost.sum()} window(s) start at rest where they were measured: no estimate stayed finite.")
    return states, [*notes, *_note_stopped_windows(stopped)]


def _roll_out_windows(
    arm: Arm, log: Log, inputs: Array, starts: Rows, begun: Array, carry: bool = False
) -> tuple[Array, int]:
    """The states (T, nx) of windows that begin at ``begun`` (W, nx), and in how many the model left its bounds;
    ``carry`` lets the effects' states of a window begin as the one before ended."""
    states, stopped, m = np.empty((len(log), arm.nx)), 0, count_mechanical_states(arm)
    ends = np.append(starts[1:], len(log))
    path = begun[:1]
    for x, first, end in zip(begun, starts, ends, strict=True):
        if carry:
            x[m:] = path[-1, m:]
        dt = np.diff(log.time[first : end + 1])
        path = x[None]
        if len(dt):
            path = arm.rollout(x, inputs[first : first + len(dt)], dt, exact=True)
        good = are_within_limits(arm, path)
        if not good.all():
            last = max(int(np.argmin(good)) - 1, 0)
            path[last + 1 :], stopped = path[last], stopped + 1
        states[first:end] = path[: end - first]
    return states, stopped


def _note_stopped_windows(windows: int) -> list[str]:
    if not windows:
        return []
    return [f"In {windows} window(s) the model left all bounds and is held where it did: robot file or input is wrong."]


def _describe_initial_motion(log: Log, readings: Readings) -> str | None:
    """Say where the log begins in motion and no velocity is logged; None where it does not."""
    rows = max(8, int(np.searchsorted(log.time, log.time[0] + _FIRST_ROWS_TIME)))
    if len(log) < rows:
        return None
    t = log.time[:rows] - log.time[0]
    powers = np.vander(t, 3, increasing=True)
    moving = []
    for k, name in enumerate(readings.names):
        quantity, _, j = name.rpartition("_")
        if not quantity.endswith("position") or any(f"{side}_velocity_{j}" in log for side in ("motor", "joint")):
            continue
        channel = readings.measured[:, k]
        (_, speed, bend), *_ = np.linalg.lstsq(powers, channel[:rows] - channel[0], rcond=None)
        usual = _compute_rms(channel[rows - 1 :] - channel[: len(channel) - rows + 1])
        least = max(abs(bend) * t[-1] ** 2, readings.noise_before(rows)[k], _LEAST_MOTION_SHARE * usual)
        if abs(speed) * t[-1] > _LEAST_MOTION_FACTOR * least:
            moving.append(f"{name} at {speed:.3g} a second")
    if not moving:
        return None
    return f"The log begins in motion ({', '.join(moving)}) and no velocity is logged"


def compare_with_log(arm: Arm, log: Log, states: Array, shown: Array, starts: Rows, notes: list[str]) -> Replay:
    """Compare simulated states with a log.

    Args:
        arm: The arm.
        log: The log.
        states: (T, nx), the states.
        shown: (T, nu), the inputs that each row shows.
        starts: The first rows of the windows.
        notes: Sentences that a reader must know.

    Returns:
        The replay, with its errors.

    """
    seen = delayed_sensors.read_sensors(arm, log.time, states, shown)
    columns = {"time": log.logged_time}
    for j in range(1, arm.n + 1):
        columns |= _make_input_column(arm, log, j, shown[:, j - 1])
        columns[f"motor_position_{j}"] = np.ascontiguousarray(seen["motor_position"][:, j - 1])
        columns[f"joint_position_{j}"] = np.ascontiguousarray(seen["joint_position"][:, j - 1])
    measured = {name: log[name] for name in columns if name in log.columns}
    errors = {name: _compute_rms(columns[name] - values) for name, values in measured.items()}
    size = {name: _compute_rms(values) for name, values in measured.items()}
    beyond = int(np.count_nonzero(seen["beyond_law"].any(1)))
    if beyond:
        notes.append(f"In {beyond} row(s) a torsion lies beyond the spring law, which goes on along its tangent there.")
    return Replay(
        columns=columns,
        states=states,
        errors=errors,
        noise={name: compute_channel_noise(arm, log, name) for name in measured},
        relative={name: errors[name] / size[name] for name in errors if size[name]},
        starts=starts,
        beyond_law=beyond,
        notes=tuple(dict.fromkeys(notes)),
    )


def _make_input_column(arm: Arm, log: Log, j: int, values: Array) -> dict[str, Array]:
    """The current or torque of joint j, whichever the log has."""
    own = arm.input_names[j - 1]
    if own.startswith("motor_torque") or f"motor_current_{j}" in log or f"motor_current_command_{j}" in log:
        return {own: values.copy()}
    return {f"motor_torque_{j}": values * get_torque_constant(arm, j)}


def _compute_rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
