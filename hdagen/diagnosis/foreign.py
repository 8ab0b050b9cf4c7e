"""Whether the robot file can be that of the logged machine: what a diagnosis bends to make its numbers fit.

Tolerances state how far the machine may be from its file. Where the best explanation needs many numbers far outside
theirs, together less likely than one in a million, it explains another machine's log, or tolerances that are too small;
an effect that is named on top of that would be a guess. What is unknown bends what it likes, and is not asked.
"""

from __future__ import annotations

from scipy.special import gammaincc  # scipy.stats would take half a second to import

from hdagen.diagnosis.fitting import Fitted

UNLIKELY = 1e-6
SHOWN = 4  # numbers that are named


def foreign(best: Fitted) -> str | None:
    """A sentence that refuses, or None: of the numbers that the robot file states with a tolerance, without those that
    a named effect moves, the sum of squares in tolerances is that of chi² if the file is right."""
    described = best.design.shooting.arm.parameters.described
    off = {
        c.parameter: float(value) / c.spike
        for c, value in zip(best.design.words.columns, best.posterior[0], strict=True)
        if c.base and c.atom not in best.atoms and described[c.parameter].tolerance > 0
    }
    if not off or gammaincc(0.5 * len(off), 0.5 * sum(z**2 for z in off.values())) >= UNLIKELY:
        return None
    first = sorted(off, key=lambda name: -abs(off[name]))[:SHOWN]
    said = ", ".join(f"{name} by {abs(off[name]):.1f}" for name in first)
    named = " and ".join(best.names) or "no effect"
    return (
        f"the robot file does not describe the machine of this log: even with {named} "
        f"its numbers would have to be off by many of their tolerances ({said}); take this machine's robot file, or "
        "state the tolerances that its numbers have."
    )
