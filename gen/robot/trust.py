"""The tolerance that the source of a number stands for, in one table with its reasons."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Source:
    """Where a number of a robot file comes from.

    Attributes:
        name: As the robot file writes it.
        tolerance: Relative standard deviation of such a number.
        reason: A phrase on why.

    """

    name: str
    tolerance: float
    reason: str


SOURCES = (
    Source("measured", 0.02, "a scale, a pendulum test or a torque stand repeats to 1 or 2 %"),
    Source("data sheet", 0.10, "data sheets give constants and inertias to ±10 %, at one temperature"),
    Source("CAD", 0.10, "CAD leaves out cables, screws and grease, and assumes densities"),
    Source("guess", 1.0, "a guess is right to a factor of 3: three times the number is two standard deviations away"),
)
TOLERANCES = {source.name: source.tolerance for source in SOURCES}
