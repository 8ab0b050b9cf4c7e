"""The contents of a two-joint reality, whichever simulator moves it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

LARGEST_COMMAND = 12.0  # A, largest command of a controller


@dataclass(frozen=True)
class ArmWorld:
    """The contents of a reality, SI. ``joints``: base parameters of each joint, the keys of robot.toml's tables in one;
    ``effects[j]``: parameters by effect of joint j (from 0); ``arm``: effects of the whole arm; ``gravity`` in the
    plane."""

    joints: Sequence[Mapping[str, float]]
    effects: Sequence[Mapping[str, Mapping[str, float]]]
    arm: Mapping[str, Mapping[str, float]]
    gravity: tuple[float, float]


def tilt_gravity(world: ArmWorld) -> tuple[float, float]:
    """Compute gravity in the plane of a base that is not level.

    Args:
        world: the true arm; its effect "gravity_tilt" tilts the base.

    Returns:
        Gravity along x and y, m/s².

    """
    x, y = world.gravity
    if "gravity_tilt" not in world.arm:
        return x, y
    p = world.arm["gravity_tilt"]
    sine, cosine = math.sin(p["angle"]), math.cos(p["angle"])
    if math.hypot(x, y) > 1.0:  # an arm that stands turns in its plane
        return cosine * x - sine * y, sine * x + cosine * y
    return x + 9.81 * sine * math.cos(p["direction"]), y + 9.81 * sine * math.sin(p["direction"])
