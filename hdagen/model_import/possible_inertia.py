"""Whether a body can have an inertia."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def is_possible_inertia(inertia: NDArray[np.float64], tolerance: float = 0.0) -> bool:
    """Tell whether a body can have an inertia: all principal moments above 0, and none above the sum of the others.

    Args:
        inertia: (3 × 3), about the centre of mass, kg m².
        tolerance: Share of that sum by which a moment may be above it, as numbers are rounded.

    Returns:
        Whether one can.

    """
    least, middle, most = np.linalg.eigvalsh(inertia)
    return bool(least > 0 and most <= (least + middle) * (1 + tolerance))
