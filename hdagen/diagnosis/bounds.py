"""The most probable parameters within bounds."""

from __future__ import annotations

import numpy as np

from hdagen.plant import Array

MOST_CHANGES = 20  # of what is held at its bounds

Bounds = tuple[Array, Array]  # lowest and highest θ (P)


def bounded(H: Array, g: Array, free: Array, bounds: Bounds) -> Array:
    """θ with the least ½ θ'Hθ − g'θ within ``bounds``, ``free`` being that without them.

    What leaves its bounds is held there, and let go again where its slope points inwards; the rest is solved anew.
    """
    low, high = bounds
    theta, held = free.copy(), np.zeros(len(free), bool)
    for _ in range(MOST_CHANGES):
        outside = ~held & ((theta < low) | (theta > high))
        slope = H @ theta - g
        back = held & np.where(theta <= low, slope < 0, slope > 0) & (low < high)
        if not outside.any() and not back.any():
            break
        held = (held & ~back) | outside
        theta = np.clip(theta, low, high)
        left = ~held
        theta[left] = np.linalg.solve(H[np.ix_(left, left)], g[left] - H[np.ix_(left, held)] @ theta[held])
    return np.clip(theta, low, high)
