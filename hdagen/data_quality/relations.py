"""Relations of two signals of one joint: the mistakes that a wrong slope between them gives away."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.data_quality.finding import Finding, Severity, format_repair
from hdagen.log.channel_statistics import ChannelStatistics, fit_slope_and_correlation

DEGREES_PER_RADIAN = 180 / math.pi
_UNIT_FACTORS = 10.0, 100.0, 1000.0, 60.0, 2 * math.pi, 30 / math.pi  # between units of one quantity

Explanation = tuple[float, str, str, dict[str, dict[str, Any]]]  # slope, name of the finding, mistake, repair


def both_encoders_move(channels: Mapping[str, ChannelStatistics], joint: int) -> bool:
    """Say whether both encoders of a joint were logged and move.

    Args:
        channels: statistics of the log's columns, by name.
        joint: its number, from 1.

    Returns:
        True if both do.

    """
    names = f"motor_position_{joint}", f"joint_position_{joint}"
    return all(name in channels and channels[name].is_moving for name in names)


def explain_slopes(ratio: float, motor: str, link: str, prismatic: bool) -> Iterator[Explanation]:
    """List the mistakes that change the slope of motor over joint position.

    Args:
        ratio: of the gear, the right slope.
        motor: name of the motor's position.
        link: name of the joint's position.
        prismatic: whether the joint slides.

    Yields:
        The slope, the finding's name, the mistake and its repair.

    """
    side, degrees = {"joint_side_ratio": ratio}, {"unit": "deg"}
    yield -ratio, "reversed", "one of them is reversed", {}
    yield 1.0, "joint_scale", "the motor angle is logged at joint scale", {motor: side}
    yield -1.0, "joint_scale", "the motor angle is at joint scale and reversed", {motor: {**side, "sign": -1}}
    yield ratio * DEGREES_PER_RADIAN, "degrees", "the motor angle is in degrees", {motor: degrees}
    yield ratio / (2 * math.pi), "units", "the motor angle is in turns", {motor: {"unit": "turn"}}
    if prismatic:
        yield ratio / 1000, "units", "the joint position is in mm", {link: {"unit": "mm"}}
        return
    yield ratio / DEGREES_PER_RADIAN, "degrees", "the joint angle is in degrees", {link: degrees}
    yield ratio * 2 * math.pi, "units", "the joint angle is in turns", {link: {"unit": "turn"}}
    both = "the motor angle is in degrees and at joint scale"
    yield DEGREES_PER_RADIAN, "degrees", both, {motor: {**degrees, **side}}
    both = "the motor angle is at joint scale and the joint angle in degrees"
    yield 1 / DEGREES_PER_RADIAN, "degrees", both, {motor: side, link: degrees}


def check_derivative(
    related: tuple[float, float], velocity: str, position: str, ratio: float, joint: int
) -> list[Finding]:
    """Check that a velocity is the derivative of its position.

    Noise of the derivative makes the slope smaller, by the square of the correlation at most.

    Args:
        related: slope and correlation of the velocity over the derivative.
        velocity: its name.
        position: name of its position.
        ratio: of the gear, a factor that a velocity may be off by.
        joint: its number, from 1.

    Returns:
        A finding where it is not, whose repair scales the velocity or leaves it out.

    """
    slope, correlation = related
    most = 2.0
    if correlation > CHANNEL_CHECK.close_correlation:
        most = 1.25
    if correlation >= CHANNEL_CHECK.related_correlation and 1 / most < slope < most:
        return []
    factors = (f for one in (*_UNIT_FACTORS, ratio) for f in (one, 1 / one))
    near = (
        f for f in factors if 1 / CHANNEL_CHECK.unit_factor_tolerance < slope / f < CHANNEL_CHECK.unit_factor_tolerance
    )
    factor = next(near, None)
    repair: dict[str, Any] = {"ignore": [velocity]}
    if factor is not None and correlation > CHANNEL_CHECK.close_correlation:
        repair = {velocity: {"scale": float(f"{1 / factor:.9g}")}}
    sentence = (
        f"{velocity} contradicts {position}: it is {slope:.3g} times its derivative (correlation {correlation:.2f}); "
        f"set {format_repair(repair)} in columns.toml."
    )
    return [Finding(Severity.WARN, "contradicted", joint, sentence, repair)]


def compare_signals(
    expected: np.ndarray, found: np.ndarray, name: str, position: str, per: str, joint: int
) -> list[Finding]:
    """Check that one signal follows another: neither reversed, nor in another unit, nor unrelated.

    Args:
        expected: samples (T,) of a position, or of its derivative.
        found: samples (T,) of the signal that should follow it.
        name: of that signal.
        position: name of the position.
        per: "/s" where ``expected`` is the derivative, else "".
        joint: its number, from 1.

    Returns:
        A finding where it does not.

    """
    slope, correlation = fit_slope_and_correlation(expected, found)
    other = position
    if per:
        other = f"the derivative of {position}"
    if abs(correlation) < 0.7:
        sentence = (
            f"{name} hardly follows {other} (correlation {correlation:.2f}): another joint's, or a drive that does not "
            "reach it; if it is another's, correct 'from' in columns.toml."
        )
        return [Finding(Severity.WARN, "unrelated", joint, sentence)]
    mistakes: tuple[Explanation, ...] = (
        (-1.0, "reversed", "reversed", {name: {"sign": -1}}),
        (DEGREES_PER_RADIAN, "degrees", "in degrees", {name: {"unit": f"deg{per}"}}),
        (1 / DEGREES_PER_RADIAN, "degrees", "the position is in degrees", {position: {"unit": "deg"}}),
    )
    for factor, finding, mistake, repair in mistakes:
        if 0.5 < slope / factor < 2:  # a reference that is badly followed is larger, and no other mistake is near
            sentence = f"{name} is {slope:.3g} times {other}: {mistake}; set {format_repair(repair)} in columns.toml."
            return [Finding(Severity.REFUSE, finding, joint, sentence, repair)]
    if not 0.5 < slope < 2:
        sentence = (
            f"{name} is {slope:.3g} times {other}: another unit, another joint's, or a drive that does not reach it; "
            "correct columns.toml in the first cases."
        )
        return [Finding(Severity.WARN, "units", joint, sentence)]
    return []
