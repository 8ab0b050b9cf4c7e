"""Quadratic minimization within bounds."""

from __future__ import annotations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.fit_settings import FIT

Bounds = tuple[Array, Array]  # lowest and highest θ (P)


def solve_box_qp(H: Array, g: Array, free: Array, bounds: Bounds) -> Array:
    """Minimize ½ θ'Hθ − g'θ within bounds by an active set. A parameter that leaves its bounds is held there, and
    released where its slope points inwards; the others are solved again.

    Args:
        H: symmetric, positive definite (P, P).
        g: right-hand side (P).
        free: the minimum without bounds (P).
        bounds: lowest and highest θ (P each).

    Returns:
        θ (P).

    """
    low, high = bounds
    theta, held = free.copy(), np.zeros(len(free), bool)
    for _ in range(FIT.most_active_set_changes):
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
