"""Fewer samples, same picture: the smallest and the largest sample of every stretch are kept, and every gap."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
LARGEST_DRAWN = (
    1e37  # what lies beyond cannot be packed in 32 bits: it is a gap, and what is smaller than its inverse is 0
)


def as_samples(values: ArrayLike) -> Array:
    """Take numbers as samples of a drawing.

    Args:
        values: Numbers of any shape.

    Returns:
        A flat float array in which everything that cannot be drawn is NaN.

    """
    flat = np.asarray(values, dtype=np.float64).ravel()
    size = np.abs(flat)
    return np.where(size < LARGEST_DRAWN, np.where(size < 1 / LARGEST_DRAWN, 0.0, flat), np.nan)


def find_extreme_rows(position: Array, columns: list[Array], stretches: int) -> NDArray[np.intp]:
    """Find the rows that a drawing needs: first and last, and each column's extremes and first gap in every stretch.

    Args:
        position: Place of each row along the axis, (T,).
        columns: Curves over that axis, (T,) each; NaN is a gap.
        stretches: Count of equal parts into which the axis is cut.

    Returns:
        Rows to keep, ascending, at most 3 · len(columns) · stretches + 2.

    """
    size = position.size
    if size == 0:
        return np.zeros(0, dtype=np.intp)
    keep = np.zeros(size, dtype=bool)
    keep[[0, -1]] = True
    finite = position[np.isfinite(position)]
    share = np.zeros(size)
    if finite.size and (span := np.ptp(finite)) != 0:
        low = finite.min()
        share = (np.nan_to_num(position, nan=low) - low) / span
    stretch = np.clip((share * stretches).astype(np.intp), 0, stretches - 1)
    for column in columns:
        gaps = np.flatnonzero(np.isnan(column))
        keep[gaps[np.unique(stretch[gaps], return_index=True)[1]]] = True
        rows = np.flatnonzero(~np.isnan(column))
        if rows.size == 0:
            continue
        ordered = rows[np.lexsort((column[rows], stretch[rows]))]
        change = stretch[ordered][1:] != stretch[ordered][:-1]
        keep[ordered[np.r_[True, change]]] = True
        keep[ordered[np.r_[change, True]]] = True
    return np.flatnonzero(keep)


def choose_rows(position: Array, columns: list[Array], limit: int) -> NDArray[np.intp]:
    """Choose rows that travel with a page: the extremes of as many stretches as fit, then evenly spaced ones.

    Args:
        position: Place of each row along the axis, (T,).
        columns: Curves over that axis, (T,) each.
        limit: About how many rows to keep.

    Returns:
        Rows, ascending; all of them where there are no more than ``limit``.

    """
    if position.size <= limit:
        return np.arange(position.size)
    chosen = find_extreme_rows(position, columns, max(limit // (4 * max(len(columns), 1)), 1))
    evenly = np.linspace(0, position.size - 1, max(limit - chosen.size, 2)).round().astype(np.intp)
    return np.union1d(chosen, evenly)


def pack_floats(values: Array) -> str:
    """Pack numbers as text; seven digits are more than any figure shows.

    Args:
        values: Numbers, (T,).

    Returns:
        Little-endian 32-bit floats in base64.

    """
    return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")
