"""Replay: a log simulated again, window after window, from what was commanded and pushed.

Each window starts at the state that the measurements up to its first row give (`hdagen.start`); inside a window nothing
measured counts. Row k's command is held to row k + 1; friction sticks exactly; the effects' own states go on from
window to window.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdagen import late, verdict
from hdagen.between_rows import between_rows
from hdagen.channels import describe
from hdagen.clock import clock_noise
from hdagen.kalman import estimate
from hdagen.log import Log, LogError, parts
from hdagen.plant import Arm, Array, PlantError
from hdagen.readings import Readings, Rows, encoder_noise, mechanical, memories, within

WINDOW = 0.25  # s
LEAST = 1e-3  # multiples of the noise, below which an error counts as this
INPUTS = ("command", "measured")
_ROUNDING = 1e-9  # of a window: a row that lies a rounding error before a boundary starts the next one
_FIRST = 0.01  # s of rows that tell whether a log begins in motion
_MOVING = 4.0  # times noise and bend of the path that the first speed must exceed by then
_USUAL = 0.03  # share of the usual motion in as many rows that counts as none


@dataclass(frozen=True, eq=False)
class Replay:
    """A log as the model would have written it.

    ``columns``: time and, by joint, motor_current (A; motor_torque, N m, where the log has torque), motor_position (rad
    at the rotor) and joint_position (rad or m), each (T,). ``states`` (T, nx) as the arm names them. ``errors``: root
    mean square of prediction less measurement for each channel that the log has, in its unit; ``noise``: standard
    deviation of the channel's noise; ``relative``: error as a share of the measurement's own root mean square.
    ``starts``: first rows of the windows. ``beyond_law``: rows in which a torsion lay beyond the spring law. ``notes``:
    what a reader must know, in sentences. ``guessed``: first rows of the windows that begin at rest though the log is
    in motion there. ``inputs``: the measured channels that drove the model, in which it cannot err.
    """

    columns: dict[str, Array]
    states: Array
    errors: dict[str, float]
    noise: dict[str, float]
    relative: dict[str, float]
    starts: Rows
    beyond_law: int
    notes: tuple[str, ...]
    guessed: tuple[int, ...] = ()
    inputs: tuple[str, ...] = ()

    @property
    def channels(self) -> list[str]:
        """The channels that a gap is counted over: those that the model can err in and whose noise is known."""
        return [name for name in self.errors if name not in self.inputs and self.noise.get(name)]

    @property
    def gap(self) -> float:
        """What `joined` gives of the errors; NaN where no channel counts."""
        names = self.channels
        return float(joined(np.array([self.errors[name] / self.noise[name] for name in names]))) if names else math.nan

    def over(self, log: Log, rows: NDArray[np.bool_], noise: Mapping[str, float]) -> Replay:
        """The same with the errors of the channels in ``noise`` over ``rows`` (T) of its ``log`` alone, in that noise.

        Raises LogError where one of them is not logged."""
        if lacking := [name for name in noise if name not in self.errors]:
            raise LogError([f"{log.source}: {', '.join(lacking)} is counted and not logged; take the same log."])
        errors = {name: _rms((self.columns[name] - log[name])[rows]) for name in noise}
        size = {name: _rms(log[name][rows]) for name in noise}
        relative = {name: errors[name] / size[name] for name in errors if size[name]}
        return replace(self, errors=errors, noise=dict(noise), relative=relative)


def joined(multiples: Array) -> Array:
    """The gap (…): the geometric mean over the channels of errors (…, channels), root mean squares in multiples of
    each channel's noise."""
    return np.asarray(np.exp(np.log(np.maximum(multiples, LEAST)).mean(-1)))


