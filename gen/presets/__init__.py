"""The robots that ship with the project, one robot.toml each; every number in them has its source beside it."""

from __future__ import annotations

from pathlib import Path


def find_presets() -> dict[str, Path]:
    """Find the presets.

    Returns:
        The file of each preset by its name.

    """
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml"))}
