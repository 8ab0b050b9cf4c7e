"""The version of hdagen, which pyproject.toml and CITATION.cff repeat."""

from __future__ import annotations

__version__ = "0.1.0"
