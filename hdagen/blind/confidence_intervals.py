"""Shares, means and medians with the number of their cases and a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

_Z = 1.959963984540054  # 97.5 % of a normal distribution


@dataclass(frozen=True)
class Figure:
    """``value`` over ``count`` cases, its 95 % interval from ``low`` to ``high``; NaN without a case."""

    value: float
    count: int
    low: float
    high: float

    def as_json(self) -> dict[str, float | None]:
        """The fields as JSON takes them: JSON has no NaN."""
        return {key: finite_or_none(value) for key, value in asdict(self).items()}


def finite_or_none(value: float) -> float | None:
    """Replace a number that JSON does not have.

    Args:
        value: any number.

    Returns:
        The number itself, or None where it is not finite.

    """
    if math.isfinite(value):
        return value
    return None


NO_FIGURE = Figure(math.nan, 0, math.nan, math.nan)


def estimate_rate(hits: Sequence[bool]) -> Figure:
    """Estimate the share of hits, with Wilson's interval.

    Args:
        hits: one Boolean a case.

    Returns:
        The share with its 95 % interval; `NO_FIGURE` without a case.

    Source:
        E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.

    """
    return _wilson_interval(sum(hits), len(hits))


def pool_rates(parts: Sequence[Figure]) -> Figure:
    """Pool shares into the share over all their cases.

    Args:
        parts: shares that `estimate_rate` made of disjoint cases.

    Returns:
        The share over the cases of all parts, as `estimate_rate` would give it.

    """
    return _wilson_interval(sum(round(one.value * one.count) for one in parts), sum(one.count for one in parts))


def _wilson_interval(hits: int, n: int) -> Figure:
    if not n:
        return NO_FIGURE
    share = hits / n
    middle = (share + _Z * _Z / (2 * n)) / (1 + _Z * _Z / n)
    half = _Z / (1 + _Z * _Z / n) * math.sqrt(share * (1 - share) / n + _Z * _Z / (4 * n * n))
    low, high = max(middle - half, 0.0), min(middle + half, 1.0)
    # the exact interval touches 0 and 1 there; rounding must not undo that
    if share == 0:
        low = 0.0
    if share == 1:
        high = 1.0
    return Figure(share, n, low, high)


def estimate_paired_difference(before: Sequence[bool], after: Sequence[bool]) -> Figure:
    """Estimate the change of a share between two results on the same cases.

    Args:
        before: one Boolean a case.
        after: the same cases under another rule.

    Returns:
        The share after minus that before, with its 95 % interval; `NO_FIGURE` without a case.

    Source:
        A. Agresti, Y. Min, Stat. Med. 24 (2005) 729 (half a case is added to each cell of the table of pairs).

    """
    n = len(before)
    if not n:
        return NO_FIGURE
    gained = sum(one and not other for one, other in zip(after, before, strict=True))
    lost = sum(other and not one for one, other in zip(after, before, strict=True))
    middle = (gained - lost) / (n + 2)
    half = _Z * math.sqrt(gained + lost + 1 - (gained - lost) ** 2 / (n + 2)) / (n + 2)
    return Figure((gained - lost) / n, n, max(middle - half, -1.0), min(middle + half, 1.0))


def estimate_mean(values: Sequence[float]) -> Figure:
    """Estimate a mean, with the normal interval of its standard error.

    Args:
        values: one number a case.

    Returns:
        The mean with its 95 % interval. Of a single value the interval is NaN; without a value `NO_FIGURE`.

    """
    n = len(values)
    if not n:
        return NO_FIGURE
    middle = float(np.mean(values))
    half = math.nan
    if n > 1:
        half = _Z * float(np.std(values, ddof=1)) / math.sqrt(n)
    return Figure(middle, n, middle - half, middle + half)


def pool_means(parts: Sequence[Figure]) -> Figure:
    """Pool means into the mean over all their cases.

    Args:
        parts: means that `mean` made of disjoint cases; their intervals tell their spread.

    Returns:
        The mean over the cases of all parts, as `mean` would give it.

    """
    n = sum(one.count for one in parts)
    middle = sum(one.count * one.value for one in parts) / n
    squares = sum(one.count * (one.value - middle) ** 2 for one in parts)
    squares += sum(
        (one.count - 1) * one.count * ((one.high - one.low) / (2 * _Z)) ** 2 for one in parts if one.count > 1
    )
    half = math.nan
    if n > 1:
        half = _Z * math.sqrt(squares / (n - 1) / n)
    return Figure(middle, n, middle - half, middle + half)


def estimate_median(values: Sequence[float]) -> Figure:
    """Estimate a median, with the interval between order statistics.

    Args:
        values: one number a case.

    Returns:
        The median with its 95 % interval, from the normal approximation of the ranks; without a value `NO_FIGURE`.

    """
    n = len(values)
    if not n:
        return NO_FIGURE
    ordered = np.sort(np.asarray(values, float))
    half = 0.5 * _Z * math.sqrt(n)
    low, high = max(math.floor(0.5 * n - half), 0), min(math.ceil(0.5 * n + half), n - 1)
    return Figure(float(np.median(ordered)), n, float(ordered[low]), float(ordered[high]))
