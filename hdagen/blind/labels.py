"""The words for populations and for the figures of a check, in the order in which they are shown."""

from __future__ import annotations

import math
from pathlib import Path

from hdagen.blind.confidence_intervals import Figure
from hdagen.blind.realities.population import DRIVETRAIN, FRICTION_KIND, JOINT, MAXWELL, MODEL, Population

KIND_TITLES = {
    "single": "one effect",
    "background": "one effect over a background of every other",
    "none": "no effect",
    "unknown": "an effect outside the dictionary",
    "unknown+one": "one effect beside another outside the dictionary",
    "pair": "two effects",
    "rough": "a robot file with wrong numbers",
    "task": "one effect on a circle task",
    FRICTION_KIND: "real joints' friction",
}
FAMILY_TITLES = {
    DRIVETRAIN: "arms in MuJoCo",
    MAXWELL: "arms of another simulator",
    JOINT: "joints at joint scale",
    MODEL: "an imported model",
}


def describe_population(population: Population) -> str:
    """Describe a population in words.

    Args:
        population: family, kind and background.

    Returns:
        The kind, and family and background where they are not the usual ones.

    """
    words = [KIND_TITLES[population.kind]]
    if population.family != DRIVETRAIN and population.kind != FRICTION_KIND:
        words.append(FAMILY_TITLES[population.family])
    if population.model:
        words.append(Path(population.model).name)
    if population.background is not None:
        words.append(f"background {100 * population.background:g} %")
    return ", ".join(words)


FIGURE_LABELS = {
    "effect": "effect right",
    "effect_and_joint": "effect and joint right",
    "joint": "joint right",
    "place": "place right",
    "top3": "truth among the first three",
    "both_said": "the effect named and unknown said at its joint",
    "unknown_said_at_joint": "unknown said at its joint",
    "numbers_right": "every wrong number named with its factor",
    "number_right": "a wrong number named with its factor",
    "effect_beside": "the effect beside wrong numbers named",
    "named": "what is there named, nothing else",
    "sizes_within": "sizes within 15 %, of those named",
    "after_within": "gap at most 1.3 times that with what is true",
    "pair_f1": "F1 of two effects",
    "pair_both": "both effects right",
    "unknown_found": "unknown called unknown",
    "unknown_found_at_joint": "unknown called unknown, at its joint",
    "remainder": "unknown said beside what is named",
    "false_alarm": "false alarms",
    "p_truth": "mean probability on the truth",
    "brier": "Brier score",
    "calibration_error": "calibration error",
    "sure": "called sure",
    "sure_and_wrong": "sure and wrong",
    "confounded_where_wrong": "truth among the confounded where wrong",
    "closed": "gap closed on held-out motion, median",
    "achieved": "gap closed, of what a flexible correction closes, median",
    "worse": "worse than before",
    "seconds": "seconds a diagnosis, median",
    "failed": "failed",
}
_NOT_SHARES = {"brier": "", "seconds": " s"}  # units of the figures that are not shares


def format_figure(name: str, figure: Figure) -> str:
    """Format a figure with its interval.

    Args:
        name: key of `FIGURE_LABELS`; it decides the unit.
        figure: value and 95 % interval; a share lies between 0 and 1.

    Returns:
        Value, unit and interval in words; a share in %, the duration of a diagnosis in s.

    """
    scale, unit = 100.0, " %"
    if name in _NOT_SHARES:
        scale, unit = 1.0, _NOT_SHARES[name]
    value = f"{scale * figure.value:.3g}{unit}"
    if not (math.isfinite(figure.low) and math.isfinite(figure.high)):
        return value
    return f"{value} ({scale * figure.low:.3g} to {scale * figure.high:.3g})"
