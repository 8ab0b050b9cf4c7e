"""Settings: tuned numbers, each with its unit, its reason and the data that it was chosen on."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

Value = TypeVar("Value")

NOT_KNOWN = "not known"


@dataclass(frozen=True)
class Setting:
    """A tuned number as documents print it.

    Attributes:
        name: Of the field in its settings class.
        value: A number, or several.
        unit: In which the value counts; "1" for a pure number.
        reason: What the number does, and why it is as large.
        chosen_on: The data that it was chosen on.

    """

    name: str
    value: Any
    unit: str
    reason: str
    chosen_on: str


def declare_setting(value: Value, unit: str, reason: str, chosen_on: str = NOT_KNOWN) -> Value:
    """Declare a field of a frozen settings class.

    Args:
        value: A number, or a tuple of numbers.
        unit: In which the value counts; "1" for a pure number.
        reason: What the number does, and why it is as large.
        chosen_on: The data that it was chosen on.

    Returns:
        The field, which type checkers see as the value.

    """
    return field(default=value, metadata={"unit": unit, "reason": reason, "chosen_on": chosen_on})


def list_settings(settings: Any) -> list[Setting]:
    """List the numbers of a settings class with all that was declared of them.

    Args:
        settings: An instance of the class.

    Returns:
        The settings, in the order of the class.

    """
    return [Setting(f.name, getattr(settings, f.name), **f.metadata) for f in fields(settings)]


def read_values(settings: Any) -> dict[str, Any]:
    """Read the numbers of a settings class as JSON has them.

    Args:
        settings: An instance of the class.

    Returns:
        Each value by its name; several numbers are a list.

    """
    values = {f.name: getattr(settings, f.name) for f in fields(settings)}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
