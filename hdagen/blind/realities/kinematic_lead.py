"""The kinematic error of a gear, which all families of drives have alike: three waves over the motor angle."""

from __future__ import annotations

import math
from collections.abc import Mapping


def compute_kinematic_lead(error: Mapping[str, float] | None, theta: float) -> tuple[float, float]:
    """Compute the kinematic error at a motor angle.

    Args:
        error: amplitudes, rad, and phases of the waves; None without a kinematic error.
        theta: motor angle, rad.

    Returns:
        The lead Δ of the joint, rad, and its slope dΔ/dθ.

    """
    lead = slope = 0.0
    if not error:
        return lead, slope
    for name, order in (("once", 1.0), ("twice", 2.0), ("fourth", 4.0)):
        angle = order * theta + error[f"{name}_phase"]
        lead += error[name] * math.sin(angle)
        slope += order * error[name] * math.cos(angle)
    return lead, slope
