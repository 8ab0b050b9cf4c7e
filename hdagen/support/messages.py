"""Names and values as parts of a sentence: long lists cut short, the nearest name suggested, control codes escaped."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path

_MOST_NAME_CHARACTERS = 80  # characters of a name
_MOST_WANTED_NAMES, _MOST_COMPARED_NAMES = 20, 400  # names that are compared with each other
_MOST_PATH_CHARACTERS = 240  # characters of a path; its end is kept longer than its begin


def make_printable(text: object) -> str:
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


def show_value(value: object, longest: int = 60) -> str:
    """Write a value that was found in an input, for a sentence on it.

    Args:
        value: The value.
        longest: Characters of the result at most.

    Returns:
        The value as Python writes it, printable, its end left out where it is too long.

    """
    try:
        text = make_printable(repr(value))
    except ValueError:  # Python writes no integer of more than some thousand digits
        text = "a number of thousands of digits"
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def show_path(path: str | Path) -> str:
    """Write a path for a sentence on it.

    Args:
        path: The path.

    Returns:
        The path, printable, its middle left out where it is very long.

    """
    text = make_printable(path)
    if len(text) <= _MOST_PATH_CHARACTERS:
        return text
    return f"{text[:60]}…{text[60 - _MOST_PATH_CHARACTERS :]}"


def join_names(names: Sequence[str], limit: int = 40) -> str:
    """Join names by commas.

    Args:
        names: The names.
        limit: Names that are written; of more only the number is given.

    Returns:
        The names, printable, or "none".

    """
    listed = ", ".join(make_printable(name)[:_MOST_NAME_CHARACTERS] for name in names[:limit]) or "none"
    if len(names) > limit:
        listed += f" and {len(names) - limit} more"
    return listed


def join_nearest_names(wanted: Sequence[str], names: Sequence[str], limit: int = 12) -> str:
    """Join names by commas, the ones most like a wanted name first.

    Args:
        wanted: Names that were looked for.
        names: Names that exist.
        limit: Names that are written; of more only the number is given.

    Returns:
        The names as `join_names` writes them.

    """
    tried = [name[:_MOST_NAME_CHARACTERS] for name in wanted[:_MOST_WANTED_NAMES]]

    def likeness(name: str) -> float:
        return max(
            (difflib.SequenceMatcher(None, one, name[:_MOST_NAME_CHARACTERS]).ratio() for one in tried), default=0.0
        )

    return join_names(
        [*sorted(names[:_MOST_COMPARED_NAMES], key=likeness, reverse=True), *names[_MOST_COMPARED_NAMES:]], limit
    )


def suggest_name(name: str, possible: Iterable[str]) -> str:
    """Suggest the name that was probably meant.

    Args:
        name: A name that does not exist.
        possible: Names that exist.

    Returns:
        The most similar name as the end of a clause, " (did you mean …?)"; empty where none is similar.

    """
    near = difflib.get_close_matches(
        name[:_MOST_NAME_CHARACTERS], [one for one in possible if len(one) <= _MOST_NAME_CHARACTERS], n=1
    )
    if not near:
        return ""
    return f" (did you mean {make_printable(near[0])}?)"
