"""Numbers that say how sure they are: shares, means and medians with count and 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

_Z = 1.959963984540054  # 97.5 % of a normal distribution


@dataclass(frozen=True)
class Figure:
    """``value`` over ``count`` cases, its 95 % interval from ``low`` to ``high``; NaN where there is no case."""

    value: float
    count: int
    low: float
    high: float

    def json(self) -> dict[str, float | int | None]:
        """For JSON, which has no NaN."""
        return {key: None if not math.isfinite(x) else x for key, x in asdict(self).items()}


NONE = Figure(math.nan, 0, math.nan, math.nan)


def rate(hits: Sequence[bool]) -> Figure:
    """The share of true ones, with Wilson's interval (J. Am. Stat. Assoc. 22 (1927) 209)."""
    return _share(sum(hits), len(hits))


def rates_together(parts: Sequence[Figure]) -> Figure:
    """The `rate` over the cases of all."""
    return _share(sum(round(one.value * one.count) for one in parts), sum(one.count for one in parts))


def _share(hits: int, n: int) -> Figure:
    if not n:
        return NONE
    share = hits / n
    middle = (share + _Z * _Z / (2 * n)) / (1 + _Z * _Z / n)
    half = _Z / (1 + _Z * _Z / n) * math.sqrt(share * (1 - share) / n + _Z * _Z / (4 * n * n))
    # at the ends the interval touches them exactly, which rounding must not undo
    return Figure(
        share, n, 0.0 if share == 0 else max(middle - half, 0.0), 1.0 if share == 1 else min(middle + half, 1.0)
    )


def mean(values: Sequence[float]) -> Figure:
    """The mean, with the normal interval of its standard error; of one value the interval is unknown."""
    n = len(values)
    if not n:
        return NONE
    middle = float(np.mean(values))
    half = _Z * float(np.std(values, ddof=1)) / math.sqrt(n) if n > 1 else math.nan
    return Figure(middle, n, middle - half, middle + half)


def means_together(parts: Sequence[Figure]) -> Figure:
    """The `mean` over the cases of all, from what each says of its own."""
    n = sum(one.count for one in parts)
    middle = sum(one.count * one.value for one in parts) / n
    squares = sum(one.count * (one.value - middle) ** 2 for one in parts)
    squares += sum(
        (one.count - 1) * one.count * ((one.high - one.low) / (2 * _Z)) ** 2 for one in parts if one.count > 1
    )
    half = _Z * math.sqrt(squares / (n - 1) / n) if n > 1 else math.nan
    return Figure(middle, n, middle - half, middle + half)


def median(values: Sequence[float]) -> Figure:
    """The median, with the interval between order statistics (binomial, normal approximation of the ranks)."""
    n = len(values)
    if not n:
        return NONE
    ordered = np.sort(np.asarray(values, float))
    half = 0.5 * _Z * math.sqrt(n)
    low, high = max(math.floor(0.5 * n - half), 0), min(math.ceil(0.5 * n + half), n - 1)
    return Figure(float(np.median(ordered)), n, float(ordered[low]), float(ordered[high]))
