"""Names that a package hands on, each imported when it is first asked for: what is not used is not loaded."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def lazy_names(
    package: str, homes: Mapping[str, Sequence[str]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The `__getattr__` and `__dir__` of a package that hands on names of its modules.

    Args:
        package: its `__name__`.
        homes: the names by the module that holds them, dotted as seen from the package.

    Returns:
        Both functions, to be assigned in the package's `__init__.py`.

    """
    places = {name: home for home, names in homes.items() for name in names}

    def find_name(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(f"{package}.{places[name]}"), name)
        vars(sys.modules[package])[name] = value
        return value

    def list_names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *places})

    return find_name, list_names
