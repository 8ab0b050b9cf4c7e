"""A JSON Schema applied to a document: the keywords that this project's schemas use, and no other."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

KINDS: dict[str, tuple[type, ...]] = {
    "object": (Mapping,),
    "array": (list,),
    "string": (str,),
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "null": (type(None),),
}
NOTES = {"$schema", "$defs", "title", "description", "default"}  # keywords that ask for nothing


def is_kind(value: Any, kind: str) -> bool:
    return isinstance(value, KINDS[kind]) and (kind == "boolean" or not isinstance(value, bool))


def violations(value: Any, schema: Any, root: Mapping[str, Any] | None = None, place: str = "$") -> list[str]:
    """What of the document ``value`` the schema does not allow, a line each."""
    if isinstance(schema, bool):
        return [] if schema else [f"{place}: may not be there"]
    root = schema if root is None else root
    found: list[str] = []
    for keyword, wanted in schema.items():
        if keyword == "$ref":
            found += violations(value, root["$defs"][wanted.rpartition("/")[2]], root, place)
        elif keyword in ("anyOf", "oneOf"):
            tried = [violations(value, one, root, place) for one in wanted]
            good = sum(not one for one in tried)
            if good < 1 or (keyword == "oneOf" and good > 1):
                found.append(f"{place}: {good} of {keyword}; {min(tried, key=len)[:3]}")
        elif keyword == "if":
            branch = "else" if violations(value, wanted, root, place) else "then"
            found += violations(value, schema.get(branch, True), root, place)
        elif keyword not in ("then", "else") and keyword not in NOTES:
            found += broken_keyword(keyword, wanted, value, schema, root, place)
    return found


def broken_keyword(
    keyword: str, wanted: Any, value: Any, schema: Mapping[str, Any], root: Mapping[str, Any], place: str
) -> list[str]:
    """The same of one keyword that looks at the value itself; KeyError for one that is not known here."""
    size = value if is_kind(value, "number") else None
    length = len(value) if isinstance(value, str | list) else None
    table = value if isinstance(value, Mapping) else {}
    own = schema.get("properties", {})
    nested: dict[str, Callable[[], list[tuple[str, Any, Any]]]] = {
        "properties": lambda: [(k, v, wanted[k]) for k, v in table.items() if k in wanted],
        "additionalProperties": lambda: [(k, v, wanted) for k, v in table.items() if k not in own],
        "items": lambda: [(str(k), v, wanted) for k, v in enumerate(value if isinstance(value, list) else [])],
    }
    if keyword in nested:
        each = [violations(v, one, root, f"{place}.{k}") for k, v, one in nested[keyword]()]
        return [line for lines in each for line in lines]
    rules: dict[str, Callable[[], bool]] = {
        "type": lambda: is_kind(value, wanted),
        "const": lambda: value == wanted and isinstance(value, bool) == isinstance(wanted, bool),
        "enum": lambda: value in wanted,
        "pattern": lambda: not isinstance(value, str) or re.search(wanted, value) is not None,
        "minimum": lambda: size is None or bool(size >= wanted),
        "maximum": lambda: size is None or bool(size <= wanted),
        "exclusiveMinimum": lambda: size is None or bool(size > wanted),
        "minLength": lambda: length is None or length >= wanted,
        "maxLength": lambda: length is None or length <= wanted,
        "minItems": lambda: length is None or length >= wanted,
        "maxItems": lambda: length is None or length <= wanted,
        "required": lambda: set(wanted) <= table.keys() or not isinstance(value, Mapping),
    }
    return [] if rules[keyword]() else [f"{place}: {str(value)[:60]} against {keyword} {wanted}"]
