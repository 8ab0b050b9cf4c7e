"""The instants of a log's rows: as they are stamped, or evenly spaced, whichever makes the encoders' paths smoother.

A logger that stamps rows when it writes them tells the sampling instants less well than counting rows does. Short
cubics are fitted to the angles, against the stamps and against even time; a moving angle strays from them by its speed
times the error of the instant. The better clock is taken. The error that its instants still have is a noise of every
angle: the angle's speed times their standard deviation.

Legend: T rows, h period, s; K short windows of WIDTH rows, M channels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

CLOCK_WINDOW_ROWS, CLOCK_POLYNOMIAL_ORDER = 7, 3  # rows of a window, and the order of the polynomial fitted to them
MOST_CLOCK_WINDOWS = 3000  # windows at most
LEAST_CLOCK_SAMPLES = 20  # windows, rows or repeated stamps at least
LEAST_FINITE_SHARE = 0.5  # share of finite values that a channel must have
CLOCK_STANDARD_ERRORS = 4.0  # standard errors from which a clock is better, or an uncertainty is above 0
# Rows of the median on each side of a missing row: few tell two that are near apart, many average jitter
LEVEL_MEDIAN_ROWS = 6, 20
LEAST_LOG_SCATTER_GAIN = 0.04  # logarithm of the scatter (a variance) that a better clock takes away at least
SCATTER_FLOOR_SHARE = 1e-3  # share of a usual window's scatter that is added to each window's
# Variance from uncertain instants over a sensor's own, from where the uncertainty counts
LEAST_TIMING_VARIANCE_RATIO = 1.0
LEAST_SOUND_WINDOW_SHARE = 0.9  # share of windows that must be no outliers, else a channel is left out
TIMING_OUTLIER_FACTOR = 20.0  # scatter over the usual one, from where a window is an outlier
LEAST_JITTER_PERIODS = 1e-3  # periods; less is no jitter
MOST_JITTER_CORRELATION = 0.5  # correlation of an instant's error with the one before, from where errors persist
LEAST_REPEATED_STAMP_SHARE = 0.1  # share of stamps that repeat the one before, from where a clock is coarse
MOST_WINDOW_STEP_PERIODS = 2.5  # periods between two rows of a window at most


@dataclass(frozen=True, eq=False)
class Clock:
    """The instants of a log's rows.

    Attributes:
        time: (T,), s.
        uncertainty: Their standard deviation, s.
        note: A sentence on the choice; empty where the stamps are taken and seem exact.

    """

    time: np.ndarray
    uncertainty: float = 0.0
    note: str = ""


def compute_timing_noise(time: np.ndarray, values: np.ndarray, uncertainty: float) -> np.ndarray:
    """Compute the noise of an angle that uncertain instants cause.

    Args:
        time: (T,), the instants, s.
        values: (T,), the angle, rad or m.
        uncertainty: Standard deviation of an instant, s.

    Returns:
        (T,): standard deviation of the angle, its speed times that of an instant.

    """
    if not uncertainty or len(values) < 2:
        return np.zeros(len(values))
    return np.asarray(uncertainty * np.abs(np.gradient(values, time)))


def judge_clock(stamps: np.ndarray, positions: Mapping[str, np.ndarray]) -> Clock:
    """Choose between the stamps of a log and even time by the smoothness of its encoders' paths.

    Args:
        stamps: (T,), increasing, s.
        positions: (T,) each, by name, rad or m.

    Returns:
        Even instants where the paths are smoother on them, else the stamps; with the error of an instant that the
        paths still show.

    """
    even = fit_even_instants(stamps)
    channels = [
        values
        for values in positions.values()
        if np.mean(np.isfinite(values)) > LEAST_FINITE_SHARE and _has_several_values(values)
    ]
    windows = _choose_windows(even)
    if channels:
        path = np.stack(channels, 1)
        windows = windows[np.isfinite(path[windows[:, None] + np.arange(CLOCK_WINDOW_ROWS)]).all((1, 2))]
    if len(windows) < LEAST_CLOCK_SAMPLES or not channels:
        return _judge_clock_without_motion(stamps, even)
    rows = windows[:, None] + np.arange(CLOCK_WINDOW_ROWS)
    seen = path[rows]
    stamped, counted = _fit_window_scatter(stamps[rows], seen), _fit_window_scatter(even[rows], seen)
    is_even = _is_smoother(counted[0], stamped[0])
    if not is_even and not _is_smoother(stamped[0], counted[0]):
        is_even = _is_jittery(stamps, even)
    most = 0.5 * _median_period(even)
    if is_even:
        uncertainty = _estimate_timing_uncertainty(*counted, most)
        better = float(np.exp(0.5 * np.mean(_compare_scatter(stamped[0], counted[0]))))
        return Clock(even, uncertainty, _note_even_time(stamps, even, better, uncertainty))
    uncertainty = _estimate_timing_uncertainty(*stamped, most)
    if not uncertainty:
        return Clock(stamps, uncertainty)
    note = f"The encoders' paths stray as if stamps were off by {1e6 * uncertainty:.3g} us, which counts as noise."
    return Clock(stamps, uncertainty, note)


def _note_even_time(stamps: np.ndarray, even: np.ndarray, better: float, uncertainty: float) -> str:
    """Say that even time is taken, against which paths are ``better`` times as smooth."""
    jitter, left = float(np.std(stamps - even)), ""
    if uncertainty:
        left = f"; what is left of {1e6 * uncertainty:.3g} us counts as noise"
    return (
        f"The stamps jitter by {1e6 * jitter:.3g} us about an even period of {1e3 * _median_period(even):.4g} ms; the "
        f"encoders' paths are {better:.3g} times as smooth against even time, which is taken{left}."
    )


def _judge_clock_without_motion(stamps: np.ndarray, even: np.ndarray) -> Clock:
    """Choose the clock of a log whose encoders do not tell it: even time where the stamps jitter."""
    if not _is_jittery(stamps, even):
        return Clock(stamps)
    note = (
        f"The stamps jitter by {1e6 * float(np.std(stamps - even)):.3g} us about an even period of "
        f"{1e3 * _median_period(even):.4g} ms, which is taken: nothing moves by which to judge."
    )
    return Clock(even, 0.0, note)


def _is_jittery(stamps: np.ndarray, even: np.ndarray) -> bool:
    """Whether stamps stray from even instants independently, as a logger's do; a machine that is late stays late."""
    off = stamps - even - np.median(stamps - even)
    usual = float(np.median(np.abs(off)))
    if len(off) < LEAST_CLOCK_SAMPLES or usual < LEAST_JITTER_PERIODS * _median_period(even):
        return False
    off = np.clip(off, -TIMING_OUTLIER_FACTOR * usual, TIMING_OUTLIER_FACTOR * usual)
    return float(off[1:] @ off[:-1]) < MOST_JITTER_CORRELATION * float(off @ off)


