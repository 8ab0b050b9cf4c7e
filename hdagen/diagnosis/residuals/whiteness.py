"""Whether a replay error is white: the error of a correct model is noise, in which each sample is independent.

An error within a window grows from its first row on, so no replay error is quite white. How much less correlated it is
after the verdict than before tells whether structure has gone.

Source: Ljung, Box, Biometrika 65 (1978) 297.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.residuals.explanation_settings import EXPLANATION
from hdagen.prediction.window_replay import Replay


@dataclass(frozen=True, eq=False)
class Whiteness:
    """``correlation`` (L + 1) at lags of 0 to L rows; ``bound``: 95 % of the lags of white noise lie within it;
    ``statistic`` of Ljung and Box over LAGS lags; ``p``: probability that white noise reaches it."""

    correlation: Array
    bound: float
    statistic: float
    p: float


def measure_whiteness(error: Array, lags: int) -> Whiteness:
    """Test whether a series is white. Its mean counts as error and is not subtracted.

    Source: Ljung, Box, Biometrika 65 (1978) 297.

    Args:
        error: the series (T), T > 2 ``lags``.
        lags: largest lag, rows, at least LAGS.

    Returns:
        Its correlation and the test.

    """
    from scipy.special import gammaincc

    count = len(error)
    size = 1 << (2 * count - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(error, size)) ** 2
    products = np.fft.irfft(spectrum, size)[: lags + 1]
    r = np.r_[1.0, np.zeros(lags)]
    if products[0] > 0:
        r = products / products[0]
    k = np.arange(1, EXPLANATION.ljung_box_lags + 1)
    statistic = float(count * (count + 2) * np.sum(r[1 : EXPLANATION.ljung_box_lags + 1] ** 2 / (count - k)))
    return Whiteness(
        r, 1.96 / np.sqrt(count), statistic, float(gammaincc(EXPLANATION.ljung_box_lags / 2, statistic / 2))
    )


def measure_replay_whiteness(replay: Replay, held: LogPortion, lags: int) -> dict[str, Whiteness]:
    """Test the held-out replay error of every channel that the gap counts; held-out blocks are joined.

    Args:
        replay: the replay.
        held: the held-out rows.
        lags: largest lag, rows.

    Returns:
        The test by channel.

    """
    return {
        name: measure_whiteness((replay.columns[name] - held.log[name])[held.rows], lags)
        for name in replay.counted_channels
    }
