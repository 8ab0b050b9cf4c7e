"""The installation that results depend on: version, own code, and the packages that decide numbers."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from hdagen.support.version import __version__

NUMBER_PACKAGES = ("casadi", "numpy", "scipy", "osqp")  # packages that results depend on
_CODE_SUFFIXES = {".py", ".c", ".h", ".txt", ".toml", ".json"}


@cache
def describe_installation() -> dict[str, str]:
    """Describe the installation of this process.

    Returns:
        By name: version of the project, hash of its code, version of Python, and versions of NUMBER_PACKAGES.

    """
    found = {
        "hdagen": __version__,
        "code": _hash_own_code(),
        "Python": f"{sys.version_info.major}.{sys.version_info.minor}",
    }
    for package in NUMBER_PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "none"
    return found


def _hash_own_code() -> str:
    """Hash the files of `hdagen` and `gen`, wherever they are installed."""
    digest = hashlib.sha256()
    for package in ("gen", "hdagen"):
        spec = importlib.util.find_spec(package)
        for folder in spec.submodule_search_locations or () if spec else ():
            for path in sorted(Path(folder).rglob("*")):
                if path.suffix in _CODE_SUFFIXES and "__pycache__" not in path.parts:
                    digest.update(f"{package}/{path.relative_to(folder).as_posix()}\n".encode())
                    digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def explain_difference(here: Mapping[str, str], there: Mapping[str, Any]) -> str:
    """Say how two installations differ.

    Args:
        here: The one that asks.
        there: The other.

    Returns:
        Part of a sentence; empty where results would be the same.

    """
    parts = []
    for name, value in here.items():
        if there.get(name) != value:
            what = f"{name} {there.get(name)} where this command has {value}"
            if name == "code":
                what = "another state of hdagen's code"
            parts.append(what)
    return ", ".join(parts)
