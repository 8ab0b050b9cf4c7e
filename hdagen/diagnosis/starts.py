"""Where a search begins for shapes that the log itself suggests: walls at the ends of the range, orders of a ripple."""

from __future__ import annotations

from hdagen.log import Log
from hdagen.plant import Arm

WALLS = (0.1, 0.3)  # shares of a joint's range from its ends


def starts(arm: Arm, log: Log) -> dict[str, tuple[float, ...]]:
    """Values by shape parameter."""
    found: dict[str, tuple[float, ...]] = {}
    for j in range(1, arm.n + 1):
        ratio = arm.parameters[f"ratio_{j}"]
        q = log[f"joint_position_{j}"] if f"joint_position_{j}" in log else log[f"motor_position_{j}"] / ratio
        low, span = float(q.min()), float(q.max() - q.min())
        if f"contact_above_{j}" in arm.parameters:
            found[f"contact_above_{j}"] = tuple(low + span * (1 - share) for share in WALLS)
            found[f"contact_below_{j}"] = tuple(low + span * share for share in WALLS)
    return found
