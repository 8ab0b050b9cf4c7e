"""Names and values in sentences: of many the first ones, the one that was meant, and nothing that a terminal obeys."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path

_LONGEST = 80  # characters of a name
_WANTED, _COMPARED = 20, 400  # names that are held against each other
_LONGEST_PATH = 240  # characters of a path, of which the end tells more


def printable(text: object) -> str:
    """The text with an escape in place of each character that a terminal obeys or does not show."""
    text = str(text)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def shown(value: object, longest: int = 60) -> str:
    """A value that was found, as Python writes it: printable, of at most ``longest`` characters."""
    try:
        text = printable(repr(value))
    except ValueError:  # Python writes no integer of more than some thousand digits
        text = "a number of thousands of digits"
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def shown_path(path: str | Path) -> str:
    """A path that can be printed, its middle left out where it is very long."""
    text = printable(path)
    return text if len(text) <= _LONGEST_PATH else f"{text[:60]}…{text[60 - _LONGEST_PATH :]}"


def list_some(names: Sequence[str], limit: int = 40) -> str:
    """The names, joined and printable; beyond ``limit`` only how many more there are."""
    listed = ", ".join(printable(name)[:_LONGEST] for name in names[:limit]) or "none"
    return listed + (f" and {len(names) - limit} more" if len(names) > limit else "")


def list_nearest(wanted: Sequence[str], names: Sequence[str], limit: int = 12) -> str:
    """As `list_some`, those that are most like one of the ``wanted`` first."""
    tried = [name[:_LONGEST] for name in wanted[:_WANTED]]

    def likeness(name: str) -> float:
        return max((difflib.SequenceMatcher(None, one, name[:_LONGEST]).ratio() for one in tried), default=0.0)

    return list_some([*sorted(names[:_COMPARED], key=likeness, reverse=True), *names[_COMPARED:]], limit)


def meant(name: str, possible: Iterable[str]) -> str:
    """The most similar of ``possible`` as the end of a clause, with a space before it; empty if none is."""
    near = difflib.get_close_matches(name[:_LONGEST], [one for one in possible if len(one) <= _LONGEST], n=1)
    return f" (did you mean {printable(near[0])}?)" if near else ""
