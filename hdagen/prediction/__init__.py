"""A log simulated again: initial states by Kalman filters, inputs between rows, windows, and the errors that remain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from hdagen.prediction.window_replay import replay

__all__ = ["replay"]
__getattr__, __dir__ = lazy_names(__name__, {"window_replay": ("replay",)})
