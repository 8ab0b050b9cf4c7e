"""The bars that a check of each kind has to reach: a figure, its limit, and whether that is the most or the least."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hdagen.blind.confidence_intervals import Figure
from hdagen.blind.realities.population import MODEL, Population


@dataclass(frozen=True)
class Bar:
    """``figure`` must be at least (or, ``most``, at most) ``value``."""

    figure: str
    value: float
    most: bool = False

    def is_met_by(self, found: Figure) -> bool:
        """Tell whether a figure reaches the bar; its interval does not count.

        Args:
            found: the measured figure, in the unit of the bar.

        Returns:
            True where the figure's value is on the right side of the bar, or on it.

        """
        if self.most:
            return found.value <= self.value
        return found.value >= self.value


_COMMON_BARS = (
    Bar("closed", 0.9),
    Bar("achieved", 0.9),
    Bar("worse", 0.0, most=True),
    Bar("seconds", 20.0, most=True),
    Bar("failed", 0.0, most=True),
)
_LARGE_BACKGROUND = 0.08  # of usual sizes, from which fewer have to be right
_SURE_BARS = (Bar("sure_and_wrong", 0.02, most=True),)
BARS: Mapping[str, tuple[Bar, ...]] = {
    "single": (
        Bar("effect", 0.97),
        Bar("joint", 0.98),
        Bar("place", 0.98),
        Bar("p_truth", 0.9),
        Bar("sure", 0.85),
        *_SURE_BARS,
        *_COMMON_BARS,
    ),
    "background": (
        Bar("effect", 0.94),
        Bar("calibration_error", 0.05, most=True),
        Bar("sure", 0.8),
        *_SURE_BARS,
        *_COMMON_BARS,
    ),
    "none": (Bar("false_alarm", 0.01, most=True), *_COMMON_BARS[2:]),
    "unknown": (Bar("unknown_found_at_joint", 0.9), *_COMMON_BARS[2:]),
    "unknown+one": (Bar("both_said", 0.8), *_COMMON_BARS[2:]),
    "pair": (Bar("pair_f1", 0.9), *_COMMON_BARS),
    "rough": (Bar("numbers_right", 0.85), Bar("effect_beside", 0.85), *_SURE_BARS, *_COMMON_BARS),
    "task": (Bar("effect", 0.8), Bar("confounded_where_wrong", 0.95), *_COMMON_BARS),
    "joint": (
        Bar("named", 0.9),
        Bar("sizes_within", 0.9),
        Bar("after_within", 0.9),
        Bar("sure_and_wrong", 0.02, most=True),
        *_COMMON_BARS[2:],
    ),
}


MODEL_BARS: Mapping[str, tuple[Bar, ...]] = {  # of a model in space with up to 12 joints
    "single": (
        Bar("effect", 0.9),
        Bar("joint", 0.97),
        *_SURE_BARS,
        Bar("closed", 0.85),
        Bar("seconds", 180.0, most=True),
        Bar("failed", 0.0, most=True),
    ),
    "none": (Bar("false_alarm", 0.02, most=True), Bar("seconds", 180.0, most=True), Bar("failed", 0.0, most=True)),
}


def find_bars(population: Population) -> tuple[Bar, ...]:
    """Find the bars of a population.

    Args:
        population: family, kind, background and model.

    Returns:
        The bars of its kind; one effect over a background has those of the background, and over a large one fewer
        effects have to be right.

    """
    if population.family == MODEL:
        return MODEL_BARS[population.kind]
    background = population.background or 0.0
    if population.kind not in ("single", "background") or (population.kind == "single" and not background):
        return BARS[population.kind]
    if background < _LARGE_BACKGROUND:
        return BARS["background"]
    return (Bar("effect", 0.9), *BARS["background"][1:])
