"""Whether a replay error is white: what a model that is right leaves is noise, each sample by itself.

An error within a window grows from its first row on, so nothing that is left is quite white; how much less correlated
it is after than before says whether structure is gone.

Source: Ljung, Box, Biometrika 65 (1978) 297.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.diagnosis.portion import Portion
from hdagen.plant import Array
from hdagen.replay import Replay

LAGS = 25  # rows of the test


@dataclass(frozen=True, eq=False)
class Whiteness:
    """``correlation`` (L + 1,) at lags of 0 to L rows; ``bound``: what 95 % of the lags of white noise stay within;
    ``statistic`` of Ljung and Box over LAGS lags, and ``p``, how likely white noise reaches it."""

    correlation: Array
    bound: float
    statistic: float
    p: float


def whiteness(error: Array, lags: int) -> Whiteness:
    """Of a series (T,), T > 2 ``lags``, ``lags`` at least LAGS; its mean counts as error and stays."""
    from scipy.special import gammaincc

    count = len(error)
    size = 1 << (2 * count - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(error, size)) ** 2
    products = np.fft.irfft(spectrum, size)[: lags + 1]
    r = products / products[0] if products[0] > 0 else np.r_[1.0, np.zeros(lags)]
    k = np.arange(1, LAGS + 1)
    statistic = float(count * (count + 2) * np.sum(r[1 : LAGS + 1] ** 2 / (count - k)))
    return Whiteness(r, 1.96 / np.sqrt(count), statistic, float(gammaincc(LAGS / 2, statistic / 2)))


def of_replay(replay: Replay, held: Portion, lags: int) -> dict[str, Whiteness]:
    """Of the error in what is held out of every channel that a gap is counted over; where that is blocks, one after
    another."""
    return {name: whiteness((replay.columns[name] - held.log[name])[held.rows], lags) for name in replay.channels}
