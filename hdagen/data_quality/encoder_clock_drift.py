"""A check for encoders of one joint on two clocks: the joint's reading gets later and later than the motor's, or
earlier and earlier.

The two encoders differ by the torsion, and by a delay times the speed. A delay that grows evenly with time comes from a
clock that runs at another rate. Stiffness, friction and offset may change over a log, too, so the fit leaves them free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hdagen.log.channel_statistics import describe, even
from hdagen.log.measured_log import Log

_SURE = 6.0  # standard errors
_BLOCKS = 10  # of time, each left out once by the jackknife
_FELT = 2.0  # times the noise of the encoders, that a drift must reach
_MOST = 1e-2  # of a clock's rate; more is no drift of a clock


def drifts(log: Log, ratios: Sequence[float]) -> dict[int, float]:
    """Find joints whose own encoder has a clock that runs slower, or faster, than the motor's.

    Args:
        log: both positions of a joint, times in s.
        ratios: of the gears, a joint each.

    Returns:
        By joint, seconds that its reading gets later in a second; only drifts that are sure and exceed the noise.

    """
    found = {}
    for joint, ratio in enumerate(ratios, 1):
        motor, link = f"motor_position_{joint}", f"joint_position_{joint}"
        if motor not in log or link not in log:
            continue
        channels = describe(motor, log[motor] / ratio), describe(link, log[link])
        if not all(channel.moves for channel in channels):
            continue
        rate, error, speed = _rate(log, log[motor] / ratio, log[link])
        noise = float(np.hypot(channels[0].noise, channels[1].noise))
        late = abs(rate) * float(np.ptp(log.time)) / 2
        if abs(rate) > _SURE * error and late * speed > _FELT * noise and abs(rate) < _MOST:
            found[joint] = rate
    return found


def on_motor_clock(log: Log, joint: int, rate: float) -> Log:
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


def _rate(log: Log, motor: np.ndarray, link: np.ndarray) -> tuple[float, float, float]:
    """Growth of the delay, its standard error, and the usual speed."""
    grid = even(log.time)
    position, twist = grid.smooth(link), grid.smooth(motor - link)
    speed = grid.rate(position)
    slow = max(0.05 * float(np.quantile(np.abs(speed), 0.9)), 1e-12)
    terms = np.stack([speed, grid.rate(speed), np.tanh(speed / slow), position, np.ones_like(speed)], 1)
    since = grid.time - grid.time.mean()
    rows = slice(2 * grid.width, -2 * grid.width, grid.width)
    X = np.hstack([since[:, None] * terms, terms])[rows]
    size = np.maximum(np.abs(X).max(0, initial=0.0), 1e-300)
    if len(X) < 4 * X.shape[1]:
        return 0.0, np.inf, 0.0
    X, y = X / size, twist[rows]

    def fitted(kept: np.ndarray) -> float:
        return float(np.linalg.lstsq(X[kept], y[kept], rcond=1e-9)[0][0] / size[0])

    block = np.arange(len(X)) * _BLOCKS // len(X)
    without = np.array([fitted(block != b) for b in range(_BLOCKS)])
    error = float(np.sqrt((_BLOCKS - 1) * np.mean((without - without.mean()) ** 2)))
    return fitted(block >= 0), error, float(np.std(speed))
