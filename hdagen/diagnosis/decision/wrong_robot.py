"""A test whether the robot file can describe the logged machine.

Tolerances state how far the machine may be from its file. The best explanation may need many parameters far outside
their tolerances, together less likely than one in a million. Then the log is of another machine, or the tolerances are
too small, and an effect that is named on top of that would be a guess. Where the verdict names something unknown, the
caller does not use this test: an unknown torque bends the base parameters.
"""

from __future__ import annotations

from scipy.special import gammaincc  # scipy.stats would take half a second to import

from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.inference.local_fit import Fit


def refuse_wrong_robot(best: Fit) -> str | None:
    """Refuse a robot file whose parameters are too far outside their tolerances.

    If the file is right, the sum of squares of its deviations in tolerances is distributed as chi². Parameters that a
    named effect moves do not count.

    Args:
        best: the best fit.

    Returns:
        The sentence that refuses, or None where the file can be right.

    """
    described = best.sensitivities.shooting.arm.parameters.described
    off = {
        c.parameter: float(value) / c.spike_width
        for c, value in zip(best.sensitivities.candidates.columns, best.posterior[0], strict=True)
        if c.in_every_hypothesis and c.candidate not in best.effects and described[c.parameter].tolerance > 0
    }
    if not off or gammaincc(0.5 * len(off), 0.5 * sum(z**2 for z in off.values())) >= DECISION.least_file_probability:
        return None
    first = sorted(off, key=lambda name: -abs(off[name]))[: DECISION.most_shown_parameters]
    deviations = ", ".join(f"{name} by {abs(off[name]):.1f}" for name in first)
    named = " and ".join(best.names) or "no effect"
    return (
        f"the robot file does not describe the machine of this log: even with {named} its numbers would have to be off"
        f" by many of their tolerances ({deviations}); take this machine's robot file, or state the tolerances that its"
        " numbers have."
    )
