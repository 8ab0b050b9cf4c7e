"""Arms with a predictive controller, in the folder of the tests' other builds."""

from __future__ import annotations

from functools import cache

from kept_builds import find_builds

from hdagen.arm.compiled_arm import Arm, load
from hdagen.mpc.configuration import Configuration, check_configuration
from hdagen.mpc.wall import Wall

WALLS = (Wall((1.0, 0.0), 0.265, 2e4, 20.0), Wall((0.0, 1.0), 0.07))


@cache
def built(
    robot: str = "paper", profile: str = "portable", nodes: int = 20, space: str = "tip", walls: int = 2, **more: float
) -> tuple[Arm, Configuration]:
    """An arm and a configuration that fits it; ``walls`` of them (far away beyond two)."""
    c = check_configuration(
        {"mpc": {"nodes": nodes, "space": space}, "limits": {"tip_speed": 0.15, "sudden": 0.035}}, "test"
    )
    far = tuple(Wall((1.0, 0.0), 10.0 + k) for k in range(max(0, walls - 2)))
    c = c.with_changes((*WALLS[:walls], *far), **more)
    return load(robot, profile, out=find_builds(), mpc=c), c