def replay(
    arm: Arm,
    log: Log,
    window: float = WINDOW,
    input: str = "command",
    with_: verdict.Verdict | str | Path | Mapping[str, Any] | None = None,
) -> Replay:
    """Replay ``log`` on ``arm`` in windows of ``window`` s.

    ``input`` "command" or "measured": which current or torque drives the model. ``with_``: a diagnosis.json, what it
    holds, or its verdict; the effects and base parameters go into a copy of the arm. Raises LogError where the log does
    not fit the arm, PlantError for what cannot be done.
    """
    notes: list[str] = []
    if with_ is not None:
        arm, said = verdict.applied(arm, with_ if isinstance(with_, verdict.Verdict) else verdict.read(with_))
        notes += said
    check(arm, log)
    inputs, said = driven_by(arm, log, input)
    notes += said
    begins: list[Rows] = []
    states: list[Array] = []
    shown: list[Array] = []
    guessed: list[int] = []
    for first, end in parts(log.time, window):  # over a pause that is longer than a window nothing carries on
        part = log.rows(first, end)
        acting, at = acted_on(arm, part, inputs[first:end], input)
        own = window_starts(part.time, window)
        readings = Readings.of(arm, part)
        x, said = _predict(arm, part, readings, acting, own)
        if moving := _moves(part, readings):
            guessed.append(first)
            said.append(f"{moving}: the first window starts at rest.")
        notes += said
        begins.append(first + own)
        states.append(x)
        shown.append(at)
    found = compare(arm, log, np.concatenate(states), np.concatenate(shown), np.concatenate(begins), notes)
    driving = (driving_channel(log, j, input) for j in range(1, arm.n + 1))
    return replace(found, guessed=tuple(guessed), inputs=tuple(name for name in driving if name in found.errors))


def check(arm: Arm, log: Log) -> None:
    """Whether the log has the arm's joints, each with a position. Raises LogError."""
    problems = []
    if log.n_joints != arm.n:
        problems.append(
            f"{log.source}: the log has {log.n_joints} joint(s), the robot {arm.n}: "
            "take the robot's own log, or a columns.toml."
        )
    for j in range(1, arm.n + 1) if not problems else ():
        if f"motor_position_{j}" not in log and f"joint_position_{j}" not in log:
            problems.append(f"{log.source}: joint {j} has no position; log motor_position_{j} or joint_position_{j}.")
    if len(log) < 2:
        problems.append(f"{log.source}: {len(log)} row(s); a replay needs at least two.")
    if problems:
        raise LogError(problems)


def window_starts(time: Array, window: float) -> Rows:
    """First rows of the windows: the first row at or after each multiple of ``window`` s from the log's first."""
    if not (window > 0 and (math.isinf(window) or math.isfinite(window))):
        raise PlantError(
            f"the window must be longer than 0 s, not {window:g}: 0.25 is usual, inf takes the log as one."
        )
    number = np.floor((time - time[0]) / window + _ROUNDING)
    return np.flatnonzero(np.diff(number, prepend=-1.0))


def driven_by(arm: Arm, log: Log, source: str) -> tuple[Array, list[str]]:
    """The inputs (T, nu), row k held from time[k] to the next row, and what there is to say about them.

    A measured current that drives the model acts from row to row as `between_rows` says. Raises LogError, PlantError.
    """
    if source not in INPUTS:
        raise PlantError(f"the input is {' or '.join(INPUTS)}, not {source}.")
    inputs, notes, problems = np.zeros((len(log), arm.nu)), [], []
    for j in range(1, arm.n + 1):
        name = driving_channel(log, j, source)
        if name is None:
            problems.append(f"{log.source}: joint {j} has no current or torque; log motor_current_command_{j}.")
            continue
        if "current" in name and arm.input_names[j - 1].startswith("motor_torque"):
            problems.append(
                f"{log.source}: {name} is a current and the robot file has no torque_constant for joint {j}: "
                "state it there."
            )
            continue
        values = _in_input_unit(arm, log, j, name)
        if not is_command(name):
            between = between_rows(arm, log, j, values)
            values = between.applied(values)
            if source == "command":
                notes.append(f"No command is logged for joint {j}: {name} drives the model, {between.words}.")
        elif source == "measured":
            notes.append(f"Joint {j} has no measured current or torque: {name} drives the model.")
        inputs[:, j - 1] = values
        notes += _limit(arm, j, name, inputs[:, j - 1])
    if problems:
        raise LogError(problems)
    for name in ("tip_force_x", "tip_force_y"):
        if name in log:
            inputs[:, arm.index(name)] = log[name]
    return inputs, notes


def acted_on(arm: Arm, log: Log, inputs: Array, source: str) -> tuple[Array, Array]:
    """What acts under ``inputs`` (T, nu) as `driven_by` gives them, and what each row shows of it (T, nu each).

    Commands pass through the arm's input effects, the whole log at once; what was measured acts as it is, and shows
    itself. A row shows what acts at its instant: without such effects the row before.
    """
    acting, first, n = inputs.copy(), _before(arm, log, inputs[:1]), arm.n
    shown = np.concatenate([first, inputs[:-1]])
    names = [driving_channel(log, j, source) or "" for j in range(1, n + 1)]
    if arm.staged:
        dt = np.append(np.diff(log.time), log.period)
        mean, at = arm.acting(inputs[:, :n], dt, first[0, :n])
        commanded = [j for j, name in enumerate(names) if is_command(name)]
        acting[:, commanded], shown[:, commanded] = mean[:, commanded], at[:, commanded]
    for j, name in enumerate(names, 1):
        if name and not is_command(name):
            shown[:, j - 1] = _in_input_unit(arm, log, j, name)
    return acting, shown


