"""How numbers and their units are written: significant digits, SI prefixes, powers of ten."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
# Units that take a prefix on their first part; kg carries one already and stays.
PREFIXED = re.compile(r"(m|s|A|N|V|W|J|Hz|Pa|rad)\b")
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MINUS = "\N{MINUS SIGN}"


class Quantity(NamedTuple):
    """A named axis or column: value in ``base`` units × ``factor`` is what is written beside ``unit``."""

    name: str
    unit: str
    factor: float
    base: str

    @property
    def label(self) -> str:
        """The name and, in brackets, the written unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def base_label(self) -> str:
        """The name and, in brackets, the base unit, which is that of the data."""
        return f"{self.name} ({self.base})" if self.base else self.name


def quantity(label: str, largest: float) -> Quantity:
    """``label`` is "name (unit)" or "name"; the prefix suits values up to ``largest`` in base units."""
    found = re.fullmatch(r"(.*\S)\s*\(([^()]+)\)\s*", label, re.DOTALL)
    name, unit = (found[1], found[2]) if found else (label.strip(), "")
    if not (math.isfinite(largest) and largest > 0) or 0.1 <= largest < 1e4:
        return Quantity(name, unit, 1.0, unit)
    power = 3 * math.floor(math.log10(largest) / 3 + 1e-9)
    if PREFIXED.match(unit) and power in PREFIXES:
        return Quantity(name, PREFIXES[power] + unit, 10.0**-power, unit)
    if 1e-3 <= largest < 1e5:
        return Quantity(name, unit, 1.0, unit)
    return Quantity(name, f"10{str(power).translate(RAISED)} {unit}".strip(), 10.0**-power, unit)


def fixed(value: float, decimals: int) -> str:
    """``value`` with ``decimals`` decimals, a true minus sign, and no negative zero."""
    text = f"{value:.{decimals}f}"
    return text.replace("-", "" if not text.strip("-0.") else MINUS)


def number(value: float, digits: int = 4) -> str:
    """``value`` with ``digits`` significant digits, as it stands in a table; NaN is a dash."""
    if isinstance(value, int) and abs(value) < 10**9:
        return fixed(value, 0)
    value = float(value)
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else MINUS + "∞"
    if value == 0:
        return "0"
    power = int(f"{value:.{digits - 1}e}".split("e")[1])
    if -4 <= power < 6:
        text = fixed(value, max(digits - 1 - power, 0))
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa = (
        fixed(value / 10.0**power, digits - 1) if power > -300 else fixed(value * 1e300 / 10.0 ** (power + 300), 3)
    )
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return f"{mantissa}×10{str(power).translate(RAISED)}"
