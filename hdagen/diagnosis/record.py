"""A log as the fit sees it: inputs, measured channels with their noise, and windows that each begin anew.

Of a long or dense log the fit looks at a share of the windows and of their rows, which bounds time and memory; the
others are simulated too where an effect remembers.

Legend: T rows, R rows in windows, W windows, K windows and S rows that are looked at, M channels; m positions and
velocities of the state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdagen.between_rows import between_rows
from hdagen.channel_noise import channel_noise, instants_noise
from hdagen.channels import describe
from hdagen.columns import commanded
from hdagen.determined import ROWS
from hdagen.diagnosis.portion import Mask, Portion
from hdagen.driving_inputs import driven_by, driving_channel, is_command
from hdagen.log import Log
from hdagen.plant import Arm, Array
from hdagen.readings import Readings, Rows, complete, mechanical
from hdagen.repair import segments
from hdagen.replay import window_starts
from hdagen.torques import torque_per_input

QUANTITIES = ("motor_current", "motor_torque", "motor_position", "joint_position", "joint_torque")
REACH = 0.01  # s to each side of a window's first row from which its state is read
MOST_WINDOWS = 96  # that are looked at
MOST_VALUES = 18_000  # rows by channels that are looked at
FOLLOWED = 0.05  # s of commands that a measured torque may go with
SHORTEST = 0.5  # share of the window that a shorter last one must have


@dataclass(frozen=True, eq=False)
class Record:
    """``shown`` (T): rows that the fit may look at. ``command`` (T, nu): row k is held to row k + 1. ``measured``
    (T, M) with ``noise`` (M) standard deviations; windows are the rows from ``starts`` (W) to ``ends`` (W); ``begun``
    (W, nx) their first states as measured; ``clock`` (T, M) what the log's clock leaves uncertain of each value, whose
    mean ``noise`` has within; ``input_noise`` (n) standard deviation, N m at the motor, of what acts from a row to the
    next where it was measured; 0 where it was commanded."""

    log: Log
    shown: Mask
    time: Array
    command: Array
    before: Array
    names: tuple[str, ...]
    outputs: tuple[tuple[str, int], ...]
    measured: Array
    noise: Array
    starts: Rows
    ends: Rows
    begun: Array
    clock: Array
    input_noise: Array

    @cached_property
    def rows(self) -> Rows:
        """The rows that lie in windows, window after window."""
        return self.rows_of(np.arange(len(self.starts)))

    def rows_of(self, windows: Rows) -> Rows:
        """The rows of some windows, window after window."""
        return np.concatenate([np.arange(self.starts[w], self.ends[w]) for w in windows])

    @cached_property
    def kept(self) -> Rows:
        """The windows that are looked at (K), evenly over those that may be."""
        whole = [bool(self.shown[a:b].all()) for a, b in zip(self.starts, self.ends, strict=True)]
        may = np.flatnonzero(whole)
        return may[np.unique(np.linspace(0, len(may) - 1, min(len(may), MOST_WINDOWS)).round().astype(int))]

    @cached_property
    def looked(self) -> list[Rows]:
        """The rows of each window that is looked at, as places in ``rows``."""
        begins = np.concatenate([[0], np.cumsum(self.ends - self.starts)])
        values = int((self.ends - self.starts)[self.kept].sum()) * len(self.names)
        stride = max(1, math.ceil(values / MOST_VALUES))
        return [np.arange(begins[w], begins[w + 1], stride) for w in self.kept]

    @cached_property
    def told(self) -> Array:
        """What was measured in the rows that are looked at (S, M)."""
        return self.measured[self.rows[np.concatenate(self.looked)]]

    def missed(self, seen: Array) -> Array:
        """What was measured less what a model has the channels read, ``seen`` (…, S, M); no larger than the channel's
        range: one that flies apart, or gives no number, is as wrong as one can be."""
        return np.asarray(np.clip(np.where(np.isfinite(seen), self.told - seen, self.span), -self.span, self.span))

    @cached_property
    def span(self) -> Array:
        """Range of each channel (M)."""
        return np.asarray(np.ptp(self.told, axis=0))

    @cached_property
    def spread(self) -> Array:
        """Standard deviation of each value that is looked at (S, M): as often as a channel repeats a value in a window,
        it tells it once; and what the clock leaves uncertain goes with the speed there."""
        told = []
        for rows in self.looked:
            seen = self.measured[self.rows[rows]]
            told.append(np.broadcast_to(np.sqrt(len(rows) / (1 + (np.diff(seen, axis=0) != 0).sum(0))), seen.shape))
        if not self.log.time_uncertainty:
            return np.concatenate(told) * self.noise
        rows = self.rows[np.concatenate(self.looked)]
        moved = self.clock[rows]
        sensor = np.sqrt(np.maximum(self.noise**2 - np.mean(self.clock[self.shown] ** 2, axis=0), 0.0))
        return np.hypot(np.concatenate(told) * sensor, moved)

    @cached_property
    def uncommanded(self) -> tuple[int, ...]:
        """The joints whose commands are not logged: what was measured of their inputs is what acted."""
        joints = range(1, self.log.n_joints + 1)
        return tuple(j for j in joints if not is_command(driving_channel(self.log, j, "command") or ""))

    @property
    def edges(self) -> Rows:
        """First row and end of each window (W, 2)."""
        return np.stack([self.starts, self.ends], 1).astype(np.int32)

    @property
    def steps(self) -> Array:
        """Time from each row to the next (T), s; the last as the one before."""
        dt = np.diff(self.time)
        return np.append(dt, dt[-1])


def record(arm: Arm, seen: Portion, window: float) -> Record:
    """The record of what is seen of a log for ``arm`` in windows of ``window`` s. Raises LogError."""
    log = seen.log
    command, _ = driven_by(arm, log, "command")
    names, outputs = [], []
    driven = {name for name in arm.input_names[: arm.n] if name in log and commanded(name) in log}
    for j in range(1, arm.n + 1):
        for quantity in QUANTITIES:
            name = f"{quantity}_{j}"
            if name in log and (quantity not in ("motor_current", "motor_torque") or name in driven):
                names.append(name)
                outputs.append((quantity, j))
    measured = np.stack([log[name] for name in names], 1)
    noise = np.array(
        [
            channel_noise(arm, log, name, seen.rows)
            if "torque" not in name
            else _followed(log, name, seen.rows)
            if name in driven
            else describe(name, log[name][seen.rows]).noise
            for name in names
        ]
    )
    starts = np.union1d(window_starts(log.time, window), [first for first, _ in segments(log.time)])
    ends = np.append(starts[1:], len(log))
    period = log.period
    whole = ends - starts >= SHORTEST * window / period
    starts, ends = starts[whole], ends[whole]
    before = command[0, : arm.n].copy()
    for j, name in enumerate(arm.input_names[: arm.n]):
        if name in log:
            before[j] = log[name][0]
    return Record(
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
        _begun(arm, log, starts),
        np.stack([instants_noise(arm, log, name) for name in names], 1),
        _input_noise(arm, log),
    )


def _input_noise(arm: Arm, log: Log) -> Array:
    """What is uncertain of each joint's measured input (n), N m at the motor: its sensor's noise, and what it does
    between rows."""
    found, gains = np.zeros(arm.n), torque_per_input(arm)
    for j in range(1, arm.n + 1):
        name = driving_channel(log, j, "command")
        if name is not None and not is_command(name):
            gain = 1.0 if "torque" in name else gains[j - 1]
            found[j - 1] = gain * between_rows(arm, log, j, log[name]).uncertainty
    return found


def _followed(log: Log, name: str, shown: Mask) -> float:
    """What no filter of the command explains of a measured torque: its sensor's noise, and what a torque loop leaves,
    which is not stated and much more."""
    command = log[commanded(name)]
    most = max(int(shown.sum()) // ROWS - 2, 0)  # with more the fit would take the noise, too
    lags = np.arange(min(max(round(FOLLOWED / log.period), 1), most) + 1)
    past = np.stack([np.append(np.full(k, command[0]), command[: len(command) - k]) for k in lags], 1)
    A = np.column_stack([past, np.ones(len(command))])[shown]
    coefficients, _, rank, _ = np.linalg.lstsq(A, log[name][shown], rcond=None)
    left = log[name][shown] - A @ coefficients
    spread = float(np.sqrt(left @ left / max(len(left) - rank, 1)))
    return max(spread, describe(name, log[name][shown]).noise)


def usual_torque(arm: Arm, record: Record) -> Array:
    """Root mean square of the torque that is commanded at each motor (n), N m."""
    size = [float(np.sqrt(np.mean(record.command[:, j] ** 2))) for j in range(arm.n)]
    return np.asarray(size * torque_per_input(arm))


def _begun(arm: Arm, log: Log, starts: Rows) -> Array:
    """The state (W, nx) at each start: a parabola through the rows about it."""
    readings = Readings.of(arm, log)
    x = np.zeros((len(starts), arm.nx))
    known: set[int] = set()
    reach, parts = max(3, round(REACH / log.period)), np.array(segments(log.time))
    within = parts[np.searchsorted(parts[:, 0], starts, side="right") - 1]  # no parabola reaches over a gap
    for k, place in enumerate(readings.places):
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
    x[:, : mechanical(arm)] = complete(arm, x, known)[:, : mechanical(arm)]
    if starts[0] == 0:  # the log begins at rest unless velocities are logged
        for k, name in enumerate(arm.state_names[: mechanical(arm)]):
            if "velocity" in name and abs(x[0, k]) < 1e-2 * arm.manifest["state"][k]["bound"]:
                x[0, k] = 0.0
    return x
