"""Fewer samples, same picture: the smallest and the largest sample of every stretch are kept, and every gap."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
LARGEST = 1e37  # what lies beyond cannot be packed in 32 bits: it is a gap, and what is smaller than its inverse is 0


def samples(values: ArrayLike) -> Array:
    """``values`` as a flat float array in which everything that cannot be drawn is NaN."""
    flat = np.asarray(values, dtype=np.float64).ravel()
    size = np.abs(flat)
    return np.where(size < LARGEST, np.where(size < 1 / LARGEST, 0.0, flat), np.nan)


def extremes(position: Array, columns: list[Array], stretches: int) -> NDArray[np.intp]:
    """Rows to keep, ascending: first and last, and of every stretch each column's smallest, largest and first gap.

    ``position`` (T,) places each row along the axis that is cut into ``stretches`` equal parts. At most
    3 · len(columns) · stretches + 2 rows are kept, each a sample as it was.
    """
    size = position.size
    if size == 0:
        return np.zeros(0, dtype=np.intp)
    keep = np.zeros(size, dtype=bool)
    keep[[0, -1]] = True
    finite = position[np.isfinite(position)]
    low, span = (finite.min(), np.ptp(finite)) if finite.size else (0.0, 0.0)
    share = np.zeros(size) if span == 0 else (np.nan_to_num(position, nan=low) - low) / span
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


def kept(position: Array, columns: list[Array], limit: int) -> NDArray[np.intp]:
    """About ``limit`` rows, ascending, or all: the extremes of as many stretches as fit, then evenly spaced ones."""
    if position.size <= limit:
        return np.arange(position.size)
    chosen = extremes(position, columns, max(limit // (4 * max(len(columns), 1)), 1))
    evenly = np.linspace(0, position.size - 1, max(limit - chosen.size, 2)).round().astype(np.intp)
    return np.union1d(chosen, evenly)


def packed(values: Array) -> str:
    """``values`` as base64 of little-endian 32-bit floats; seven digits are more than any figure shows."""
    return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")
