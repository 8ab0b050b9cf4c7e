"""A robot is the same as long as its numbers are: whatever else stands in its file."""

from __future__ import annotations

import tomllib
from pathlib import Path

import arms
import pytest

from gen.robot.description import describe_robot
from gen.robot.load_robot import from_table
from hdagen.adoption.robot_identity import compute_robot_identity

EFFECTS = """[[effect]]
name = "payload"
joint = 2
payload_mass = 0.2
[[effect]]
name = "current_bias"
joint = 1
bias = 0.01
"""
TEXT = arms.arm("RR", rigid="fr") + EFFECTS
REORDERED = "".join(f"[[effect]]\n{part}" for part in reversed(EFFECTS.split("[[effect]]\n")[1:]))


def same(text: str) -> bool:
    """Whether it is the robot of `TEXT`."""
    return identified(text) == identified(TEXT)


def identified(text: str) -> str:
    return compute_robot_identity(describe_robot(from_table(tomllib.loads(text), "robot.toml", Path("robot.toml"))))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("step = 0.0005", "step = 0.0001"),
        ("step = 0.0005", ""),
        ('name = "test arm"', "# weighed again\nname = 'another label' # mine"),
        ("gravity = [0.0, -9.81]", "gravity = [0, {value = -9.81, tolerance = 0.0}]"),
        ("coulomb_friction = 0.03", "coulomb_friction = 3e-2\nfriction_smoothing = 5.0"),
        ("mass = 4.5", "mass = {value = 4.5, tolerance = 0.05}"),
        ("inertia = 0.08", f"inertia_about_joint = {{value = 0.1448, tolerance = {0.05 * 0.08 / 0.1448}}}"),
        (EFFECTS, REORDERED),
        ('[[effect]]\nname = "payload"', '[joint.limits]\nspeed = 2.0\n[[effect]]\nname = "payload"'),
        ('[[effect]]\nname = "payload"', '[joint.sensor]\ncurrent_noise = 0.1\n[[effect]]\nname = "payload"'),
    ],
)
def test_what_no_equation_of_motion_has_changes_nothing(old: str, new: str) -> None:
    assert TEXT.count(old) >= 1
    assert same(TEXT.replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("-9.81]", "-9.8]"),
        ("mass = 4.5", "mass = 4.51"),
        ("mass = 4.5", "mass = {value = 4.5, tolerance = 0.2}"),
        ("gravity", "tolerance = 0.1\ngravity"),
        ("coulomb_friction = 0.03", "coulomb_friction = 0.0300001"),
        ("torsional_damping = 6.0", "torsional_damping = 6.1"),
        ("payload_mass = 0.2", "payload_mass = 0.3"),
        (EFFECTS, ""),
    ],
)
def test_another_number_or_tolerance_is_another_robot(old: str, new: str) -> None:
    assert TEXT.count(old) >= 1
    assert not same(TEXT.replace(old, new, 1))
