"""Whether data determine what is fitted to them by least squares."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from hdagen.plant import Array

ROWS = 5  # least, for each term of a fit
TURN = 2 * np.pi


def is_determined(terms: Array) -> bool:
    """Whether a fit by the columns of ``terms`` (rows, terms) has several rows for each of them."""
    return len(terms) >= ROWS * terms.shape[1]


def resolved_orders(angle: Array, orders: Iterable[int]) -> list[int]:
    """The orders of a turn that can be fitted together to what was measured at some angles.

    Args:
        angle: (K,) of the motor, rad, not wrapped.
        orders: cycles a turn.

    Returns:
        None of them where the angles are less than a turn apart, which no order could be told from a trend in; else
        those of which half a cycle is wider than any part of the turn without an angle, and for which there are rows.

    """
    if not len(angle) or np.ptp(angle) < TURN:
        return []
    within = np.sort(np.mod(angle, TURN))
    widest = float(np.diff(within, append=within[0] + TURN).max())
    finest = min(np.pi / widest, (len(angle) / ROWS - 1) / 2)
    return [k for k in orders if k <= finest]
