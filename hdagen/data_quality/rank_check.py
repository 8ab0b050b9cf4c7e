"""Whether data determine the terms of a least-squares fit."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK


def is_determined(terms: Array) -> bool:
    """Tell whether a fit has several rows of data for each of its terms.

    Args:
        terms: (rows, terms), the regressors of the fit.

    Returns:
        Whether there are at least five rows for each column.

    """
    return len(terms) >= CHANNEL_CHECK.least_rows_per_term * terms.shape[1]


def find_resolved_orders(angle: Array, orders: Iterable[int]) -> list[int]:
    """Choose the ripple orders that data at some angles can determine together.

    Args:
        angle: (K,) of the motor, rad, not wrapped.
        orders: Cycles a turn.

    Returns:
        None of the orders where the angles span less than a turn, for a ripple then looks like a trend. Otherwise the
        orders whose half cycle is wider than any part of the turn without an angle, and for which there are rows.

    """
    if not len(angle) or np.ptp(angle) < math.tau:
        return []
    within = np.sort(np.mod(angle, math.tau))
    widest = float(np.diff(within, append=within[0] + math.tau).max())
    finest = min(np.pi / widest, (len(angle) / CHANNEL_CHECK.least_rows_per_term - 1) / 2)
    return [k for k in orders if k <= finest]
