"""The robot files that ship with the project."""

from __future__ import annotations

from pathlib import Path


def find_preset_files() -> dict[str, Path]:
    """Find the presets.

    Returns:
        The robot file of each preset by its name, sorted.

    """
    folder = Path(__file__).parents[2] / "gen" / "presets"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
