"""How the C of flexible arms grows with the joints: as the numbers that it computes, and no faster."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

import casadi as ca
import pytest
from space_robots import flexible_panda

from gen.builder.build_files import count_operations, make_files
from gen.effects import ALL
from gen.model.arm_model import Model
from gen.model.function_library import Library, make_library
from gen.robot.load_robot import from_table

JOINTS = (3, 5)
EVERY_EFFECT = tuple(effect for effect in ALL if effect.series_spring is None)
GENERATED = ("hda_model", "hda_laws", "hda_prepare")  # begin the names of C files that grow with the joints


@cache
def library(joints: int) -> Library:
    """The first joints of the arm with every effect."""
    robot = from_table(tomllib.loads(flexible_panda(joints)), "robot.toml", Path("robot.toml"))
    return make_library(Model(robot, EVERY_EFFECT))


def count_entries(f: ca.Function) -> int:
    """Entries of the results that are not always 0."""
    inputs = f.sx_in()
    return sum(ca.sparsify(result).nnz() for result in f.call(inputs))


def jacobian(joints: int) -> ca.Function:
    return next(f.graph for f in library(joints).functions if f.name == "rhs_jacobian")


def test_a_derivative_takes_no_more_operations_in_a_longer_arm() -> None:
    """Each entry of the derivatives by x, u and p, wherever the joint stands."""
    few, many = (count_operations(f) / count_entries(f) for f in map(jacobian, JOINTS))
    assert many <= few


def test_the_text_grows_less_than_the_derivatives() -> None:
    """Derivatives are by far the most of it, and the only part that grows with the square of the joints."""
    effects = library(JOINTS[0]).graphs.model.effects
    sizes = []
    for joints in JOINTS:
        files = make_files(library(joints), effects, "none", {}, False)
        sizes.append(sum(len(text) for name, text in files.items() if name.startswith(GENERATED)))
    few, many = map(count_entries, map(jacobian, JOINTS))
    assert sizes[1] / sizes[0] <= many / few


@pytest.mark.parametrize("joints", JOINTS)
def test_every_effect_is_in_the_arm(joints: int) -> None:
    """None is left out."""
    model = library(joints).graphs.model
    assert model.flexible == tuple(range(1, joints + 1))
    acting = {effect.name for effect in model.effects if model.joints_of_effect(effect)}
    assert acting == {effect.name for effect in EVERY_EFFECT}
