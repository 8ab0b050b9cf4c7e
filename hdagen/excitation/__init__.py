"""The next motion: safe ones, and the one that separates effects best."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from hdagen.excitation.optimal_motion import excite

__all__ = ["excite"]
__getattr__, __dir__ = lazy_names(__name__, {"optimal_motion": ("excite",)})
