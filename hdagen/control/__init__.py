"""Controllers inside their guard, and the motions that they follow."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from hdagen.control.guard_limits import Guard, Safe
    from hdagen.control.guarded_controller import Controller, Fault
    from hdagen.control.reference_motion import Reference, circle

__all__ = ["Controller", "Fault", "Guard", "Reference", "Safe", "circle"]
__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "guard_limits": ("Guard", "Safe"),
        "guarded_controller": ("Controller", "Fault"),
        "reference_motion": ("Reference", "circle"),
    },
)
