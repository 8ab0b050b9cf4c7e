"""Outliers: rows with a current that no drive gives, with a position that leaps there and back, or with a reading that
repeats the row before while the joint moves on. Such rows count as rows without a value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.data_quality.finding import state_max_current
from hdagen.data_quality.input_lags import COMMAND_MEASUREMENT_PAIRS, INPUT_QUANTITIES
from hdagen.data_quality.log_profile import LogProfile
from hdagen.log.channel_statistics import ChannelStatistics
from hdagen.log.measured_log import Log
from hdagen.support.row_runs import find_true_runs


@dataclass(frozen=True, eq=False)
class Outlier:
    """Rows (T,) of one channel that were misread: a stable name of the kind, the joint, and a sentence with numbers."""

    name: str
    joint: int
    rows: np.ndarray
    sentence: str


def find_outliers(profile: LogProfile, max_currents: Sequence[float | None]) -> Iterator[Outlier]:
    """Find the rows of a log that were misread.

    Args:
        profile: of the log.
        max_currents: of each joint, A; None where the robot file states none.

    Yields:
        Rows of one channel, or of every channel, as joint 0.

    """
    log, gap, stale = profile.log, profile.rows_after_gaps, dict[str, np.ndarray]()
    for joint, stated in enumerate(max_currents, 1):
        for name in (f"{base}_{joint}" for base in INPUT_QUANTITIES if "current" in base and f"{base}_{joint}" in log):
            if (found := _find_spikes(log, name, joint, stated)) is not None:
                yield found
        sides = [name for side in ("motor", "joint") if (name := f"{side}_position_{joint}") in log]
        places = [PositionTrack.measure(profile.measure_channel(name), log[name], gap) for name in sides]
        others: list[PositionTrack | None] = [None] * len(places)
        if len(places) > 1:
            others = [*places[::-1]]
        for place, other in zip(places, others, strict=True):
            if place.channel.is_moving:
                stale[place.channel.name] = _find_repeated_readings(place, other)
                if (found := _find_glitches(log, joint, place)) is not None:
                    yield found
        for command, name in (
            (f"{commanded}_{joint}", f"{measured}_{joint}") for commanded, measured in COMMAND_MEASUREMENT_PAIRS
        ):
            if name in log and command in log:
                stale[name] = _find_held_rows(profile, command, name)
    again = np.all([np.diff(values, prepend=np.nan) == 0.0 for values in log.columns.values()], axis=0)
    if np.any([rows & again for rows in stale.values()]):
        yield Outlier("stale", 0, again, _describe_repeats(log, "every channel", again))
        stale = {name: rows & ~again for name, rows in stale.items()}
    for name, rows in stale.items():
        if rows.any():
            yield Outlier("stale", int(name.rpartition("_")[2]), rows, _describe_repeats(log, name, rows))


@dataclass(frozen=True, eq=False)
class PositionTrack:
    """The track of a position: its ``values`` (T,), and the rows ``leap_rows`` away from the row before.

    ``off`` (T,) is each row's move less the usual move around it, ``path`` (T,) the sum of the usual moves, both in the
    unit of the values.
    """

    channel: ChannelStatistics
    values: np.ndarray
    leap_rows: np.ndarray
    deviation: np.ndarray
    path: np.ndarray

    @classmethod
    def measure(cls, channel: ChannelStatistics, values: np.ndarray, after_gap: np.ndarray) -> PositionTrack:
        """Measure the track of a position.

        Args:
            channel: its statistics.
            values: its samples (T,).
            after_gap: mask (T,) of rows after a gap, which never count as leaps.

        Returns:
            The track.

        """
        moves = np.diff(values, prepend=values[0])
        around = np.lib.stride_tricks.sliding_window_view(
            np.pad(moves, CHANNEL_CHECK.neighbour_rows, mode="edge"), 2 * CHANNEL_CHECK.neighbour_rows + 1
        )
        usual = np.median(around, axis=1)
        most = max(
            CHANNEL_CHECK.least_leap_ratio * float(np.abs(usual).max()), CHANNEL_CHECK.least_leap_noise * channel.noise
        )
        far = np.abs(moves - usual) > min(most, (channel.high - channel.low) / 2)
        return cls(channel, values, np.flatnonzero(far & ~after_gap), moves - usual, np.cumsum(usual))


def find_wrap_period(leap: float) -> float | None:
    """Find the period of an encoder from its leap where it wraps.

    Args:
        leap: its size, in the unit of the log.

    Returns:
        A turn in rad, degrees or turns, or a power of two in counts; None where the leap is none of these.

    """
    periods = (2 * math.pi, 360.0, 1.0, *(2.0**k for k in range(8, 33)))
    return next((period for period in periods if abs(leap / period - 1) < CHANNEL_CHECK.wrap_tolerance), None)


def _find_glitches(log: Log, joint: int, place: PositionTrack) -> Outlier | None:
    """Rows from a leap to the one back."""
    wrong, off = np.zeros(len(log), bool), place.deviation
    for row, after in pairwise(place.leap_rows):
        back = (
            after - row <= CHANNEL_CHECK.most_glitch_rows
            and abs(off[row] + off[after]) < abs(off[row]) / CHANNEL_CHECK.least_leap_ratio
        )
        if back and not find_wrap_period(abs(off[row])):
            wrong[row:after] = True
    if not wrong.any():
        return None
    sentence = (
        f"{place.channel.name} leaps by up to {np.abs(off[wrong]).max():.4g} and back {_describe_rows(log, wrong)}, and"
        " goes on as if nothing had been"
    )
    return Outlier("glitch", joint, wrong, sentence)


def _find_repeated_readings(place: PositionTrack, other: PositionTrack | None) -> np.ndarray:
    """Rows (T,) that repeat the row before: between rows that move the same way, until the reading leaps to where the
    joint has got to meanwhile, or while its ``other`` encoder goes far."""
    values, channel = place.values, place.channel
    moves, least = np.diff(values), CHANNEL_CHECK.least_move_steps * max(channel.noise, channel.step)
    inner = (values[1:] > channel.low) & (values[1:] < channel.high)  # at an end a sensor's range may have ended
    catching_up = {int(row) for row in place.leap_rows if not find_wrap_period(abs(place.deviation[row]))}
    far = np.inf
    if other is not None:
        far = CHANNEL_CHECK.least_other_move * float(np.ptp(other.path))
    stale = np.zeros(len(values), bool)
    for start, stop in find_true_runs((moves == 0.0) & inner):  # rows start + 1 to stop; stop + 1 catches up
        before, after = (
            moves[max(start - CHANNEL_CHECK.neighbour_rows, 0) : start],
            moves[stop + 1 : stop + 1 + CHANNEL_CHECK.neighbour_rows],
        )
        fast = (
            len(before) == len(after) == CHANNEL_CHECK.neighbour_rows
            and min(np.abs(before).min(), np.abs(after).min()) > least
        )
        on = fast and len(set(np.sign([*before, *after]))) == 1
        gone = other is not None and np.ptp(other.path[start : stop + 1]) > far
        if on or gone or stop + 1 in catching_up:
            stale[start + 1 : stop + 1] = True
    return stale


def _find_held_rows(profile: LogProfile, command: str, name: str) -> np.ndarray:
    """Rows (T,) in which a measured input stays at one value, not at an extreme, while its command goes elsewhere."""
    log = profile.log
    values, asked, rows = log[name], log[command], np.zeros(len(log), bool)
    least = max(
        CHANNEL_CHECK.least_command_change[0] * float(np.ptp(asked)),
        CHANNEL_CHECK.least_command_change[1] * profile.measure_channel(name).noise,
    )
    inner = (values > values.min()) & (values < values.max())
    repeats = np.append(False, np.diff(values) == 0.0) & inner
    for start, stop in find_true_runs(repeats):
        if log.time[stop - 1] - log.time[start] >= CHANNEL_CHECK.least_held_time and np.ptp(asked[start:stop]) > least:
            rows[start:stop] = True
    return rows


def _describe_repeats(log: Log, name: str, rows: np.ndarray) -> str:
    runs = find_true_runs(rows)
    return (
        f"{name} repeats the row before in {np.count_nonzero(rows)} row(s), {np.diff(runs).max()} on end at most, "
        f"first in row {runs[0][0] + 1} ({log.time[runs[0][0]]:.6g} s), while the joint or its command moves on"
    )


def _find_spikes(log: Log, name: str, joint: int, stated: float | None) -> Outlier | None:
    """The few rows in which a current is far beyond both the drive (``stated``, A) and nearly all other rows.

    They are errors of the logger or the bus. In mA, by contrast, nearly all rows are large.
    """
    size, drive = np.abs(log[name]), CHANNEL_CHECK.most_unstated_current
    if stated:
        drive = CHANNEL_CHECK.most_stated_ratio * stated
    most = float(np.quantile(size, CHANNEL_CHECK.usual_rows_share))
    rows = size > max(drive, CHANNEL_CHECK.most_usual_ratio * most)
    if not rows.any():
        return None
    sentence = (
        f"{name} reaches {size[rows].max():.4g} A {_describe_rows(log, rows)}, and stays within {most:.3g} A in "
        f"{100 * CHANNEL_CHECK.usual_rows_share:g} % of the rows; {state_max_current(stated)}"
    )
    return Outlier("spike", joint, rows, sentence)


def _describe_rows(log: Log, rows: np.ndarray) -> str:
    first = int(np.argmax(rows))
    return f"in {np.count_nonzero(rows)} row(s), first in row {first + 1} ({log.time[first]:.6g} s)"
