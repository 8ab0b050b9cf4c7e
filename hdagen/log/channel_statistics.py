"""Statistics of a channel of a log: range, quantisation, noise, saturation; and a uniform grid to differentiate on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdagen.support.row_runs import find_true_runs

_SATURATED_RUN_ROWS = 5  # consecutive rows at one extreme that count as saturated
_LEAST_MOTION = 0.01  # rad or m; less is compliance and control error of a joint that is held
_SMOOTHING_TIME = 0.015  # s, of the boxcar that smooths before differentiating


@dataclass(frozen=True)
class ChannelStatistics:
    """The statistics of a channel, SI.

    Attributes:
        name: The channel's name.
        low: Its smallest value.
        high: Its largest value.
        step: The quantisation step of its values; 0 where none is seen.
        noise: Standard deviation of its noise, at least that of its steps.
        saturated: Share of the rows in which it is held at an extreme.

    """

    name: str
    low: float
    high: float
    step: float
    noise: float
    saturated_share: float

    @property
    def is_constant(self) -> bool:
        """Whether the channel never leaves one value."""
        return self.high == self.low

    @property
    def is_moving(self) -> bool:
        """Whether a position moves as a driven joint does, more than a joint that is held while others move."""
        return self.high - self.low > max(_LEAST_MOTION, 50 * self.noise)


def compute_channel_statistics(name: str, values: np.ndarray) -> ChannelStatistics:
    """Compute the statistics of a channel.

    Args:
        name: The channel's name.
        values: (T,), its samples, SI.

    Returns:
        The statistics.

    """
    levels = np.unique(values)
    step = find_quantisation_step(levels)
    spread = max(estimate_noise(values), step / math.sqrt(12))
    return ChannelStatistics(name, float(levels[0]), float(levels[-1]), step, spread, _compute_saturated_share(values))


def find_quantisation_step(levels: np.ndarray) -> float:
    """Find the quantisation step of a channel.

    Args:
        levels: (L,), the distinct values of the channel, sorted.

    Returns:
        The step whose multiples the levels are, counted from the first; 0 where there is none, or too few levels.

    """
    if len(levels) < 5:
        return 0.0
    for rounding in (1e-7, 1e-9):  # float32 and text give one level several spellings, this far apart
        gaps = np.diff(levels)
        gaps = gaps[gaps > rounding * np.abs(levels).max()]
        for share in (0.0, 0.02, 0.1):  # the step is the smallest gap, unless a few rows are out of line
            if len(gaps) < 4:
                break
            step = _refine_step(gaps, float(np.quantile(gaps, share)))
            if step:
                return step
    return 0.0


def _refine_step(gaps: np.ndarray, step: float) -> float:
    """Refine ``step`` where nearly all ``gaps`` between levels are multiples of it; else return 0."""
    for largest in (5, 50, 500):  # a gap of many steps shows a small error of the step, a small one none
        multiples = np.rint(gaps / step)
        countable = (multiples >= 1) & (multiples <= largest)
        if not countable.any():
            return 0.0
        step = float(gaps[countable].sum() / multiples[countable].sum())
    off = np.abs(gaps / step - np.rint(gaps / step))[countable]
    if np.count_nonzero(countable) > 0.5 * len(gaps) and np.quantile(off, 0.9) < 0.1:
        return step
    return 0.0


def estimate_noise(values: np.ndarray) -> float:
    """Estimate the white noise on a smooth signal, robustly, from its differences of order 2 to 6.

    The differences of order n of white noise have C(2n, n) times its variance. The signal's own share of them falls
    with the order, so the smallest estimate is taken.

    Args:
        values: (T,), the samples.

    Returns:
        Standard deviation of the noise, in the unit of the samples; 0 where quantisation hides it.

    """
    estimates = []
    for order in range(2, 7):
        differences = np.diff(values, order)
        if len(differences) < 10:
            break
        estimates.append(1.4826 * np.median(np.abs(differences)) / math.sqrt(math.comb(2 * order, order)))
    return float(min(estimates, default=0.0))


def _compute_saturated_share(values: np.ndarray) -> float:
    """The share of rows in runs of at least five at the smallest or largest value; 0 for a constant channel."""
    low, high = values.min(), values.max()
    if low == high:
        return 0.0
    rows = 0
    for extreme in (low, high):
        lengths = np.diff(find_true_runs(values == extreme))
        rows += int(lengths[lengths >= _SATURATED_RUN_ROWS].sum())
    return rows / len(values)


@dataclass(frozen=True, eq=False)
class UniformGrid:
    """Evenly spaced instants over the time of a log, for filters that need them.

    Attributes:
        time: (K,), the even instants, s.
        logged: (T,), the instants of the log's rows, s.

    """

    time: np.ndarray
    logged_time: np.ndarray

    @property
    def period(self) -> float:
        """The time between two even instants, s."""
        return float(self.time[1] - self.time[0])

    @property
    def window_rows(self) -> int:
        """Rows of the smoothing window."""
        return max(5, round(_SMOOTHING_TIME / self.period))

    def smooth(self, values: np.ndarray) -> np.ndarray:
        """Interpolate samples to the even instants and smooth them with two boxcars, without lag.

        Args:
            values: (T,), samples at the rows of the log.

        Returns:
            (K,), smoothed samples at the even instants; the smoothing is the same for every channel.

        """
        even = np.interp(self.time, self.logged_time, values)
        kernel = np.full(self.window_rows, 1.0 / self.window_rows)
        before, after = self.window_rows // 2, self.window_rows - 1 - self.window_rows // 2
        for _ in range(2):
            even = np.convolve(np.pad(even, (before, after), mode="edge"), kernel, "valid")
        return even

    def differentiate(self, smooth: np.ndarray) -> np.ndarray:
        """Differentiate smoothed samples.

        Args:
            smooth: (K,), samples at the even instants.

        Returns:
            (K,), their time derivative, a second.

        """
        return np.gradient(smooth, self.period)


def make_uniform_grid(time: np.ndarray) -> UniformGrid:
    """Make a uniform grid at the median period of a log, from its first to its last row.

    Args:
        time: (T,), increasing, s.

    Returns:
        The grid, of two instants or more.

    """
    period = float(np.median(np.diff(time)))
    return UniformGrid(time[0] + period * np.arange(max(2, int((time[-1] - time[0]) / period + 1.0 + 1e-6))), time)


def fit_slope_and_correlation(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Fit the slope of y over x about their means.

    Args:
        x: (K,), not constant.
        y: (K,), not constant.

    Returns:
        The slope, and the correlation of x and y.

    """
    x, y = x - x.mean(), y - y.mean()
    return float(x @ y / (x @ x)), float(x @ y / math.sqrt((x @ x) * (y @ y)))
