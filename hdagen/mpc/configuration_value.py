"""One value of controller.toml against its key: the value, or the possible ones."""

from __future__ import annotations

from typing import Any

from hdagen.mpc.configuration_schema import ConfigurationKey


def convert_value(key: ConfigurationKey, value: Any) -> tuple[Any, str]:
    """Convert a value to the form in which it is used.

    Args:
        key: The key of the value.
        value: The value as controller.toml states it.

    Returns:
        The value, and "" where it is possible, else the possible ones in words.

    """
    if key.kind == "text":
        if value in key.choices:
            return value, ""
        return value, " or ".join(f'"{choice}"' for choice in key.choices)
    span = _format_span(key)
    if key.kind == "whole":
        if isinstance(value, int) and not isinstance(value, bool) and key.low <= value <= key.high:
            return value, ""
        return value, f"a whole number {span}"
    if key.kind == "number":
        if _is_in_range(key, value):
            return float(value), ""
        return None, f"a number {span}"
    if key.kind in ("axes", "joints", "turns") and not isinstance(value, list | tuple) and _is_in_range(key, value):
        return float(value), ""
    listed = isinstance(value, list | tuple) and len(value) > 0 and all(_is_in_range(key, v) for v in value)
    if listed and (key.kind != "point" or len(value) in (2, 3)):
        return tuple(float(v) for v in value), ""
    nouns = {"numbers": "a list of numbers", "point": "two numbers in brackets, in space three,"}
    return None, f"{nouns.get(key.kind, 'a number, or a list of them,')} {span}"


def _format_span(key: ConfigurationKey) -> str:
    """The range of a key in words."""
    span = f"from {key.low:g} to {key.high:g}"
    if key.open:
        span = f"more than {key.low:g} and at most {key.high:g}"
    if key.unit == "1":
        return span
    return f"{span} {key.unit}"


def _is_in_range(key: ConfigurationKey, value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return key.low <= value <= key.high and not (key.open and value == key.low)  # neither NaN nor an endless integer
