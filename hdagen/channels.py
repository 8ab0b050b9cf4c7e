"""What the numbers of one channel say about its sensor: range, quantisation, noise, saturation; and how it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdagen.stretches import stretches

_RUN = 5  # rows in a row at the same extreme that count as saturated
_STILL = 0.01  # rad or m; less is compliance and control error of a joint that is held
_WINDOW = 0.015  # s, of the boxcar that smooths before differentiating


@dataclass(frozen=True)
class Channel:
    """A channel in numbers, SI.

    Its extremes, the ``step`` its values are multiples of (0: none is seen), the standard deviation of its
    ``noise`` (that of its steps at least), and the share of rows in which it is held at an extreme.
    """

    name: str
    low: float
    high: float
    step: float
    noise: float
    saturated: float

    @property
    def constant(self) -> bool:
        """Whether it never leaves one value."""
        return self.high == self.low

    @property
    def moves(self) -> bool:
        """Whether, as a position, it moves as a driven joint does, not as one that is held against the others."""
        return self.high - self.low > max(_STILL, 50 * self.noise)


def describe(name: str, values: np.ndarray) -> Channel:
    """The channel ``name`` with samples (T,)."""
    levels = np.unique(values)
    step = quantisation(levels)
    spread = max(noise(values), step / math.sqrt(12))
    return Channel(name, float(levels[0]), float(levels[-1]), step, spread, _saturated(values))


def quantisation(levels: np.ndarray) -> float:
    """The step that the sorted ``levels`` are multiples of, from the first; 0 where there is none, or too few."""
    if len(levels) < 5:
        return 0.0
    for rounding in (1e-7, 1e-9):  # float32 and text give one level several spellings, this far apart
        gaps = np.diff(levels)
        gaps = gaps[gaps > rounding * np.abs(levels).max()]
        for share in (0.0, 0.02, 0.1):  # the step is the smallest gap, unless a few rows are out of line
            step = _grid(gaps, float(np.quantile(gaps, share))) if len(gaps) >= 4 else 0.0
            if step:
                return step
    return 0.0


def _grid(gaps: np.ndarray, step: float) -> float:
    """``step`` improved, where nearly all ``gaps`` between levels are multiples of it; else 0."""
    for largest in (5, 50, 500):  # a gap of many steps shows a small error of the step, a small one none
        multiples = np.rint(gaps / step)
        near = (multiples >= 1) & (multiples <= largest)
        if not near.any():
            return 0.0
        step = float(gaps[near].sum() / multiples[near].sum())
    off = np.abs(gaps / step - np.rint(gaps / step))[near]
    return step if np.count_nonzero(near) > 0.5 * len(gaps) and np.quantile(off, 0.9) < 0.1 else 0.0


def noise(values: np.ndarray) -> float:
    """Standard deviation of white noise on a smooth signal, from its differences of order 2 to 6, robustly.

    The differences of order n of noise have the variance C(2n, n) times its own, and what the signal itself adds falls
    with the order: the smallest estimate is taken. 0 where steps hide it.
    """
    estimates = []
    for order in range(2, 7):
        differences = np.diff(values, order)
        if len(differences) < 10:
            break
        estimates.append(1.4826 * np.median(np.abs(differences)) / math.sqrt(math.comb(2 * order, order)))
    return float(min(estimates)) if estimates else 0.0


def _saturated(values: np.ndarray) -> float:
    """Share of rows in runs of at least five at the smallest or largest value, where it leaves that value at all."""
    low, high = values.min(), values.max()
    if low == high:
        return 0.0
    rows = 0
    for extreme in (low, high):
        lengths = np.diff(stretches(values == extreme))
        rows += int(lengths[lengths >= _RUN].sum())
    return rows / len(values)


@dataclass(frozen=True, eq=False)
class Even:
    """Evenly spaced instants (T,) in s over a log's time, for filters that need them."""

    time: np.ndarray
    logged: np.ndarray

    @property
    def period(self) -> float:
        """Of the samples, s."""
        return float(self.time[1] - self.time[0])

    @property
    def width(self) -> int:
        """Rows of the smoothing window."""
        return max(5, round(_WINDOW / self.period))

    def smooth(self, values: np.ndarray) -> np.ndarray:
        """The logged samples at the even instants, through two boxcars: no lag, and the same for every channel."""
        even = np.interp(self.time, self.logged, values)
        kernel = np.full(self.width, 1.0 / self.width)
        before, after = self.width // 2, self.width - 1 - self.width // 2
        for _ in range(2):
            even = np.convolve(np.pad(even, (before, after), mode="edge"), kernel, "valid")
        return even

    def rate(self, smooth: np.ndarray) -> np.ndarray:
        """Time derivative of smoothed samples."""
        return np.gradient(smooth, self.period)


def even(time: np.ndarray) -> Even:
    """Instants at the log's median period from its first to its last row."""
    period = float(np.median(np.diff(time)))
    return Even(time[0] + period * np.arange(max(2, int((time[-1] - time[0]) / period + 1.0 + 1e-6))), time)


def relation(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope of y over x about their means, and their correlation."""
    x, y = x - x.mean(), y - y.mean()
    return float(x @ y / (x @ x)), float(x @ y / math.sqrt((x @ x) * (y @ y)))
