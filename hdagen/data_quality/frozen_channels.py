"""Checks for channels that are frozen while their joint moves, and for readings that are saturated at a bound."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.data_quality.finding import Finding, RobotFacts, Severity
from hdagen.data_quality.input_lags import COMMAND_MEASUREMENT_PAIRS, INPUT_QUANTITIES
from hdagen.data_quality.inputs_vs_motion import find_swapped_inputs, measure_unexplained_input, smooth_sound_motion
from hdagen.data_quality.log_profile import LogProfile
from hdagen.log.channel_statistics import ChannelStatistics
from hdagen.log.column_map import is_command_channel
from hdagen.log.measured_log import Log
from hdagen.support.row_runs import find_true_runs


def find_frozen_channels(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find encoders and inputs that stay at one value while their joint moves.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, channels, findings = profile.log, profile.channels, []
    for joint in range(1, log.n_joints + 1):
        sides = [name for side in ("motor", "joint") if (name := f"{side}_position_{joint}") in channels]
        moving = [name for name in sides if channels[name].is_moving]
        if not moving:
            continue
        inputs = [name for base in INPUT_QUANTITIES if (name := f"{base}_{joint}") in channels]
        driven = [name for name in inputs if not channels[name].is_constant]
        findings += [
            _refuse_unread(channels[name], f"{moving[0]} moves", joint)
            for name in sides
            if name not in moving and channels[name].is_constant
        ]
        if driven and not _is_passive(log, channels, joint):
            findings += [
                _refuse_unread(channels[name], f"{driven[0]} does not", joint)
                for name in inputs
                if name not in driven and not _follows_command(log, channels[name], channels, joint)
            ]
        elif inputs:
            findings.append(_explain_undriven_joint([channels[name] for name in inputs], joint))
    return findings


def _is_passive(log: Log, channels: Mapping[str, ChannelStatistics], joint: int) -> bool:
    """Whether a joint is commanded 0 all along, and its measured input is small beside the other joints'."""
    for commanded, measured in COMMAND_MEASUREMENT_PAIRS:
        command, name = channels.get(f"{commanded}_{joint}"), f"{measured}_{joint}"
        if command is not None and command.low == command.high == 0.0 and name in log:
            sizes = [np.std(log[f"{measured}_{j}"]) for j in range(1, log.n_joints + 1) if f"{measured}_{j}" in log]
            return bool(np.std(log[name]) < CHANNEL_CHECK.passive_input_share * max(sizes))
    return False


def _follows_command(
    log: Log, command: ChannelStatistics, channels: Mapping[str, ChannelStatistics], joint: int
) -> bool:
    """Whether the measured input stays at the command's one value, but for noise and the rise to it."""
    for commanded, measured in COMMAND_MEASUREMENT_PAIRS:
        found = channels.get(f"{measured}_{joint}")
        if command.name == f"{commanded}_{joint}" and found is not None:
            return bool(
                np.quantile(np.abs(log[found.name] - command.low), CHANNEL_CHECK.commanded_rows_share)
                < CHANNEL_CHECK.commanded_noise_multiple * found.noise
            )
    return False


def _refuse_unread(channel: ChannelStatistics, other: str, joint: int) -> Finding:
    """A finding that a channel is not read, as ``other`` moves meanwhile."""
    sentence = (
        f"{channel.name} stays at {channel.low:.5g} while {other}: it is not read; repair that and record again, or "
        f'leave it out with ignore = ["{channel.name}"] in columns.toml.'
    )
    return Finding(Severity.REFUSE, "still", joint, sentence)


def _explain_undriven_joint(inputs: list[ChannelStatistics], joint: int) -> Finding:
    """A finding for a joint that moves while its input does not.

    It may be pulled along by the others, fall or coast; otherwise its input was not recorded, which the robot's model
    decides (`inputs_vs_model.check_drives`). A measurement has noise, so an input at one value was not measured.
    """
    constant = [c for c in inputs if c.is_constant]
    channel = next((c for c in constant if not is_command_channel(c.name)), constant[0])
    says = f"{channel.name} stays at {channel.low:.5g} while joint {joint} moves"
    if channel.low == 0.0 and is_command_channel(channel.name):
        sentence = f"{says}: a passive joint, or an input that was not recorded; if it was driven, record its input."
        return Finding(Severity.WARN, "still", joint, sentence)
    sentence = f"{says}: the input was not recorded; record the current or torque that drives it."
    return Finding(Severity.REFUSE, "still", joint, sentence)