def spread_repeated_stamps(stamps: np.ndarray) -> Clock | None:
    """Spread rows evenly whose stamps repeat because their clock is coarse.

    Args:
        stamps: (T,), not decreasing, s.

    Returns:
        Even instants; None where the stamps do not repeat in this way, or the rows are not even.

    """
    steps = np.diff(stamps)
    moved = steps[steps > 0]
    if np.count_nonzero(steps == 0) < max(LEAST_CLOCK_SAMPLES, LEAST_REPEATED_STAMP_SHARE * len(steps)) or not len(
        moved
    ):
        return None
    even = fit_even_instants(stamps)
    coarse = float(np.median(moved))
    if np.ptp(stamps - even) > 1.5 * coarse:
        return None
    note = (
        f"The stamps come in steps of {1e3 * coarse:.4g} ms and repeat: rows are taken as"
        f" {1e3 * _median_period(even):.4g} ms apart, by the whole log."
    )
    return Clock(even, 0.0, note)


def fit_even_instants(stamps: np.ndarray) -> np.ndarray:
    """Fit even instants to stamps, with gaps where rows are missing.

    Args:
        stamps: (T,), not decreasing, s.

    Returns:
        (T,), the instants, s.

    """
    count = len(stamps)
    tried = [
        np.arange(count),
        _count_rows_by_steps(stamps),
        *(_count_rows_by_level(stamps, rows) for rows in LEVEL_MEDIAN_ROWS),
    ]

    def cost(numbers: np.ndarray) -> float:  # Schwarz's: each gap must explain more than chance would let it
        off = float(np.mean(np.abs(stamps - _fit_line(numbers, stamps))))
        return count * np.log(off + np.finfo(float).tiny) + np.count_nonzero(np.diff(numbers) > 1) * np.log(count)

    return _fit_line(min(tried, key=cost), stamps)


