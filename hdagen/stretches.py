"""Stretches of rows in which something holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def stretches(rows: ArrayLike) -> NDArray[np.intp]:
    """First row of each stretch of true ``rows`` (T,) and the row after its last, (S, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.asarray(rows, bool), [False]]).astype(np.int8)))
    return edges.reshape(-1, 2)