def driving_channel(log: Log, j: int, source: str) -> str | None:
    """The logged current or torque of joint j that is wanted ("command" or "measured"), else the other one."""
    kinds = ("_command", "") if source == "command" else ("", "_command")
    names = (f"{quantity}{kind}_{j}" for kind in kinds for quantity in ("motor_current", "motor_torque"))
    return next((name for name in names if name in log), None)


def is_command(name: str) -> bool:
    """Whether a channel is what was commanded, not what was measured."""
    return "_command_" in name


def _in_input_unit(arm: Arm, log: Log, j: int, name: str) -> Array:
    """A logged current or torque (T,) as the input of joint j."""
    is_torque = "torque" in name and arm.input_names[j - 1].startswith("motor_current")
    return log[name] / _constant(arm, j) if is_torque else log[name]


def _limit(arm: Arm, j: int, name: str, current: Array) -> list[str]:
    most = arm.robot["joints"][j - 1]["drive"]["max_current"]
    over = int(np.count_nonzero(np.abs(current) > most * (1 + 1e-6))) if most else 0
    if not over or not arm.input_names[j - 1].startswith("motor_current"):
        return []
    return [f"{name} exceeds the robot file's max_current of {most:g} A in {over} row(s); the model lets it through."]


def _predict(arm: Arm, log: Log, readings: Readings, inputs: Array, starts: Rows) -> tuple[Array, list[str]]:
    """The states (T, nx) of all windows, and notes."""
    m = mechanical(arm)
    begun = np.stack([readings.state(arm, int(row)) for row in starts])
    if readings.say_all(arm):
        states, stopped = _roll(arm, log, inputs, starts, begun, carry=True)
        return states, ["Windows start at the logged positions and velocities.", *_stopped(stopped)]
    notes, states, stopped = list[str](), np.zeros((len(log), arm.nx)), 0
    lost = np.zeros(len(starts), bool)
    remembers = bool(arm.p[memories(arm)].any())
    if remembers:  # the effects' own states, as far as windows that begin where they were measured tell
        states, _ = _roll(arm, log, inputs, starts, begun, carry=True)
    for _ in range(2 if remembers else 1):  # the second time the filters begin with the effects' states of the first
        if len(starts) > 1:
            found = estimate(arm, log, readings, inputs, starts[1:], states[:, m:])
            lost[1:] = np.isnan(found).any(1)
            begun[1:] = np.where(lost[1:, None], begun[1:], found)
        states, stopped = _roll(arm, log, inputs, starts, begun)
    if lost.any():
        notes.append(f"{lost.sum()} window(s) start at rest where they were measured: no estimate stayed finite.")
    return states, [*notes, *_stopped(stopped)]


def _roll(arm: Arm, log: Log, inputs: Array, starts: Rows, begun: Array, carry: bool = False) -> tuple[Array, int]:
    """The states (T, nx) of windows that begin at ``begun`` (W, nx), and in how many the model left its bounds;
    ``carry`` lets the effects' states of a window begin as the one before ended."""
    states, stopped, m = np.empty((len(log), arm.nx)), 0, mechanical(arm)
    ends = np.append(starts[1:], len(log))
    path = begun[:1]
    for x, first, end in zip(begun, starts, ends, strict=True):
        if carry:
            x[m:] = path[-1, m:]
        dt = np.diff(log.time[first : end + 1])
        path = arm.rollout(x, inputs[first : first + len(dt)], dt, exact=True) if len(dt) else x[None]
        good = within(arm, path)
        if not good.all():
            last = max(int(np.argmin(good)) - 1, 0)
            path[last + 1 :], stopped = path[last], stopped + 1
        states[first:end] = path[: end - first]
    return states, stopped


def _stopped(windows: int) -> list[str]:
    if not windows:
        return []
    return [f"In {windows} window(s) the model left all bounds and is held where it did: robot file or input is wrong."]


