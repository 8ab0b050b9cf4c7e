"""Draws of a robot's numbers from what a diagnosis leaves open: which effects there are, and how large each number is.

A draw takes a set of effects by its probability, then each number from the normal distribution of its value and
standard deviation, within its bounds. diagnosis.json states no covariances, so numbers are drawn independently.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdagen.adoption.verdict import NamedEffect, Verdict, apply_verdict
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.model_export.corrected_robot import CorrectedRobot

MOST_DRAWS = 10_000
_SEED = 0  # two exports of one diagnosis draw the same


@dataclass(frozen=True)
class DrawnRobots:
    """The draws, and a sentence on how they were drawn."""

    arms: tuple[Arm, ...]
    note: str


def draw_robots(robot: CorrectedRobot, count: int) -> DrawnRobots:
    """Draw robots from a diagnosis.

    Args:
        robot: The robot, with a verdict.
        count: How many.

    Returns:
        The draws.

    Raises:
        PlantError: There is no verdict.

    """
    if robot.stated is None or robot.content is None:
        raise PlantError("--samples draws from what a diagnosis leaves open; name one by --with diagnosis.json.")
    rng, model = np.random.default_rng(_SEED), robot.corrected.with_parameters(robot.corrected.p)
    model.parameters.reset()
    sets, chances, outside = _list_sets(robot)
    spreads = dict(_list_spreads(robot.content))
    arms = []
    for _ in range(count):
        chosen = sets[int(rng.choice(len(sets), p=chances))]
        kept = tuple(effect for effect in robot.stated.effects if f"{effect.name}@{effect.joint}" in chosen)
        arms.append(apply_verdict(model, _draw_verdict(replace(robot.stated, effects=kept), spreads, rng, model))[0])
    note = f"{count} draws, each number by its own standard deviation: diagnosis.json states no covariances."
    if outside > 0:
        note += f" Sets with effects outside the verdict ({100 * outside:.0f} % of the probability) are not drawn."
    return DrawnRobots(tuple(arms), note)


def _list_sets(robot: CorrectedRobot) -> tuple[list[frozenset[str]], np.ndarray, float]:
    """Sets of the verdict's effects, their probabilities, and the probability of all other sets."""
    assert robot.stated is not None and robot.content is not None
    named = frozenset(f"{effect.name}@{effect.joint}" for effect in robot.stated.effects)
    chances: dict[frozenset[str], float] = {}
    outside = 0.0
    for entry in robot.content.get("hypotheses") or []:
        effects, chance = _read_hypothesis(entry)
        if effects <= named:
            chances[effects] = chances.get(effects, 0.0) + chance
        else:
            outside += chance
    total = sum(chances.values())
    if not total > 0:
        return [named], np.ones(1), outside
    return list(chances), np.array(list(chances.values())) / total, outside


def _read_hypothesis(entry: Any) -> tuple[frozenset[str], float]:
    """The effects of a hypothesis without unknown ones, and its probability. Raises PlantError."""
    if isinstance(entry, Mapping) and isinstance(entry.get("effects"), list):
        chance = entry.get("probability")
        if isinstance(chance, int | float) and not isinstance(chance, bool) and chance >= 0:
            names = (str(name) for name in entry["effects"])
            return frozenset(name for name in names if not name.startswith("unknown@")), float(chance)
    raise PlantError("diagnosis, hypotheses: possible are objects with effects and probability; diagnose again.")


def _list_spreads(content: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Standard deviations by the model's parameter names."""
    for cause in content.get("causes") or []:
        suffix = f"_{cause['joint']}" if cause["joint"] else ""
        for name, entry in (cause.get("parameters") or {}).items():
            if (std := _read_deviation(entry)) is not None:
                yield f"{name}{suffix}", std
    for name, entry in (content.get("parameters") or {}).items():
        if (std := _read_deviation(entry)) is not None:
            yield name, std


def _read_deviation(entry: Any) -> float | None:
    std = entry.get("std") if isinstance(entry, Mapping) else None
    if isinstance(std, bool) or not isinstance(std, int | float) or not math.isfinite(std) or std < 0:
        return None
    return float(std)


def _draw_verdict(stated: Verdict, spreads: Mapping[str, float], rng: np.random.Generator, model: Arm) -> Verdict:
    """The verdict with every number drawn."""

    def draw_number(name: str, value: float) -> float:
        described = model.parameters.described.get(name)
        drawn = float(rng.normal(value, spreads.get(name, 0.0)))
        return drawn if described is None else min(max(drawn, described.low), described.high)

    effects = tuple(
        NamedEffect(one.name, one.joint, {name: draw_number(name, value) for name, value in one.parameters.items()})
        for one in stated.effects
    )
    base = {name: draw_number(name, value) for name, value in stated.base_parameters.items()}
    return replace(stated, effects=effects, base_parameters=base)
