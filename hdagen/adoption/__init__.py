"""The verdict of a diagnosis as a model to replay with, and as changes of the robot file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from hdagen.adoption.robot_update import adopt

__all__ = ["adopt"]
__getattr__, __dir__ = lazy_names(__name__, {"robot_update": ("adopt",)})
