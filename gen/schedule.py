"""The order of statements: first whatever the result waits for longest.

A processor looks a few hundred instructions ahead. Where the longest chain of a function stands last, its beginning
comes into sight late, and everything before it is done by then.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

WAIT = (  # cycles, about
    ("_tanh(", 60), ("_tan(", 65), ("_atan(", 65), ("_exp(", 45), ("_sin(", 45), ("_cos(", 45), ("1.0 / ", 18),
)  # fmt: skip
SIMPLE = 4
MADE = re.compile(r"^(?:const )?\w+ (\w+)(?: = |;)")
STORED = re.compile(r"^([^ ]+) = ")


def wait(line: str) -> int:
    """Cycles, about, of one statement."""
    return next((cycles for sign, cycles in WAIT if sign in line), SIMPLE)


def urgency(lines: Sequence[str], after: Mapping[str, int] | None = None) -> list[int]:
    """For each single assignment the cycles, about, from its result to the end.

    ``after``: the same for places that are stored to, by their text.
    """
    made = {found[1]: k for k, line in enumerate(lines) if (found := MADE.match(line))}
    out = [0] * len(lines)
    for k in reversed(range(len(lines))):
        if found := STORED.match(lines[k]):
            out[k] = (after or {}).get(found[1], 0)
        for name in set(re.findall(r"\w+", lines[k])) & made.keys():
            source = made[name]
            if source != k:
                out[source] = max(out[source], out[k] + wait(lines[k]))
    return out


def arrange(lines: Sequence[str], after: Mapping[str, int] | None = None) -> list[str]:
    """The statements, most urgent first; what a statement reads is always more urgent than itself."""
    urgent = urgency(lines, after)
    return [lines[k] for k in sorted(range(len(lines)), key=lambda k: -urgent[k])]
