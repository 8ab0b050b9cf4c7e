"""How large inputs and friction are that a robot file does not state, against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gen.robot.description import Robot
from gen.robot.load_robot import load
from gen.robot.typical_loads import MEANT_VELOCITY, USUAL_FRICTION_SHARE, largest_input, lifting_torque, usual_size

LINKS = """name = "two links"
gravity = [{across}, {down}]
[[joint]]
{kind}
mass = 2.0
center_of_mass = -0.1
inertia = 0.03
[joint.drive]
rigid = true
ratio = 50.0
motor_inertia = 1e-4
viscous_friction = {viscous}
coulomb_friction = {coulomb}
{drive}
[joint.limits]
{limits}
[[joint]]
length = 0.25
mass = 1.5
center_of_mass = 0.2
inertia = 0.02
[joint.drive]
rigid = true
ratio = 30.0
motor_inertia = 5e-5
viscous_friction = 0.0
coulomb_friction = 0.0
"""
REVOLUTE, PRISMATIC = "length = 0.4", 'type = "prismatic"'


def robot(tmp_path: Path, kind: str = REVOLUTE, coulomb: float = 0.0, viscous: float = 0.0, **parts: str) -> Robot:
    """Two links, the first with these lines."""
    given = {"across": "0.0", "down": "-9.81", "drive": "", "limits": ""} | parts
    path = tmp_path / "robot.toml"
    path.write_text(LINKS.format(kind=kind, coulomb=coulomb, viscous=viscous, **given))
    return load(path)


def test_a_current_reaches_the_largest_one_that_is_stated_else_10_a(tmp_path: Path) -> None:
    assert largest_input(robot(tmp_path, drive="torque_constant = 0.05\nmax_current = 3.0"), 1) == 3.0
    assert largest_input(robot(tmp_path, drive="torque_constant = 0.05", limits="torque = 7.0"), 1) == 10.0


def test_a_torque_reaches_the_limit_of_its_joint(tmp_path: Path) -> None:
    assert largest_input(robot(tmp_path, coulomb=5.0, limits="torque = 7.0"), 1) == pytest.approx(7.0 / 50.0)


def rounded(size: float) -> float:
    """The one of 1, 2, 5 and their tenths and tens that is nearest by ratio."""
    powers = np.outer(10.0 ** np.arange(-6.0, 6.0), [1.0, 2.0, 5.0]).ravel()
    return float(powers[np.abs(np.log(powers / size)).argmin()])


@pytest.mark.parametrize("across, down", [("0.0", "-9.81"), ("9.81", "0.0"), ("5.886", "7.848")])
def test_without_a_limit_it_lifts_the_stretched_arm_swiftly(tmp_path: Path, across: str, down: str) -> None:
    """Whichever way gravity points: the arm can stand across it."""
    weight = 9.81 * (2.0 * 0.1 + 1.5 * 0.6)
    inertia = 50.0**2 * 1e-4 + 0.03 + 2.0 * 0.1**2 + 0.02 + 1.5 * 0.6**2
    found = robot(tmp_path, across=across, down=down)
    own = 9.81 * 1.5 * 0.2, 900.0 * 5e-5 + 0.02 + 1.5 * 0.2**2  # what the last joint itself carries
    slides = robot(tmp_path, PRISMATIC, across=across, down=down)
    for one, j, expected in (
        (found, 1, (weight + 2.0 * inertia) / 50.0),
        (found, 2, (own[0] + 2.0 * own[1]) / 30.0),
        (slides, 1, (9.81 * 3.5 + 2.0 * (50.0**2 * 1e-4 + 3.5)) / 50.0),
    ):
        assert lifting_torque(one, j) == pytest.approx(expected)
        assert largest_input(one, j) == pytest.approx(rounded(expected))


def test_it_overcomes_friction_ten_times(tmp_path: Path) -> None:
    assert largest_input(robot(tmp_path, coulomb=0.5), 1) == pytest.approx(5.0)
    assert largest_input(robot(tmp_path, coulomb=1e-6), 1) == largest_input(robot(tmp_path), 1)


def test_friction_is_as_large_as_stated_else_a_share_of_the_largest_torque(tmp_path: Path) -> None:
    stated = robot(tmp_path, coulomb=0.02, viscous=3e-4)
    assert usual_size(stated, 1, "coulomb_friction") == 0.02 and usual_size(stated, 1, "viscous_friction") == 3e-4
    none = robot(tmp_path, drive="torque_constant = 0.05\nmax_current = 3.0")
    assert usual_size(none, 1, "coulomb_friction") == pytest.approx(USUAL_FRICTION_SHARE * 0.05 * 3.0)
    assert usual_size(none, 1, "viscous_friction") * MEANT_VELOCITY * 50.0 == pytest.approx(
        USUAL_FRICTION_SHARE * 0.05 * 3.0
    )
    assert usual_size(robot(tmp_path), 1, "coulomb_friction") == pytest.approx(
        USUAL_FRICTION_SHARE * largest_input(robot(tmp_path), 1)
    )


@pytest.mark.parametrize(
    "preset, joint, torque", [("dfki_2_0", 1, 10.0 / 6.0), ("dfki_2_0", 2, 10.0 / 6.0), ("emps", 1, 351.5)]
)
def test_the_share_is_of_the_size_of_those_of_real_drives(preset: str, joint: int, torque: float) -> None:
    """The double pendulum's limit is in its file; of the prismatic one 10 V make 351.5 N."""
    share = load(preset).joints[joint - 1].drive.coulomb_friction.nominal / torque
    assert USUAL_FRICTION_SHARE / 4 < share < 4 * USUAL_FRICTION_SHARE


@pytest.mark.parametrize(
    ("gravity", "expected"),
    [
        ((0.0, -9.81), (9.81, 0.085 * 9.81)),  # an arm that stands: half a tilt's square is lost along gravity
        ((0.0, 0.0), (9.81, 9.81)),  # one that lies flat: gravity comes in along both
        ((0.0, -6.0), (9.81, np.hypot(np.sqrt(9.81**2 - 6.0**2), 0.085 * 6.0))),  # on an incline
        ((9.9, 0.0), (0.085 * 9.9, 9.9)),
    ],
)
def test_a_tilt_brings_gravity_across_itself_and_hardly_any_along(
    tmp_path: Path, gravity: tuple[float, float], expected: tuple[float, float]
) -> None:
    made = robot(tmp_path, across=str(gravity[0]), down=str(gravity[1]))
    found = [usual_size(made, 0, f"gravity_{axis}_by_tilt") for axis in "xy"]
    assert found == pytest.approx(expected)
