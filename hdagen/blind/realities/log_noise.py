"""Noise as drives and buses have it: coloured, and with rows that get lost."""

from __future__ import annotations

import math

import numpy as np

_NOISE_MEMORY = 0.6  # correlation of the noise from row to row
_LOST_SHARE = 0.004  # share of rows at which a loss begins
_MOST_LOST = 3  # rows in a loss


def color_noise(rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw noise whose neighbours are correlated.

    Args:
        rng: the random generator.
        count: how many rows.

    Returns:
        Noise of unit variance (count,).

    """
    white = rng.standard_normal(count)
    noise, value = np.empty(count), float(rng.standard_normal())
    fresh = math.sqrt(1.0 - _NOISE_MEMORY**2)
    for k, kick in enumerate(white.tolist()):
        value = _NOISE_MEMORY * value + fresh * kick
        noise[k] = value
    return noise


def choose_kept_rows(rng: np.random.Generator, count: int) -> np.ndarray:
    """Choose the rows that reach a log; the first and the last do.

    Args:
        rng: the random generator.
        count: how many rows there are.

    Returns:
        Whether each row is kept (count,).

    """
    kept = np.ones(count, bool)
    for start in np.flatnonzero(rng.random(count) < _LOST_SHARE):
        kept[start : start + int(rng.integers(1, _MOST_LOST + 1))] = False
    kept[:2] = kept[-2:] = True
    return kept
