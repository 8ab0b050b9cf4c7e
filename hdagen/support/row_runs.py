"""Runs of consecutive rows in which a condition holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def find_true_runs(rows: ArrayLike) -> NDArray[np.intp]:
    """Find the runs of consecutive true rows.

    Args:
        rows: (T,), true where the condition holds.

    Returns:
        (S, 2): the first row of each run and the row after its last.

    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.asarray(rows, bool), [False]]).astype(np.int8)))
    return edges.reshape(-1, 2)
