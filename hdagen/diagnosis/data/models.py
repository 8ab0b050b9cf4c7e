"""The two models of a robot that a diagnosis works with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hdagen.arm.compiled_arm import Arm, load
from hdagen.support.parallel import map_in_threads

BUILDS: tuple[tuple[str, tuple[str, ...]], ...] = (("portable", ()), ("native", ("all",)))  # profile and effects


@dataclass(frozen=True, eq=False)
class Models:
    """The two models of a robot.

    Attributes:
        robot: the preset or robot.toml that both are built from.
        nominal: the robot file's own model.
        full: the model with every effect, each of no size.

    """

    robot: str | Path
    nominal: Arm
    full: Arm


def load_models(robot: str | Path) -> Models:
    """Load both models of a robot; one that was never built is built.

    Args:
        robot: a preset or a robot.toml.

    Returns:
        The models.

    Raises:
        PlantError: a model cannot be loaded.

    """
    nominal, full = map_in_threads(lambda build: load(robot, *build), BUILDS)
    return Models(robot, nominal, full)
