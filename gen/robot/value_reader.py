"""One value of robot.toml against its key: the checked value, or the sentence that refuses it."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterable
from typing import Any

from gen.robot.description import Value
from gen.robot.schema import Key, Kind, keys, span


class Unfit(ValueError):
    """A value that its key does not allow; the text names the value found, the values possible, and the cure."""


def read(key: Key, raw: Any, tolerance: float) -> Any:
    """Check a value of the file against its key.

    Args:
        key: The key.
        raw: The value as parsed.
        tolerance: Relative standard deviation of the file's plain numbers.

    Returns:
        Value, a pair of Value or float, float, int, str or bool, by the key's kind.

    Raises:
        Unfit: The key does not allow the value.

    """
    match key.kind:
        case Kind.PARAMETER:
            return _parameter(key, raw, tolerance)
        case Kind.PARAMETERS:
            first, second = _two(key, raw)
            return _parameter(key, first, tolerance), _parameter(key, second, tolerance)
        case Kind.NUMBER:
            return _number(key, raw)
        case Kind.RANGE:
            low, high = (_number(key, end) for end in _two(key, raw))
            if low >= high:
                raise Unfit(f"found [{low:g}, {high:g}], possible is a low end below the high end; correct them")
            return low, high
        case Kind.WHOLE:
            if isinstance(raw, bool) or not isinstance(raw, int) or raw not in key.range:
                raise Unfit(f"found {shown(raw)}, possible is a whole number {span(key)}; correct it")
            return raw
        case Kind.FLAG:
            if not isinstance(raw, bool):
                raise Unfit(f"found {shown(raw)}, possible is true or false; write it without quotes")
            return raw
        case Kind.TEXT:
            return _text(key, raw)


def _parameter(key: Key, raw: Any, tolerance: float) -> Value:
    if not isinstance(raw, dict):
        if key.exact:
            tolerance = 0.0
        return Value(_number(key, raw), tolerance)
    if set(raw) != {"value", "tolerance"}:
        raise Unfit(f"found {shown(raw)}, possible is {{value, tolerance}} with both and nothing else; correct it")
    return Value(_number(key, raw["value"]), _number(keys("")["tolerance"], raw["tolerance"]))


def _number(key: Key, raw: Any) -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise Unfit(f"found {shown(raw)}, possible is a number {span(key)}; write a number without quotes")
    try:
        number = float(raw)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number) or number not in key.range:
        raise Unfit(f"found {shown(raw)}, possible is a number {span(key)}; correct it")
    return number


def _two(key: Key, raw: Any) -> list[Any]:
    if not isinstance(raw, list) or len(raw) != 2:
        raise Unfit(f"found {shown(raw)}, possible is a list of two numbers {span(key)}; write two in brackets")
    return raw


def _text(key: Key, raw: Any) -> str:
    if not isinstance(raw, str):
        raise Unfit(f"found {shown(raw)}, possible is text in quotes; correct it")
    if key.choices and raw not in key.choices:
        choices = " or ".join(json.dumps(choice) for choice in key.choices)
        if key.otherwise_do:
            raise Unfit(f"found {shown(raw)}, which is not among {choices}; {key.otherwise_do}")
        raise Unfit(f"found {shown(raw)}, possible is {choices}; choose one{nearest(raw, key.choices)}")
    return raw


def shown(value: Any) -> str:
    """Write a value of the file so that a sentence can hold it.

    Args:
        value: The value as parsed.

    Returns:
        One short line of text.

    """
    if value == {}:
        return "an empty table"
    if isinstance(value, dict):
        return _short("a table with " + ", ".join(named(key) for key in value))
    if isinstance(value, bool | str):
        return _short(json.dumps(value))
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, int) and value.bit_length() > 64:  # printing it may be refused
        return f"a whole number of {value.bit_length()} bits"
    return _short(str(value))


def escaped(text: str) -> str:
    """Put an escape in place of each character that a terminal obeys; a tab becomes spaces.

    Args:
        text: The text.

    Returns:
        Printable text.

    """
    return "".join(map(_escape, text.expandtabs()))


def _escape(character: str) -> str:
    if character.isprintable():
        return character
    return character.encode("unicode_escape").decode("ascii")


def named(key: str) -> str:
    """Write a key of the file so that a sentence can hold it.

    Args:
        key: The key.

    Returns:
        The key, in quotes where it is no plain word.

    """
    if re.fullmatch(r"[A-Za-z0-9_-]{1,48}", key):
        return key
    return _short(json.dumps(key))


def nearest(word: str, possible: Iterable[str]) -> str:
    """Find the most similar of the possible words.

    Args:
        word: The word found.
        possible: The words possible.

    Returns:
        The end of a sentence that suggests it; empty where none is similar.

    """
    near = difflib.get_close_matches(word[:80], list(possible), n=1)
    if near:
        return f" (did you mean {near[0]}?)"
    return ""


def _short(text: str) -> str:
    """The text, cut to 64 characters."""
    if len(text) <= 64:
        return text
    return f"{text[:61]}..."
