"""A check for encoders of one joint on two clocks: the joint's reading gets later and later than the motor's, or
earlier and earlier.

The two encoders differ by the torsion, and by a delay times the speed. A delay that grows evenly with time comes from a
clock that runs at another rate. Stiffness, friction and offset may change over a log, too, so the fit leaves them free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.data_quality.log_profile import LogProfile
from hdagen.log.channel_statistics import compute_channel_statistics
from hdagen.log.measured_log import Log


def find_clock_drifts(profile: LogProfile, ratios: Sequence[float]) -> dict[int, float]:
    """Find joints whose own encoder has a clock that runs slower, or faster, than the motor's.

    Args:
        profile: of the log.
        ratios: of the gears, a joint each.

    Returns:
        By joint, seconds that its reading gets later in a second; only drifts that are sure and exceed the noise.

    """
    log, found = profile.log, {}
    for joint, ratio in enumerate(ratios, 1):
        motor, link = f"motor_position_{joint}", f"joint_position_{joint}"
        if motor not in log or link not in log:
            continue
        channels = compute_channel_statistics(motor, log[motor] / ratio), profile.measure_channel(link)
        if not all(channel.is_moving for channel in channels):
            continue
        rate, error, speed = _fit_delay_growth(profile, log[motor] / ratio, link)
        noise = float(np.hypot(channels[0].noise, channels[1].noise))
        late = abs(rate) * float(np.ptp(log.time)) / 2
        if (
            abs(rate) > CHANNEL_CHECK.sure_drift_deviations * error
            and late * speed > CHANNEL_CHECK.least_drift_noise * noise
            and abs(rate) < CHANNEL_CHECK.largest_drift_rate
        ):
            found[joint] = rate
    return found


def correct_clock_drift(log: Log, joint: int, rate: float) -> Log:
    """Bring the readings of a joint's encoder to the clock of its motor's.

    Args:
        log: to be corrected; times in s.
        joint: its number, from 1.
        rate: seconds that its reading gets later in a second.

    Returns:
        The log with the joint's position and velocity interpolated; the delay in the middle of the log stays.

    """
    from scipy.interpolate import CubicSpline

    now = log.time + rate * (log.time - log.time.mean())
    names = [name for quantity in ("position", "velocity") if (name := f"joint_{quantity}_{joint}") in log]
    inside = np.clip(now, log.time[0], log.time[-1])
    brought = {name: np.asarray(CubicSpline(log.time, log[name])(inside)) for name in names}
    return replace(log, columns={**log.columns, **brought})


def _fit_delay_growth(profile: LogProfile, motor: np.ndarray, link: str) -> tuple[float, float, float]:
    """Growth of the delay, its standard error, and the usual speed."""
    grid = profile.grid
    position, twist = profile.smooth_channel(link), grid.smooth(motor - profile.log[link])
    speed = grid.differentiate(position)
    slow = max(0.05 * float(np.quantile(np.abs(speed), 0.9)), 1e-12)
    terms = np.stack([speed, grid.differentiate(speed), np.tanh(speed / slow), position, np.ones_like(speed)], 1)
    since = grid.time - grid.time.mean()
    rows = slice(2 * grid.window_rows, -2 * grid.window_rows, grid.window_rows)
    X = np.hstack([since[:, None] * terms, terms])[rows]
    size = np.maximum(np.abs(X).max(0, initial=0.0), 1e-300)
    if len(X) < 4 * X.shape[1]:
        return 0.0, np.inf, 0.0
    X, y = X / size, twist[rows]

    def fitted(kept: np.ndarray) -> float:
        return float(np.linalg.lstsq(X[kept], y[kept], rcond=1e-9)[0][0] / size[0])

    block = np.arange(len(X)) * CHANNEL_CHECK.jackknife_blocks // len(X)
    without = np.array([fitted(block != b) for b in range(CHANNEL_CHECK.jackknife_blocks)])
    error = float(np.sqrt((CHANNEL_CHECK.jackknife_blocks - 1) * np.mean((without - without.mean()) ** 2)))
    return fitted(block >= 0), error, float(np.std(speed))
