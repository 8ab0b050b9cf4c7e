"""Mistakes in a log that its own numbers or the model give away, one kind a file; and their repair."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from hdagen.data_quality.log_triage import triage

__all__ = ["triage"]
__getattr__, __dir__ = lazy_names(__name__, {"log_triage": ("triage",)})