def _has_several_values(values: np.ndarray) -> bool:
    """Whether a channel has more than one value."""
    known = values[np.isfinite(values)]
    return bool(np.any(known != known[0]))


def _fit_line(numbers: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """The straight line (T,) through ``stamps`` (T,) over row ``numbers`` (T,)."""
    n, t = numbers - numbers.mean(), stamps - stamps.mean()
    return np.asarray(stamps.mean() + float(n @ t) / max(float(n @ n), 1.0) * n)


def _count_rows_by_steps(stamps: np.ndarray) -> np.ndarray:
    """Number the rows (T,) by the count of usual steps between one row and the next."""
    steps = np.diff(stamps)
    usual = float(np.median(steps)) or 1.0
    return np.append(0, np.cumsum(np.maximum(np.rint(steps / usual), 1)))


def _count_rows_by_level(stamps: np.ndarray, across: int) -> np.ndarray:
    """Number the rows (T,) where stamps jitter by as much as rows are apart.

    Behind a missing row all stamps are later, which the median over ``across`` rows shows.
    """
    count = len(stamps)
    if count <= 4 * across:
        return np.arange(count)
    period = float(np.median(stamps[across:] - stamps[:-across])) / across
    late = stamps - period * np.arange(count)
    level = np.median(np.lib.stride_tricks.sliding_window_view(late, across), 1)  # of rows k … k + across − 1
    rise, missing = np.zeros(count), np.zeros(count)
    rise[across : count - across + 1] = level[across:] - level[:-across]  # from the rows before k to those from k on
    while period > 0 and (peak := float(rise.max())) > 0.5 * period:
        k, gap = int(np.argmax(rise)), float(np.rint(peak / period))
        about = slice(k - across // 2, k + across // 2)
        saved = gap * period - 2 * (late[about] - level[k - across])  # of squared error, by each row that is later
        missing[about.start + int(np.argmin(np.cumsum(saved[::-1])[::-1]))] += gap
        rise[k - across : k + across] = 0.0
    return np.arange(count) + np.cumsum(missing)


def _median_period(even: np.ndarray) -> float:
    """The time between two rows of even instants."""
    return float(np.median(np.diff(even)))


def _choose_windows(even: np.ndarray) -> np.ndarray:
    """Choose the first rows (K,) of windows without a long pause, disjoint and spread evenly over the log."""
    first = np.arange(0, len(even) - CLOCK_WINDOW_ROWS + 1, CLOCK_WINDOW_ROWS)
    if not len(first):
        return first
    longest = np.diff(even)[first[:, None] + np.arange(CLOCK_WINDOW_ROWS - 1)].max(1)
    first = first[longest < MOST_WINDOW_STEP_PERIODS * _median_period(even)]
    return first[:: max(1, -(-len(first) // MOST_CLOCK_WINDOWS))]


def _fit_window_scatter(time: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit polynomials in ``time`` (K, WIDTH) to ``seen`` (K, WIDTH, M): residual variance and squared speed (K, M)."""
    middle = time.mean(1, keepdims=True)
    size = np.ptp(time, axis=1)[:, None] / 2
    powers = ((time - middle) / size)[..., None] ** np.arange(CLOCK_POLYNOMIAL_ORDER + 1)
    basis, upper = np.linalg.qr(powers)
    coefficients = basis.swapaxes(1, 2) @ seen
    variance = ((seen - basis @ coefficients) ** 2).sum(1) / (CLOCK_WINDOW_ROWS - CLOCK_POLYNOMIAL_ORDER - 1)
    speed = np.linalg.solve(upper, coefficients)[:, 1] / size
    return variance, speed**2


def _compare_scatter(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The mean over channels of the logarithm of one clock's scatter over another's, (K,) by window."""
    least = SCATTER_FLOOR_SHARE * np.maximum(np.median(one, 0), np.median(other, 0)) + np.finfo(float).tiny
    return np.asarray(np.log((one + least) / (other + least)).mean(1))


def _is_smoother(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether the scatter (K, M) of one clock is surely below that of another."""
    ratios = _compare_scatter(one, other)
    error = float(np.std(ratios)) / np.sqrt(len(ratios))
    return float(ratios.mean()) < -max(CLOCK_STANDARD_ERRORS * error, LEAST_LOG_SCATTER_GAIN) and error > 0


def _estimate_timing_uncertainty(variance: np.ndarray, squared_speed: np.ndarray, most: float) -> float:
    """Estimate the standard deviation of an instant, s, from the growth of the scatter (K, M) with the squared speed.

    It is 0 where the growth is not significant, small beside the sensors' own scatter, or above ``most``, which is more
    than a clock's.
    """
    slopes, errors, shares = [], [], []
    for s2, v2 in zip(variance.T, squared_speed.T, strict=True):
        if np.mean(s2) < 1e-100:  # an encoder that does not scatter tells nothing, and its weight would be infinite
            continue
        usual = max(float(np.quantile(s2, 0.1)), 1e-3 * float(np.median(s2)), np.finfo(float).tiny)
        good = (s2 < TIMING_OUTLIER_FACTOR * usual) | (s2 < v2 * most**2)
        if np.mean(good) < LEAST_SOUND_WINDOW_SHARE:
            continue
        good &= v2 <= np.quantile(
            v2, LEAST_SOUND_WINDOW_SHARE
        )  # a few wrong, fast windows would decide the slope alone
        X = np.column_stack([np.ones(np.count_nonzero(good)), v2[good]])
        weight = np.ones(len(X))
        for _ in range(4):  # the scatter of a variance goes with its size
            A = X.T * weight
            covariance = np.linalg.pinv(A @ X)
            level, slope = covariance @ (A @ s2[good])
            usual = np.maximum(level, 0.0) + np.maximum(slope, 0.0) * v2[good]
            weight = 1.0 / np.maximum(usual, 1e-6 * float(np.mean(s2)) + np.finfo(float).tiny) ** 2
        error = float(np.sqrt(covariance[1, 1] * 2.0 / (CLOCK_WINDOW_ROWS - CLOCK_POLYNOMIAL_ORDER - 1)))
        if error > 0 and np.isfinite(error):
            slopes.append(slope)
            errors.append(error)
            shares.append(slope * float(np.mean(v2[good])) / max(float(level), np.finfo(float).tiny))
    if not slopes:
        return 0.0
    weights = 1.0 / np.array(errors) ** 2
    mean = float(np.average(slopes, weights=weights))
    if (
        CLOCK_STANDARD_ERRORS / float(np.sqrt(weights.sum())) < mean < most**2
        and max(shares) > LEAST_TIMING_VARIANCE_RATIO
    ):
        return float(np.sqrt(mean))
    return 0.0
