"""The content of a diagnosis.json, read from a file that may be damaged."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hdagen.adoption.diagnosis_schema import upgrade_content
from hdagen.arm.build_loader import PlantError
from hdagen.support.input_file import InputFileError, read_json
from hdagen.support.messages import make_printable, show_path, show_value

MOST_DIAGNOSIS_BYTES = 10_000_000  # bytes of a file


def read_content(path: Path) -> Mapping[str, Any]:
    """Read the content of a diagnosis.json.

    Args:
        path: The file.

    Returns:
        An object whose numbers are all finite; one of an earlier schema has the keys of the present one.

    Raises:
        PlantError: The file cannot be read, or a number in it is not finite.

    """
    try:
        content = read_json(path, MOST_DIAGNOSIS_BYTES, "name a diagnosis.json that hdagen diagnose wrote")
    except InputFileError as error:
        raise PlantError(error) from None
    if not isinstance(content, dict):
        raise PlantError(
            f"{show_path(path)}: found {show_value(content)}, possible is a JSON object; name a diagnosis.json."
        )
    if (where := next(find_infinite(content), None)) is not None:
        raise PlantError(f"{show_path(path)}{make_printable(where):.200}")
    return upgrade_content(content)


def find_infinite(content: Mapping[str, Any]) -> Iterator[str]:
    """Find numbers that are not finite.

    Args:
        content: Content of a JSON file.

    Yields:
        A sentence on the place of each.

    """
    left: list[tuple[str, Any]] = [("", content)]
    while left:
        where, value = left.pop()
        if isinstance(value, Mapping):
            left += [(f"{where}, {name}", entry) for name, entry in value.items()]
        elif isinstance(value, list):
            left += [(f"{where}[{k}]", entry) for k, entry in enumerate(value)]
        elif isinstance(value, int | float) and not is_finite(value):
            yield f"{where}: found {show_value(value)}, possible is a finite number; diagnose again."


def is_finite(value: float) -> bool:
    """Tell whether a number of JSON is finite.

    Args:
        value: The number, also a whole one beyond the range of floats.

    Returns:
        Whether it is.

    """
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond the doubles
        return False
