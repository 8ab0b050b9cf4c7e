"""Motions of an arm in space that keep its tip in a box or above a floor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import space_robots
from compiled import Compiled

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.excitation.motion_limits import choose_middle_posture, narrow_limits
from hdagen.excitation.motion_shapes import MotionShape
from hdagen.excitation.safe_motion import SafeRun, shrink_to_limits

LIMITS = "\n[joint.limits]\nposition = [-1.5, 1.5]\nspeed = 3.0\ntorque = 80.0\nmotor_torque_rate = 8000.0\n"
TEXT = space_robots.chain("RPRR", 11).replace("coulomb_friction = 0.0", f"coulomb_friction = 0.3{LIMITS}")
PERIOD = 1e-3


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build(TEXT).folder)


def draw_shape(n: int) -> MotionShape:
    time = np.arange(800) * PERIOD
    return MotionShape("swing", np.stack([np.sin(np.pi * time / 0.8) ** 2 * (-1) ** j for j in range(n)], 1))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_tip_stays_on_its_side_of_a_wall(arm: Arm, side: float) -> None:
    free = narrow_limits(arm)
    height = arm.evaluate("points", q=choose_middle_posture(arm, free))["points"][-1]
    wall = float(height - side * 0.02)
    bounds = narrow_limits(arm, {"tip_z": (wall, np.inf) if side > 0 else (-np.inf, wall)})
    center = choose_middle_posture(arm, bounds)
    made = shrink_to_limits(arm, [], bounds, draw_shape(arm.n), center, PERIOD)
    assert isinstance(made, SafeRun), made
    away = side * (made.simulation.tip[:, 2] - wall)
    assert away.min() > 0.0
    assert made.limit_shares["tip_z"] == pytest.approx(1.0 - away.min() / away[0], abs=1e-12)
    assert "tip_x" not in made.limit_shares and np.ptp(made.simulation.tip[:, 2]) > 1e-3


def test_the_tip_stays_in_a_box(arm: Arm) -> None:
    tip = arm.evaluate("points", q=choose_middle_posture(arm, narrow_limits(arm)))["points"][-3:]
    box = {f"tip_{axis}": (float(at) - 0.1, float(at) + 0.1) for axis, at in zip("xyz", tip, strict=True)}
    bounds = narrow_limits(arm, box)
    made = shrink_to_limits(arm, [], bounds, draw_shape(arm.n), choose_middle_posture(arm, bounds), PERIOD)
    assert isinstance(made, SafeRun), made
    assert (np.abs(made.simulation.tip - bounds.tip.mean(1)) < 0.1).all()


def test_a_joint_is_limited_by_name(arm: Arm) -> None:
    bounds = narrow_limits(arm, {"speed_axis_3": (0.5,), "position_axis_1": (-0.2, 0.3), "torque_2": (7.0,)})
    assert bounds.speed.tolist() == [3.0, 3.0, 0.5, 3.0] and bounds.torque[1] == 7.0
    assert bounds.position[0].tolist() == [-0.2, 0.3]


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"tip_z": (np.inf, -np.inf)}, "--limits tip_z: give LOW:HIGH, low first"),
        ({"tip_z": (-np.inf, np.inf)}, "--limits tip_z: give LOW:HIGH, low first"),
        ({"position_1": (0.0, np.inf)}, "--limits position_1: give LOW:HIGH, low first"),
        ({"speed_axis_9": (1.0,)}, r"--limits speed_axis_9: no such limit; .* tip_x, tip_y, tip_z\."),
    ],
)
def test_limits_that_are_none_are_refused(arm: Arm, limits: dict[str, tuple[float, ...]], says: str) -> None:
    with pytest.raises(PlantError, match=says):
        narrow_limits(arm, limits)


def test_a_box_out_of_reach_is_refused(arm: Arm) -> None:
    with pytest.raises(PlantError, match="is the tip inside tip_x, tip_y, tip_z; widen them"):
        choose_middle_posture(arm, narrow_limits(arm, {"tip_z": (50.0, np.inf)}))
