"""Names in sentences: of many the first ones, and the one that was meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


def list_some(names: Sequence[str], limit: int = 40) -> str:
    """The names, joined; beyond ``limit`` only how many more there are."""
    shown = ", ".join(names[:limit]) or "none"
    return shown + (f" and {len(names) - limit} more" if len(names) > limit else "")


def meant(name: str, possible: Iterable[str]) -> str:
    """The most similar of ``possible`` as the end of a clause, with a space before it; empty if none is."""
    near = difflib.get_close_matches(name[:80], list(possible), n=1)
    return f" (did you mean {near[0]}?)" if near else ""
