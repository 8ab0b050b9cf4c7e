"""Checks of currents and torques: milliamperes, a torque at the joint's side, a shifted row."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdagen.data_quality.finding import Finding, RobotFacts, Severity
from hdagen.log.channel_statistics import ChannelStatistics, fit_slope_and_correlation
from hdagen.log.measured_log import Log, find_gaps

COMMAND_MEASUREMENT_PAIRS = (
    ("motor_current_command", "motor_current"),
    ("motor_torque_command", "motor_torque"),
)  # commanded, measured
INPUT_QUANTITIES = tuple(base for pair in COMMAND_MEASUREMENT_PAIRS for base in pair)
_LONGEST_LAG = 0.1  # s, searched between command and measurement
_EARLIEST_LAG_ROWS = -5  # rows, earliest lag that is searched
_CLEAR_MISFIT_RATIO = (
    0.5  # of the misfit at the usual lag, that a lag before the command must leave at most to be a mistake
)
_LEAST_EARLY_ROWS = 3  # rows from which the motion decides whether command or measurement is logged in the wrong row
UNSTATED_CURRENT = 200.0  # A; above it, unless the robot file states such a drive, currents are in mA


def state_max_current(stated: float | None) -> str:
    """State a drive's largest current in a sentence.

    Args:
        stated: in A, as the robot file has it.

    Returns:
        The words.

    """
    if stated:
        return f"the robot file states at most {stated:g} A"
    return "the robot file states no max_current"


def check_current_sizes(channels: Mapping[str, ChannelStatistics], machine: RobotFacts) -> list[Finding]:
    """Check currents against the drive's largest one: beyond it they are in mA, once misread rows are taken out.

    Args:
        channels: statistics of each column, by name.
        machine: facts of the robot.

    Returns:
        The findings.

    """
    findings = []
    for joint, stated in enumerate(machine.max_currents, start=1):
        for name in (f"motor_current_command_{joint}", f"motor_current_{joint}"):
            if name not in channels:
                continue
            peak, most = max(abs(channels[name].low), abs(channels[name].high)), UNSTATED_CURRENT
            if stated:
                most = 10 * stated
            if peak > most:
                sentence = (
                    f"{name} reaches {peak:.4g}, {state_max_current(stated)}: mA? "
                    f'Then set unit = "mA" under [{name}] in columns.toml.'
                )
                findings.append(Finding(Severity.REFUSE, "milliamperes", joint, sentence, {name: {"unit": "mA"}}))
    return findings


@dataclass(frozen=True)
class Lag:
    """A measured input against its command: the lag that fits best, in ``rows`` and, more finely, in ``seconds``.

    ``slope`` is measured over commanded there; ``misfit`` the share of variance that is not explained at that lag, and
    ``usual_misfit`` that at a lag of one row, which a drive without delay has.
    """

    rows: int
    seconds: float
    slope: float
    misfit: float
    usual_misfit: float


def estimate_lag(command: np.ndarray, measured: np.ndarray, period: float) -> Lag | None:
    """Estimate the lag of a measured input behind its command.

    Args:
        command: commanded values (T,), NaN in missing rows.
        measured: measured values (T,) in the same unit, NaN in missing rows.
        period: of the rows, s.

    Returns:
        The lag; None where the two do not correlate or hardly vary.

    """
    latest = max(10, round(_LONGEST_LAG / period))
    inner = command[-_EARLIEST_LAG_ROWS : len(command) - latest]
    if len(command) < 4 * latest:
        return None
    lags = range(_EARLIEST_LAG_ROWS, latest + 1)
    slopes, misfits = [], []
    for rows in lags:
        later = measured[rows - _EARLIEST_LAG_ROWS : rows - _EARLIEST_LAG_ROWS + len(inner)]
        both = np.isfinite(inner) & np.isfinite(later)
        pair = (inner, later) if both.all() else (inner[both], later[both])
        if len(pair[0]) < latest or np.ptp(pair[0]) == 0 or np.ptp(pair[1]) == 0:
            return None
        slope, correlation = fit_slope_and_correlation(*pair)
        slopes.append(slope)
        misfits.append(max(0.0, 1 - correlation**2))
    best = int(np.argmin(misfits))
    if misfits[best] > 0.5:
        return None
    vertex = 0.0  # of the parabola through the best lag and its neighbours, in rows
    if 0 < best < len(misfits) - 1:
        left, middle, right = misfits[best - 1 : best + 2]
        if left + right > 2 * middle:
            vertex = 0.5 * (left - right) / (left - 2 * middle + right)
    return Lag(lags[best], (lags[best] + vertex) * period, slopes[best], misfits[best], misfits[1 - _EARLIEST_LAG_ROWS])


def estimate_lags(log: Log) -> dict[str, Lag]:
    """Estimate the lag of each measured current or torque behind its command.

    Args:
        log: with times in s.

    Returns:
        Lags by the measured channel's name.

    """
    found = {}
    for commanded, measured in COMMAND_MEASUREMENT_PAIRS:
        for joint in range(1, log.n_joints + 1):
            names = f"{commanded}_{joint}", f"{measured}_{joint}"
            if all(name in log for name in names):
                one = estimate_lag(*_fill_missing_rows(log, names), log.period)
                if one is not None:
                    found[names[1]] = one
    return found


def _fill_missing_rows(log: Log, names: tuple[str, str]) -> tuple[np.ndarray, np.ndarray]:
    """Columns with a NaN for each row that is missing; of a long gap only as many as the longest lag."""
    rows, missing = find_gaps(log.time)
    steps = np.ones(len(log), int)
    steps[rows + 1] += np.minimum(missing, max(10, round(_LONGEST_LAG / log.period)) - _EARLIEST_LAG_ROWS)
    place = np.cumsum(steps) - 1
    spread = np.full((len(names), place[-1] + 1), np.nan)
    spread[:, place] = [log[name] for name in names]
    return spread[0], spread[1]


def check_measured_inputs(
    log: Log, found: Mapping[str, Lag], machine: RobotFacts, behind: Mapping[str, float]
) -> list[Finding]:
    """Check the scale of each measured input against its command, and the row in which it shows it.

    Args:
        log: to be checked.
        found: the lags of its measured inputs, by name.
        machine: facts of the robot.
        behind: rows that the motion is behind each measured input, by name.

    Returns:
        The findings.

    """
    findings = []
    for commanded, measured in COMMAND_MEASUREMENT_PAIRS:
        for joint in range(1, log.n_joints + 1):
            command, name = f"{commanded}_{joint}", f"{measured}_{joint}"
            if name in found:
                findings += _check_scale(found[name], command, name, machine.ratios[joint - 1], joint)
                findings += _check_row_shift(log, found[name], command, name, joint, behind.get(name, math.nan))
    return findings


def _check_scale(one: Lag, command: str, name: str, ratio: float, joint: int) -> list[Finding]:
    """Whether a measured input is in another unit than its command, or at the joint's side of the gear."""
    says = f"{name} is {one.slope:.4g} times its command"
    for factor, what, who in ((1e3, "mA against A", name), (1e-3, "A against mA", command)):
        if 0.5 < one.slope / factor < 2 and "current" in name:
            sentence = f'{says}: {what}; set unit = "mA" under [{who}] in columns.toml.'
            return [Finding(Severity.REFUSE, "milliamperes", joint, sentence, {who: {"unit": "mA"}})]
    for factor, who in ((ratio, name), (1 / ratio, command)):
        if "torque" in name and ratio > 3 and 0.8 < one.slope / factor < 1.25:
            repair = f"joint_side_ratio = {ratio:g} under [{who}]"
            sentence = f"{says}, the ratio: one of them is at the joint; set {repair} in columns.toml."
            return [Finding(Severity.REFUSE, "joint_scale", joint, sentence)]
    if one.slope > 0 and not 0.3 < one.slope < 3:
        sentence = f"{says}: another unit, or a drive that does not follow; give the unit in columns.toml."
        return [Finding(Severity.WARN, "units", joint, sentence)]
    return []


