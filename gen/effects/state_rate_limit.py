"""The limit on how fast the state of an effect builds up where the explicit step has to carry it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca


def limit_displacement(length: Any, speed: Any, p: Mapping[str, Any]) -> Any:
    """Limit the displacement over which a state builds up from below.

    It is at least the distance that ``speed`` covers in the integration's step. A state that builds up faster would be
    stiff, and no explicit step could tell it from one that follows at once.

    Args:
        length: Displacement of the effect, rad or m.
        speed: Its rate, rad/s or m/s.
        p: The joint's parameters; ``memory_step`` is the integration's step, s.

    Returns:
        The displacement, rad or m.

    """
    return ca.fmax(length, ca.fabs(speed) * p["memory_step"])