def find_saturated_positions(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find positions that stand at an extreme and go on from it as fast as they came: the sensor's range has ended.

    A joint that sticks or strikes a stop has to be accelerated again, and is at rest before it moves off.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, channels, findings = profile.log, profile.channels, []
    for joint in range(1, log.n_joints + 1):
        for name in (f"{side}_position_{joint}" for side in ("motor", "joint")):
            if name not in channels or not channels[name].is_moving:
                continue
            if runs := _find_cut_runs(log, name):
                rows = sum(stop - start for start, stop in runs)
                sentence = (
                    f"{name} stands at {channels[name].low:.5g} or {channels[name].high:.5g} and goes on as fast as it "
                    f"came, {rows} row(s) in all, first from row {runs[0][0] + 1} ({log.time[runs[0][0]]:.6g} s): the "
                    "sensor's range has ended; record a motion within it."
                )
                findings.append(Finding(Severity.REFUSE, "saturated", joint, sentence))
    return findings


def find_saturated_inputs(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find inputs that stand at an extreme while the motion requires more: the recording is saturated, not the drive.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    if find_swapped_inputs(profile, robot, model):
        return []
    log, channels, moving, findings = profile.log, profile.channels, smooth_sound_motion(profile, robot), []
    for one, joint in enumerate(moving.joints):
        for name in (f"{base}_{joint}" for base in INPUT_QUANTITIES):
            if name not in channels or channels[name].is_constant:
                continue
            held = np.zeros(len(log), bool)
            for start, stop in _find_extreme_runs(log, name, CHANNEL_CHECK.least_input_run):
                held[start:stop] = True
            if not held.any():
                continue
            beyond = measure_unexplained_input(profile, moving, one, name, held)
            if beyond is None:
                continue
            excess, error = beyond
            bound = max(abs(channels[name].low), abs(channels[name].high))
            if excess > CHANNEL_CHECK.least_error_ratio * error and excess > CHANNEL_CHECK.least_bound_share * bound:
                sentence = (
                    f"{name} stands at {channels[name].low:.4g} or {channels[name].high:.4g} in "
                    f"{100 * np.count_nonzero(held) / len(log):.2g} % of the rows, and the motion there asks for "
                    f"{excess:.3g} more: the recording is cut off; widen its range and record again."
                )
                findings.append(Finding(Severity.REFUSE, "saturated", joint, sentence))
    return findings


def _find_extreme_runs(log: Log, name: str, shortest: float) -> list[tuple[int, int]]:
    """Rows [start, stop) in which the column stays at its smallest or largest value for at least ``shortest`` s."""
    values, least = log[name], max(CHANNEL_CHECK.least_run_rows, round(shortest / log.period))
    runs = []
    for extreme in (values.min(), values.max()):
        runs += [(int(a), int(b)) for a, b in find_true_runs(values == extreme) if b - a >= least]
    return sorted(runs)


def _find_cut_runs(log: Log, name: str) -> list[tuple[int, int]]:
    """Runs at an extreme that the joint enters and leaves at full speed, from one row to the next.

    The speed changes there by far more than anywhere else: no drive can do that twice in a row.
    """
    values, runs = log[name], _find_extreme_runs(log, name, CHANNEL_CHECK.least_position_run)
    moves = np.diff(values) / np.maximum(np.rint(np.diff(log.time) / log.period), 1)
    usual = float(np.sqrt(np.mean(moves**2)))
    away = np.ones(len(moves) - 1, bool)  # of the changes of speed, those beside no run
    for start, stop in runs:
        away[max(start - 3, 0) : stop + 2] = False
    elsewhere = float(np.abs(np.diff(moves))[away].max(initial=0.0))
    least = max(CHANNEL_CHECK.least_speed_share * usual, CHANNEL_CHECK.abrupt_ratio * elsewhere)
    cut = []
    for start, stop in runs:
        sides = (
            moves[max(start - 1 - CHANNEL_CHECK.speed_rows, 0) : start - 1],
            moves[stop : stop + CHANNEL_CHECK.speed_rows],
        )
        if all(len(side) == CHANNEL_CHECK.speed_rows for side in sides):
            before, after = sides
            if min(_find_speed_at_end(before), _find_speed_at_end(after[::-1])) > least:
                cut.append((start, stop))
    return cut


def _find_speed_at_end(moves: Array) -> float:
    """The speed with which moves of several rows end: their median, or less where they come to rest by themselves."""
    slope, _ = np.polyfit(np.arange(len(moves)), moves, 1)
    median = float(np.median(moves))
    going_on = median + slope * (len(moves) - 1) / 2 + 2 * slope  # the last row beside the run is cut off somewhere
    return min(abs(median), np.sign(median) * going_on)
