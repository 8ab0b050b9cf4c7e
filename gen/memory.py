"""How fast a memory may build up where the explicit step has to carry it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca


def slowed(length: Any, speed: Any, p: Mapping[str, Any]) -> Any:
    """Displacement over which a memory builds up, no less than what ``speed`` covers in the integration's step
    (``p["memory_step"]``, s): a faster memory would be stiff, and no explicit step could tell it from one that follows
    at once."""
    return ca.fmax(length, ca.fabs(speed) * p["memory_step"])
