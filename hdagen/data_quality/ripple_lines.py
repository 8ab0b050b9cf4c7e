"""A check for lines of the measured current or torque that repeat with the motor's turns.

A loop that holds a speed cancels cogging and ripple before the joint moves. So positions hardly show them, but the
motor's input does. Over the motor's angle such a line stands at a whole number of cycles a turn.

Legend: k cycles a turn of the motor; θ its angle.
"""

from __future__ import annotations

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.finding import Finding, RobotFacts, Severity
from hdagen.data_quality.log_profile import LogProfile
from hdagen.data_quality.positions import SPOILT_MOTION
from hdagen.data_quality.rank_check import LEAST_ROWS_PER_TERM
from hdagen.log.measured_log import Log
from hdagen.support.row_runs import find_true_runs

_MOST_CYCLES = 40  # cycles a turn, largest that is searched
_SMOOTHING_SECONDS = 0.02  # s of the parabolas that take the encoder's steps out of θ
_MOVING_SPEED_SHARE = 0.5  # of the rms speed, above which a stretch counts
_LEAST_TURNS = 16.0  # least turns of a stretch: a window of fewer does not resolve two lines
_NEIGHBOUR_OFFSETS = np.array([0.3, 0.34, 0.38, 0.42, 0.46])  # cycles a turn beside a line, where the background is
_LEAST_PEAK_RATIO = (
    5.0  # times the median beside it, above which an amplitude is a line: of 400 logs of noise 8 have one
)
_MOST_CYCLES_PER_ROW = 0.4  # largest cycles a row
_TREND_DEGREE = 3  # degree of the polynomial that is taken off a stretch
_MOST_NAMED_LINES = 5  # lines at most
_MOST_GAP_PERIODS = 3.5  # longest pause without a row, in periods, within a stretch
_STEADY_SPEED_SPREAD = 0.1  # spread of the speed, relative, below which a line of time looks the same


def find_ripple_lines(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find lines of the measured inputs over the motor's angle.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, channels, findings = profile.log, profile.channels, []
    for joint in profile.list_sound_joints(*SPOILT_MOTION):
        name = next((n for n in (f"motor_current_{joint}", f"motor_torque_{joint}") if n in channels), None)
        if name is None or channels[name].is_constant:
            continue
        angle = _read_motor_angle(profile, robot, joint)
        if angle is None:
            continue
        found = _measure_lines(log, log[name], angle)
        if not found:
            continue
        unit = "N m"
        if "current" in name:
            unit = "A"
        strongest = sorted(found, key=lambda k: -found[k])[:_MOST_NAMED_LINES]
        listed = ", ".join(f"{k} ({found[k]:.3g} {unit})" for k in sorted(strongest))
        speed = np.abs(np.gradient(angle, log.time))
        steady = speed[speed > _MOVING_SPEED_SHARE * np.sqrt(np.mean(speed**2))]
        same = ""
        if np.std(steady) < _STEADY_SPEED_SPREAD * np.mean(steady):
            same = " At this one speed a line of time looks the same; record a second one."
        sentence = (
            f"{name} has lines at {listed} cycles a turn of the motor: cogging, ripple, or an error of the encoder, as "
            f"far as the loop makes up for it.{same}"
        )
        findings.append(Finding(Severity.WARN, "cycles", joint, sentence))
    return findings


def _read_motor_angle(profile: LogProfile, robot: RobotFacts, joint: int) -> np.ndarray | None:
    """θ (T,), smoothed; None where no position moves, or the joint slides."""
    log, channels = profile.log, profile.channels
    for name, ratio in ((f"motor_position_{joint}", 1.0), (f"joint_position_{joint}", robot.ratios[joint - 1])):
        reach = max(round(0.5 * _SMOOTHING_SECONDS / profile.period), 1)
        if name in channels and channels[name].is_moving and not robot.prismatic[joint - 1] and len(log) > 2 * reach:
            return ratio * _fit_parabolas(log[name], reach)
    return None


def _fit_parabolas(values: np.ndarray, reach: int) -> np.ndarray:
    """Values (T,) of parabolas through ``reach`` rows each way; at the ends, of the first and the last parabola."""
    places = np.arange(-reach, reach + 1)
    fit = np.linalg.pinv(np.vander(places, 3))  # takes the rows of a window to the coefficients of its parabola
    within = np.convolve(values, fit[2][::-1], "valid")
    first, last = (
        np.polyval(fit @ values[rows], at)
        for rows, at in ((slice(2 * reach + 1), places[:reach]), (slice(-2 * reach - 1, None), places[reach + 1 :]))
    )
    return np.concatenate([first, within, last])


def _measure_lines(log: Log, values: np.ndarray, angle: np.ndarray) -> dict[int, float]:
    """Amplitude of each line, by its cycles a turn."""
    speed = np.gradient(angle, log.time)
    steps = np.abs(np.gradient(angle))
    fast = np.abs(speed) > _MOVING_SPEED_SHARE * np.sqrt(np.mean(speed**2))
    even = np.append(np.diff(log.time) < _MOST_GAP_PERIODS * log.period, True)
    weight, left = np.zeros(len(values)), np.zeros(len(values))
    for first, end in find_true_runs(fast & even):
        part = slice(first, end)
        if abs(angle[end - 1] - angle[first]) < _LEAST_TURNS * 2 * np.pi or end - first < LEAST_ROWS_PER_TERM * (
            _TREND_DEGREE + 1
        ):
            continue
        along = (angle[part] - angle[first]) / (angle[end - 1] - angle[first])
        weight[part] = steps[part] * np.sin(np.pi * np.clip(along, 0.0, 1.0)) ** 2
        trend = np.polynomial.Polynomial.fit(along, values[part], _TREND_DEGREE)
        left[part] = values[part] - trend(along)
    rows = weight > 0
    if not rows.any():
        return {}
    most = min(_MOST_CYCLES, int(_MOST_CYCLES_PER_ROW * 2 * np.pi / float(np.quantile(steps[rows], 0.9))))

    def amplitude(k: float) -> float:
        return float(2 * abs(np.sum((weight * left)[rows] * np.exp(-1j * k * angle[rows]))) / weight[rows].sum())

    found = {}
    for k in range(1, most + 1):
        size = amplitude(k)
        beside = np.median([amplitude(k + side * d) for d in _NEIGHBOUR_OFFSETS for side in (-1, 1)])
        if size > _LEAST_PEAK_RATIO * beside:
            found[k] = size
    return found