def _moves(log: Log, readings: Readings) -> str | None:
    """In words, where the log begins in motion and no velocity says how fast."""
    rows = max(8, int(np.searchsorted(log.time, log.time[0] + _FIRST)))
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
        usual = _rms(channel[rows - 1 :] - channel[: len(channel) - rows + 1])
        least = max(abs(bend) * t[-1] ** 2, readings.noise_before(rows)[k], _USUAL * usual)
        if abs(speed) * t[-1] > _MOVING * least:
            moving.append(f"{name} at {speed:.3g} a second")
    return f"The log begins in motion ({', '.join(moving)}) and no velocity is logged" if moving else None


def compare(arm: Arm, log: Log, states: Array, shown: Array, starts: Rows, notes: list[str]) -> Replay:
    """The replay that ``states`` (T, nx) are, with what acts at each row ``shown`` (T, nu), against the measured."""
    seen = late.read(arm, log.time, states, shown)
    columns = {"time": log.logged_time}
    for j in range(1, arm.n + 1):
        columns |= _input_column(arm, log, j, shown[:, j - 1])
        columns[f"motor_position_{j}"] = np.ascontiguousarray(seen["motor_position"][:, j - 1])
        columns[f"joint_position_{j}"] = np.ascontiguousarray(seen["joint_position"][:, j - 1])
    measured = {name: log[name] for name in columns if name in log.columns}
    errors = {name: _rms(columns[name] - values) for name, values in measured.items()}
    size = {name: _rms(values) for name, values in measured.items()}
    beyond = int(np.count_nonzero(seen["beyond_law"].any(1)))
    if beyond:
        notes.append(f"In {beyond} row(s) a torsion lies beyond the spring law, which goes on along its tangent there.")
    return Replay(
        columns=columns,
        states=states,
        errors=errors,
        noise={name: channel_noise(arm, log, name) for name in measured},
        relative={name: errors[name] / size[name] for name in errors if size[name]},
        starts=starts,
        beyond_law=beyond,
        notes=tuple(dict.fromkeys(notes)),
    )


def _before(arm: Arm, log: Log, first: Array) -> Array:
    """What acted before the first row (1, nu): what is measured there; the first command where nothing is."""
    before = first.copy()
    for j in range(1, arm.n + 1):
        if arm.input_names[j - 1] in log:
            before[0, j - 1] = log[arm.input_names[j - 1]][0]
        elif f"motor_torque_{j}" in log:
            before[0, j - 1] = log[f"motor_torque_{j}"][0] / _constant(arm, j)
    return before


def _input_column(arm: Arm, log: Log, j: int, values: Array) -> dict[str, Array]:
    """Current or torque of joint j, whichever the log speaks of."""
    own = arm.input_names[j - 1]
    if own.startswith("motor_torque") or f"motor_current_{j}" in log or f"motor_current_command_{j}" in log:
        return {own: values.copy()}
    return {f"motor_torque_{j}": values * _constant(arm, j)}


def _constant(arm: Arm, j: int) -> float:
    """Torque by current as the robot file has it, N m/A, of a joint whose input is a current."""
    return arm.parameters.described[f"torque_constant_{j}"].nominal


def channel_noise(arm: Arm, log: Log, name: str, rows: NDArray[np.bool_] | slice = slice(None)) -> float:
    """Standard deviation of a channel's noise: as the robot file states, with what the clock leaves uncertain at the
    speeds of ``rows``; else as the channel shows there."""
    known = _stated_noise(arm, name)
    instants = _rms(instants_noise(arm, log, name)[rows])
    return math.hypot(known, instants) if known else describe(name, log[name][rows]).noise


def instants_noise(arm: Arm, log: Log, name: str) -> Array:
    """What the log's clock leaves uncertain of each value (T,) of a channel: of positions whose sensor's noise is
    stated; elsewhere the noise that a channel shows has it within."""
    if not name.rpartition("_")[0].endswith("position") or not _stated_noise(arm, name):
        return np.zeros(len(log))
    return clock_noise(log.time, log[name], log.time_uncertainty)


def _stated_noise(arm: Arm, name: str) -> float:
    """Standard deviation of a channel's noise as the robot file states; 0 where it states none."""
    quantity, _, j = name.rpartition("_")
    sensor = arm.robot["joints"][int(j) - 1]["sensor"]
    if quantity.endswith("position"):
        return encoder_noise(sensor, quantity.split("_")[0])
    if quantity == "motor_torque":  # which stands for a current, whose noise the robot file states, or is the input
        return 0.0 if name in arm.input_names else float(sensor["current_noise"] * _constant(arm, int(j)))
    return float(sensor["current_noise"])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
