"""Names and values as parts of a sentence: long lists cut short, the nearest name suggested, control codes escaped."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path

_LONGEST = 80  # characters of a name
_WANTED, _COMPARED = 20, 400  # names that are compared with each other
_LONGEST_PATH = 240  # characters of a path; its end is kept longer than its begin


def printable(text: object) -> str:
    """Escape the characters that a terminal obeys or does not show.

    Args:
        text: Anything; `str` is taken of it.

    Returns:
        The text with a backslash escape in place of each such character.

    """
    text = str(text)
    if text.isprintable():
        return text
    return "".join(map(_escape_character, text))


def _escape_character(character: str) -> str:
    if character.isprintable():
        return character
    return character.encode("unicode_escape").decode("ascii")


def shown(value: object, longest: int = 60) -> str:
    """Write a value that was found in an input, for a sentence on it.

    Args:
        value: The value.
        longest: Characters of the result at most.

    Returns:
        The value as Python writes it, printable, its end left out where it is too long.

    """
    try:
        text = printable(repr(value))
    except ValueError:  # Python writes no integer of more than some thousand digits
        text = "a number of thousands of digits"
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def shown_path(path: str | Path) -> str:
    """Write a path for a sentence on it.

    Args:
        path: The path.

    Returns:
        The path, printable, its middle left out where it is very long.

    """
    text = printable(path)
    if len(text) <= _LONGEST_PATH:
        return text
    return f"{text[:60]}…{text[60 - _LONGEST_PATH :]}"


def list_some(names: Sequence[str], limit: int = 40) -> str:
    """Join names by commas.

    Args:
        names: The names.
        limit: Names that are written; of more only the number is given.

    Returns:
        The names, printable, or "none".

    """
    listed = ", ".join(printable(name)[:_LONGEST] for name in names[:limit]) or "none"
    if len(names) > limit:
        listed += f" and {len(names) - limit} more"
    return listed


def list_nearest(wanted: Sequence[str], names: Sequence[str], limit: int = 12) -> str:
    """Join names by commas, the ones most like a wanted name first.

    Args:
        wanted: Names that were looked for.
        names: Names that exist.
        limit: Names that are written; of more only the number is given.

    Returns:
        The names as `list_some` writes them.

    """
    tried = [name[:_LONGEST] for name in wanted[:_WANTED]]

    def likeness(name: str) -> float:
        return max((difflib.SequenceMatcher(None, one, name[:_LONGEST]).ratio() for one in tried), default=0.0)

    return list_some([*sorted(names[:_COMPARED], key=likeness, reverse=True), *names[_COMPARED:]], limit)


def meant(name: str, possible: Iterable[str]) -> str:
    """Suggest the name that was probably meant.

    Args:
        name: A name that does not exist.
        possible: Names that exist.

    Returns:
        The most similar name as the end of a clause, " (did you mean …?)"; empty where none is similar.

    """
    near = difflib.get_close_matches(name[:_LONGEST], [one for one in possible if len(one) <= _LONGEST], n=1)
    if not near:
        return ""
    return f" (did you mean {printable(near[0])}?)"
