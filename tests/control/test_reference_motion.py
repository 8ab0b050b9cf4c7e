"""Motions to follow: their derivatives, the joints that meet them, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from compiled import Compiled
from robots import chain

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller, convert_to_law_space
from hdagen.control.reference_motion import Reference, circle, convert_to_joint_motion, solve_inverse_kinematics


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build("paper").folder)


def tip(arm: Arm, q: Any) -> Array:
    return arm.evaluate("points", q=q)["points"][..., -2:]


def slopes(values: Array, h: float) -> Array:
    """Derivative by central differences of fourth order, of the rows 2 to −2."""
    return (8 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12 * h)


def test_a_circle_is_a_circle_with_its_own_derivatives() -> None:
    c = circle(0.05, (0.2, -0.1), 2.0, 3.0, 1e-3, 1.0)
    assert len(c.position) == 3000 and np.allclose(c.time, np.arange(3000) * 1e-3)
    assert np.allclose(np.linalg.norm(c.position - [0.2, -0.1], axis=1), 0.05, rtol=1e-12)
    seam = np.abs(c.time[2:-2] - 1.0) > 3e-3  # there the next derivative jumps, which differences feel
    assert np.abs(slopes(c.position, 1e-3) - c.velocity[2:-2])[seam].max() < 1e-9
    assert np.abs(slopes(c.velocity, 1e-3) - c.acceleration[2:-2])[seam].max() < 1e-8
    assert not c.velocity[0].any() and not c.acceleration[0].any()
    assert np.allclose(np.linalg.norm(c.velocity[1000:], axis=1), 0.05 * np.pi, rtol=1e-12)
    assert np.abs(np.diff(c.acceleration, axis=0)).max() < 3e-3, "no jump in acceleration"


@pytest.mark.parametrize("branch, near", [("q_positive", (0.1, 0.9)), ("q_negative", (0.1, -0.9))])
def test_posture_is_the_inverse_kinematics_branch_next_to_it(arm: Arm, branch: str, near: tuple[float, float]) -> None:
    random = np.random.default_rng(4)
    for _ in range(40):
        size, angle = random.uniform(0.05, 0.29), random.uniform(-0.5, 0.5)
        point = size * np.array([np.cos(angle), np.sin(angle)])
        q = solve_inverse_kinematics(arm, point, near)
        assert np.linalg.norm(tip(arm, q) - point) < 1e-10
        turns = (q - arm.evaluate("inverse_kinematics", point=point)[branch]) / (2 * np.pi)
        assert np.abs(turns - np.round(turns)).max() < 1e-7


@pytest.mark.parametrize("kinds", ["RR", "RPR"])
def test_the_joints_meet_position_velocity_and_acceleration(build: Callable[..., Compiled], kinds: str) -> None:
    arm = Arm(build(chain(kinds, 1)).folder)
    near = np.full(arm.n, 0.6)
    c = circle(0.03, tuple(0.9 * tip(arm, near)), 1.0, 0.6, 1e-3, 0.2)
    j = convert_to_joint_motion(arm, c, near)
    made = arm.evaluate("tip_jacobian", q=j.position, v=j.velocity)
    J = made["J"].reshape(-1, arm.n, 2).transpose(0, 2, 1)
    assert np.abs(tip(arm, j.position) - c.position).max() < 1e-10
    assert np.abs(made["tip_velocity"] - c.velocity).max() < 1e-10
    assert np.abs(np.einsum("tij,tj->ti", J, j.acceleration) + made["Jdot_v"] - c.acceleration).max() < 1e-9
    if arm.n == 2:  # where there is no freedom left, they are each other's derivatives
        seam = np.abs(c.time[2:-2] - 0.2) > 3e-3
        assert np.abs(slopes(j.position, 1e-3) - j.velocity[2:-2])[seam].max() < 1e-6
        assert np.abs(slopes(j.velocity, 1e-3) - j.acceleration[2:-2])[seam].max() < 1e-4


def test_a_law_gets_its_space(arm: Arm) -> None:
    guard = Guard(Safe.ZERO)
    c = circle(0.05, (0.2, 0.0), 1.0, 0.1)
    assert convert_to_law_space(Controller(arm, "impedance_cartesian", guard), c, (0.6, 0.6)) is c
    assert convert_to_law_space(Controller(arm, "position", guard), c, (0.6, 0.6)).space == "joint"
    with pytest.raises(PlantError, match="impedance_cartesian follows the tip; give a motion of the tip"):
        convert_to_law_space(
            Controller(arm, "impedance_cartesian", guard), convert_to_joint_motion(arm, c, (0.6, 0.6)), (0.6, 0.6)
        )


@pytest.mark.parametrize(
    "change, words",
    [
        ({"radius": 0.0}, "found radius 0.0"),
        ({"turn": np.nan, "radius": -1.0}, "found radius -1.0, turn nan"),
        ({"seconds": np.inf}, "found seconds inf"),
        ({"period": -1e-3}, "found period"),
        ({"start": 0.0}, "found start 0.0"),
        ({"center": (np.nan, 0.0)}, "center is a finite point"),
        ({"center": (0.1, 0.2, 0.3)}, "center is a finite point"),
        ({"seconds": 1e-4, "period": 1e-3}, "make no motion of 1 to 1e"),
        ({"seconds": 1e9, "period": 1e-3}, "make no motion of 1 to 1e"),
    ],
)
def test_a_wrong_circle_is_one_sentence(change: dict[str, Any], words: str) -> None:
    right = {"radius": 0.05, "center": (0.2, 0.0), "turn": 5.0, "seconds": 1.0}
    with pytest.raises(PlantError, match=words) as caught:
        circle(**{**right, **change})
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "point, near, words",
    [
        ((0.31, 0.0), (0.6, 0.6), r"does not reach \(0.31, 0\) m"),
        ((np.nan, 0.0), (0.6, 0.6), "NaN or infinity"),
        ((0.2, 0.0), (np.inf, 0.6), "NaN or infinity"),
        ((0.2, 0.0, 0.0), (0.6, 0.6), "takes a point"),
        ((0.2, 0.0), (0.6,), "2 joint positions"),
    ],
)
def test_a_wrong_posture_is_one_sentence(arm: Arm, point: Any, near: Any, words: str) -> None:
    with pytest.raises(PlantError, match=words) as caught:
        solve_inverse_kinematics(arm, point, near)
    assert len(str(caught.value).splitlines()) == 1


def test_rows_stand_side_by_side() -> None:
    parts = [np.arange(6.0).reshape(3, 2) + 10 * k for k in range(3)]
    rows = Reference("tip", 1e-3, *parts).rows()
    assert rows.flags.c_contiguous and np.array_equal(rows[1], [2, 3, 12, 13, 22, 23])
