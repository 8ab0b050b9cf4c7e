"""Fixtures of the tests of adoption."""

from __future__ import annotations

import pytest
from uncompiled import find_settings, load_uncompiled

from hdagen.adoption import robot_update, verdict


@pytest.fixture
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Models are described and checked as ever, and not compiled."""
    for module in (verdict, robot_update):
        monkeypatch.setattr(module, "load", load_uncompiled)
    monkeypatch.setattr(robot_update, "find_stable_settings", find_settings)
