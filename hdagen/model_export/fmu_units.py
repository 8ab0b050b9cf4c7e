"""Units of an FMU: each unit's powers of the SI base units, read from its text."""

from __future__ import annotations

import re
from collections import Counter

DERIVED_UNITS = {  # powers of the base units; rad is one of FMI's
    "N": {"kg": 1, "m": 1, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Hz": {"s": -1},
    "J": {"kg": 1, "m": 2, "s": -2},
}
BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
POWERS = str.maketrans("²³", "23")
TOKEN = re.compile(r"(1|[A-Za-z]+)([23])?")


def find_base_powers(unit: str) -> dict[str, int] | None:
    """Find the powers of the SI base units in a unit such as "N m s²/rad" or "1/(N m)".

    Args:
        unit: The unit as the manifest of a build has it.

    Returns:
        The powers that are not 0, by base unit; None where the text is no unit of these.

    """
    total: Counter[str] = Counter()
    for sign, part in zip((1, -1), unit.partition("/")[::2], strict=True):
        for token in part.strip("()").split():
            found = TOKEN.fullmatch(token.translate(POWERS))
            if found is None:
                return None
            name, power = found[1], int(found[2] or 1)
            if name in BASE_UNITS:
                powers = {name: 1}
            elif name in DERIVED_UNITS:
                powers = DERIVED_UNITS[name]
            elif name == "1":
                powers = {}
            else:
                return None
            for base, exponent in powers.items():
                total[base] += sign * power * exponent
    return {base: total[base] for base in BASE_UNITS if total[base]}