def _check_row_shift(log: Log, one: Lag, command: str, name: str, joint: int, behind: float) -> list[Finding]:
    """A command is held from its row to the next: the measurement cannot show it before the next row."""
    if np.array_equal(log[command], log[name]):
        sentence = (
            f"{name} equals {command} in every row: the command under another name, not a measurement; leave it out, "
            f'ignore = ["{name}"] in columns.toml.'
        )
        return [Finding(Severity.REFUSE, "row_shift", joint, sentence, {"ignore": [name]})]
    if one.rows <= 0 and one.misfit < 0.9 * one.usual_misfit and one.misfit >= _CLEAR_MISFIT_RATIO * one.usual_misfit:
        sentence = (
            f"{name} fits {command} best {-1e3 * one.seconds:.2g} ms ahead of it, which cannot be, and hardly better "
            "than behind it: their shapes differ in another way."
        )
        return [Finding(Severity.NOTE, "row_shift", joint, sentence)]
    if one.rows <= 0 and one.misfit < _CLEAR_MISFIT_RATIO * one.usual_misfit:
        early, shown = 1 - one.rows, "k"
        if one.rows:
            shown = f"k+{-one.rows}"
        sentence = (
            f"{name} shows in row k the command of row {shown}, before it can have acted; set shift_rows = {-early} "
            f"under [{command}] (it is logged late) or shift_rows = {early} under [{name}] (it is logged early), "
            "in columns.toml."
        )
        repair = {name: {"shift_rows": early}}
        if early >= _LEAST_EARLY_ROWS and behind > -early / 2:  # the motion follows the measurement as it stands
            repair = {command: {"shift_rows": -early}}
        return [Finding(Severity.REFUSE, "row_shift", joint, sentence, repair)]
    if one.rows == 2 and one.misfit < 0.8 * one.usual_misfit:
        sentence = (
            f"{name} shows in row k the command of row k-2: the command is logged a row early, or the drive takes a "
            f"period more; if it is the log, set shift_rows = 1 under [{command}] in columns.toml."
        )
        return [Finding(Severity.WARN, "row_shift", joint, sentence)]
    return []
