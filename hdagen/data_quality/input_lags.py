"""Lags of measured currents and torques behind their commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.data_quality.input_check_settings import INPUT_CHECK
from hdagen.log.channel_statistics import fit_slope_and_correlation
from hdagen.log.measured_log import Log, find_gaps

COMMAND_MEASUREMENT_PAIRS = (
    ("motor_current_command", "motor_current"),
    ("motor_torque_command", "motor_torque"),
)  # commanded, measured
INPUT_QUANTITIES = tuple(base for pair in COMMAND_MEASUREMENT_PAIRS for base in pair)


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
    latest = max(10, round(INPUT_CHECK.longest_lag / period))
    inner = command[-INPUT_CHECK.earliest_lag_rows : len(command) - latest]
    if len(command) < 4 * latest:
        return None
    lags = range(INPUT_CHECK.earliest_lag_rows, latest + 1)
    slopes, misfits = [], []
    for rows in lags:
        later = measured[rows - INPUT_CHECK.earliest_lag_rows : rows - INPUT_CHECK.earliest_lag_rows + len(inner)]
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
    return Lag(
        lags[best],
        (lags[best] + vertex) * period,
        slopes[best],
        misfits[best],
        misfits[1 - INPUT_CHECK.earliest_lag_rows],
    )


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
    steps[rows + 1] += np.minimum(
        missing, max(10, round(INPUT_CHECK.longest_lag / log.period)) - INPUT_CHECK.earliest_lag_rows
    )
    place = np.cumsum(steps) - 1
    spread = np.full((len(names), place[-1] + 1), np.nan)
    spread[:, place] = [log[name] for name in names]
    return spread[0], spread[1]
