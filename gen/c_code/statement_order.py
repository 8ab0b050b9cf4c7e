"""The order of statements: those for which the result waits longest come first.

A processor looks a few hundred instructions ahead. Where the longest chain of a function stands last, its beginning
comes into sight late, and everything before it is done by then.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

CALL_CYCLES = (  # cycles, about
    ("_tanh(", 60), ("_tan(", 65), ("_atan(", 65), ("_exp(", 45), ("_sin(", 45), ("_cos(", 45), ("1.0 / ", 18),
)  # fmt: skip
SIMPLE_CYCLES = 4
ASSIGNMENT = re.compile(r"^(?:const )?\w+ (\w+)(?: = |;)")
STORE = re.compile(r"^([^ ]+) = ")


def estimate_cycles(line: str) -> int:
    """Cycles, about, of one statement."""
    return next((cycles for sign, cycles in CALL_CYCLES if sign in line), SIMPLE_CYCLES)


def measure_urgency(lines: Sequence[str], after: Mapping[str, int] | None = None) -> list[int]:
    """Estimate how long the end waits for each single assignment.

    Args:
        lines: The statements.
        after: The cycles from each place that is stored to, by its text; None: 0 each.

    Returns:
        The cycles, about, from each statement's result to the end.

    """
    made = {found[1]: k for k, line in enumerate(lines) if (found := ASSIGNMENT.match(line))}
    out = [0] * len(lines)
    for k in reversed(range(len(lines))):
        if found := STORE.match(lines[k]):
            out[k] = (after or {}).get(found[1], 0)
        for name in set(re.findall(r"\w+", lines[k])) & made.keys():
            source = made[name]
            if source != k:
                out[source] = max(out[source], out[k] + estimate_cycles(lines[k]))
    return out


def arrange_statements(lines: Sequence[str], after: Mapping[str, int] | None = None) -> list[str]:
    """Put the most urgent statements first; the values that a statement reads are always more urgent than itself.

    Args:
        lines: The statements.
        after: As for `measure_urgency`.

    Returns:
        The statements in their new order.

    """
    urgent = measure_urgency(lines, after)
    return [lines[k] for k in sorted(range(len(lines)), key=lambda k: -urgent[k])]
