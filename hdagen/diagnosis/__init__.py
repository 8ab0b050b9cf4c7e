"""Diagnosis: where model and reality part, which missing structure causes it, and how far the gap shrinks with it."""

from __future__ import annotations

from hdagen.support.quiet_logger import make_quiet_logger

LOGGER = make_quiet_logger("hdagen")  # hears every step of a search; made here, for a command starts without `logging`
