"""One value of robot.toml against its key: the checked value, or the sentence that refuses it."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from gen.robot.description import Value
from gen.robot.schema import Key, ValueKind, describe_form, describe_range, keys_of
from gen.robot.trust import TOLERANCES


class InvalidValueError(ValueError):
    """A value that its key does not allow; the text names the value found, the values possible, and the cure."""


def read_entry(key: Key, raw: Any, tolerance: float) -> Any:
    """Check a value of the file against its key.

    Args:
        key: The key.
        raw: The value as parsed.
        tolerance: Relative standard deviation of the file's plain numbers.

    Returns:
        Value, a tuple of Value or float, float, int, str or bool, by the key's kind.

    Raises:
        Unfit: The key does not allow the value.

    """
    match key.kind:
        case ValueKind.PARAMETER:
            return _read_parameter(key, raw, tolerance)
        case ValueKind.PARAMETERS:
            return tuple(_read_parameter(key, entry, tolerance) for entry in _read_list(key, raw, key.lengths))
        case ValueKind.VECTOR:
            return tuple(_read_number(key, entry) for entry in _read_list(key, raw, key.lengths))
        case ValueKind.NUMBER:
            return _read_number(key, raw)
        case ValueKind.RANGE:
            low, high = (_read_number(key, end) for end in _read_list(key, raw, (2,)))
            if low >= high:
                raise InvalidValueError(
                    f"found [{low:g}, {high:g}], possible is a low end below the high end; correct them"
                )
            return low, high
        case ValueKind.WHOLE:
            if isinstance(raw, bool) or not isinstance(raw, int) or raw not in key.range:
                raise InvalidValueError(
                    f"found {show_value(raw)}, possible is a whole number {describe_range(key)}; correct it"
                )
            return raw
        case ValueKind.FLAG:
            if not isinstance(raw, bool):
                raise InvalidValueError(f"found {show_value(raw)}, possible is true or false; write it without quotes")
            return raw
        case ValueKind.TEXT:
            return _read_text(key, raw)


def _read_parameter(key: Key, raw: Any, tolerance: float) -> Value:
    if not isinstance(raw, dict):
        if key.exact:
            tolerance = 0.0
        return Value(_read_number(key, raw), tolerance)
    if set(raw) == {"value", "source"}:
        return Value(_read_number(key, raw["value"]), _read_source(raw["source"]))
    if set(raw) != {"value", "tolerance"}:
        raise InvalidValueError(
            f"found {show_value(raw)}, possible is {{value, tolerance}} or {{value, source}} with both and nothing "
            "else; correct it"
        )
    return Value(_read_number(key, raw["value"]), _read_number(keys_of("")["tolerance"], raw["tolerance"]))


def _read_source(raw: Any) -> float:
    """The tolerance that a number's source stands for."""
    if not isinstance(raw, str) or raw not in TOLERANCES:
        near = suggest_nearest(raw, TOLERANCES) if isinstance(raw, str) else ""
        raise InvalidValueError(
            f"found source {show_value(raw)}, possible is {' or '.join(map(json.dumps, TOLERANCES))}; choose one{near}"
        )
    return TOLERANCES[raw]


def _read_number(key: Key, raw: Any) -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise InvalidValueError(
            f"found {show_value(raw)}, possible is a number {describe_range(key)}; write a number without quotes"
        )
    try:
        number = float(raw)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number) or number not in key.range:
        raise InvalidValueError(f"found {show_value(raw)}, possible is a number {describe_range(key)}; correct it")
    return number


def _read_list(key: Key, raw: Any, lengths: tuple[int, ...]) -> list[Any]:
    if not isinstance(raw, list | tuple) or len(raw) not in lengths:
        form = describe_form(replace(key, lengths=lengths))
        many = form.removeprefix("list of ").removesuffix(" numbers")
        raise InvalidValueError(
            f"found {show_value(raw)}, possible is a {form} {describe_range(key)}; write {many} in brackets"
        )
    return list(raw)


def _read_text(key: Key, raw: Any) -> str:
    if not isinstance(raw, str):
        raise InvalidValueError(f"found {show_value(raw)}, possible is text in quotes; correct it")
    if key.choices and raw not in key.choices:
        choices = " or ".join(json.dumps(choice) for choice in key.choices)
        if key.advice:
            raise InvalidValueError(f"found {show_value(raw)}, which is not among {choices}; {key.advice}")
        raise InvalidValueError(
            f"found {show_value(raw)}, possible is {choices}; choose one{suggest_nearest(raw, key.choices)}"
        )
    return raw


def show_value(value: Any) -> str:
    """Write a value of the file so that a sentence can hold it.

    Args:
        value: The value as parsed.

    Returns:
        One short line of text.

    """
    if value == {}:
        return "an empty table"
    if isinstance(value, dict):
        return _cut_short("a table with " + ", ".join(quote_key(key) for key in value))
    if isinstance(value, bool | str):
        return _cut_short(json.dumps(value))
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if isinstance(value, int) and value.bit_length() > 64:  # printing it may be refused
        return f"a whole number of {value.bit_length()} bits"
    return _cut_short(str(value))


def escape_control_characters(text: str) -> str:
    """Put an escape in place of each character that a terminal obeys; a tab becomes spaces.

    Args:
        text: The text.

    Returns:
        Printable text.

    """
    return "".join(map(_escape_character, text.expandtabs()))


def _escape_character(character: str) -> str:
    if character.isprintable():
        return character
    return character.encode("unicode_escape").decode("ascii")


def quote_key(key: str) -> str:
    """Write a key of the file so that a sentence can hold it.

    Args:
        key: The key.

    Returns:
        The key, in quotes where it is no plain word.

    """
    if re.fullmatch(r"[A-Za-z0-9_-]{1,48}", key):
        return key
    return _cut_short(json.dumps(key))


def suggest_nearest(word: str, possible: Iterable[str]) -> str:
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


def _cut_short(text: str) -> str:
    """The text, cut to 64 characters."""
    if len(text) <= 64:
        return text
    return f"{text[:61]}..."
