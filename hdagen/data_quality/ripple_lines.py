"""A check for lines of the measured current or torque that repeat with the motor's turns.

A loop that holds a speed cancels cogging and ripple before the joint moves. So positions hardly show them, but the
motor's input does. Over the motor's angle such a line stands at a whole number of cycles a turn.

Legend: k cycles a turn of the motor; θ its angle.
"""

from __future__ import annotations

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.data_quality.finding import Finding, RobotFacts, Severity
from hdagen.data_quality.log_profile import LogProfile
from hdagen.data_quality.positions import SPOILT_MOTION
from hdagen.data_quality.ripple_line_settings import RIPPLE_LINE
from hdagen.log.measured_log import Log
from hdagen.support.row_runs import find_true_runs


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
        strongest = sorted(found, key=lambda k: -found[k])[: RIPPLE_LINE.most_named_lines]
        listed = ", ".join(f"{k} ({found[k]:.3g} {unit})" for k in sorted(strongest))
        speed = np.abs(np.gradient(angle, log.time))
        steady = speed[speed > RIPPLE_LINE.moving_speed_share * np.sqrt(np.mean(speed**2))]
        same = ""
        if np.std(steady) < RIPPLE_LINE.steady_speed_spread * np.mean(steady):
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
        reach = max(round(0.5 * RIPPLE_LINE.parabola_time / profile.period), 1)
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
    fast = np.abs(speed) > RIPPLE_LINE.moving_speed_share * np.sqrt(np.mean(speed**2))
    even = np.append(np.diff(log.time) < RIPPLE_LINE.most_gap_periods * log.period, True)
    weight, left = np.zeros(len(values)), np.zeros(len(values))
    for first, end in find_true_runs(fast & even):
        part = slice(first, end)
        turns = abs(angle[end - 1] - angle[first]) / (2 * np.pi)
        fewest = CHANNEL_CHECK.least_rows_per_term * (RIPPLE_LINE.trend_degree + 1)
        if turns < RIPPLE_LINE.least_turns or end - first < fewest:
            continue
        along = (angle[part] - angle[first]) / (angle[end - 1] - angle[first])
        weight[part] = steps[part] * np.sin(np.pi * np.clip(along, 0.0, 1.0)) ** 2
        trend = np.polynomial.Polynomial.fit(along, values[part], RIPPLE_LINE.trend_degree)
        left[part] = values[part] - trend(along)
    rows = weight > 0
    if not rows.any():
        return {}
    most = min(
        RIPPLE_LINE.most_cycles, int(RIPPLE_LINE.most_cycles_per_row * 2 * np.pi / float(np.quantile(steps[rows], 0.9)))
    )

    def amplitude(k: float) -> float:
        return float(2 * abs(np.sum((weight * left)[rows] * np.exp(-1j * k * angle[rows]))) / weight[rows].sum())

    found = {}
    for k in range(1, most + 1):
        size = amplitude(k)
        beside = np.median([amplitude(k + side * d) for d in RIPPLE_LINE.neighbour_offsets for side in (-1, 1)])
        if size > RIPPLE_LINE.least_peak_ratio * beside:
            found[k] = size
    return found
