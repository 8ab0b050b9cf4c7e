"""How numbers and their units are written: significant digits, SI prefixes, powers of ten."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

UNIT_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
# Units that take a prefix on their first part; kg carries one already and stays.
PREFIXED_UNIT = re.compile(r"(m|s|A|N|V|W|J|Hz|Pa|rad)\b")
# "name (unit)", where the unit may have brackets of its own, as rad/(N m) has.
LABEL_WITH_UNIT = re.compile(r"(.*?\S)\s*\(((?:[^()]|\([^()]*\))+)\)\s*", re.DOTALL)
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MINUS_SIGN = "\N{MINUS SIGN}"


class Quantity(NamedTuple):
    """A named axis or column: value in ``base`` units × ``factor`` is what is written beside ``unit``."""

    name: str
    unit: str
    factor: float
    base: str

    @property
    def label(self) -> str:
        """The name and, in brackets, the written unit."""
        return _format_label(self.name, self.unit)

    @property
    def base_label(self) -> str:
        """The name and, in brackets, the base unit, which is that of the data."""
        return _format_label(self.name, self.base)


def _format_label(name: str, unit: str) -> str:
    if not unit:
        return name
    return f"{name} ({unit})"


def scale_quantity(label: str, largest: float) -> Quantity:
    """Read a label and choose the prefix of its unit.

    Args:
        label: "name (unit)" or "name", the unit without a prefix.
        largest: Largest size among the values, in the unit of the label.

    Returns:
        The quantity, whose factor suits values up to ``largest``.

    """
    name, unit = label.strip(), ""
    if found := LABEL_WITH_UNIT.fullmatch(label):
        name, unit = found[1], found[2]
    if not (math.isfinite(largest) and largest > 0) or 0.1 <= largest < 1e4:
        return Quantity(name, unit, 1.0, unit)
    power = 3 * math.floor(math.log10(largest) / 3 + 1e-9)
    if PREFIXED_UNIT.match(unit) and power in UNIT_PREFIXES:
        return Quantity(name, UNIT_PREFIXES[power] + unit, 10.0**-power, unit)
    if 1e-3 <= largest < 1e5:
        return Quantity(name, unit, 1.0, unit)
    return Quantity(name, f"10{str(power).translate(SUPERSCRIPTS)} {unit}".strip(), 10.0**-power, unit)


def format_fixed(value: float, decimals: int) -> str:
    """Write a number with a true minus sign, and without a negative zero.

    Args:
        value: The number.
        decimals: Count of decimals.

    Returns:
        The text.

    """
    text = f"{value:.{decimals}f}"
    if not text.strip("-0."):
        return text.replace("-", "")
    return text.replace("-", MINUS_SIGN)


def format_number(value: float, digits: int = 4) -> str:
    """Write a number as it stands in a table.

    Args:
        value: The number; NaN is written as a dash.
        digits: Count of significant digits.

    Returns:
        The text, with a power of ten where the number is very large or very small.

    """
    if isinstance(value, int) and abs(value) < 10**9:
        return format_fixed(value, 0)
    value = float(value)
    if math.isnan(value):
        return "–"
    if value == math.inf:
        return "∞"
    if value == -math.inf:
        return MINUS_SIGN + "∞"
    if value == 0:
        return "0"
    power = int(f"{value:.{digits - 1}e}".split("e")[1])
    if -4 <= power < 6:
        return _without_zeros(format_fixed(value, max(digits - 1 - power, 0)))
    if power > -300:
        mantissa = format_fixed(value / 10.0**power, digits - 1)
    else:
        mantissa = format_fixed(value * 1e300 / 10.0 ** (power + 300), 3)
    return f"{_without_zeros(mantissa)}×10{str(power).translate(SUPERSCRIPTS)}"


def _without_zeros(text: str) -> str:
    """The number without the zeros at the end of its decimals."""
    if "." not in text:
        return text
    return text.rstrip("0").rstrip(".")
