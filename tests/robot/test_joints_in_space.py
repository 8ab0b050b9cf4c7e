"""The long form of robot.toml: what it gives, and one sentence for each thing that is wrong with it."""

from __future__ import annotations

import copy
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import space_robots
from json_schemas import violations

from gen.robot.description import Robot, RobotError, SpatialLink, describe_robot
from gen.robot.json_schema import build_json_schema
from gen.robot.link_geometry import make_rotation
from gen.robot.load_robot import from_table
from gen.robot.mass_matrix import find_singular_pose, mass_matrix
from gen.robot.model_parameters import list_parameters
from gen.robot.schema import TABLE, Key

SCHEMA = build_json_schema()
GOOD: dict[str, Any] = tomllib.loads(space_robots.chain("RPR", 5))
BEYOND_SCHEMA = ("found the length", "principal moments", "as at joint[1]", "letters, digits")  # not JSON Schema's


def built(table: dict[str, Any]) -> Robot:
    return from_table(table, "robot.toml", Path("robot.toml"))


def changed(place: str, value: Any) -> dict[str, Any]:
    """A robot in order with one key set, or removed where ``value`` is ...."""
    table = copy.deepcopy(GOOD)
    *path, last = re.findall(r"[a-z_]+|\d+", place)
    inner: Any = table
    for step in path:
        inner = inner[int(step) - 1] if step.isdigit() else inner.setdefault(step, {})
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return table


def test_a_joint_in_space_is_read() -> None:
    robot = built(GOOD)
    assert robot.in_space and robot.tip is not None and robot.joints[0].name == "axis_1"
    for joint, stated in zip(robot.joints, GOOD["joint"], strict=True):
        assert isinstance(joint.link, SpatialLink)
        assert joint.link.origin == tuple(stated["origin"])
        assert joint.link.axis == pytest.approx(stated["axis"], abs=1e-15)
        assert [v.nominal for v in joint.link.inertia] == stated["inertia"]
        assert {v.tolerance for v in (*joint.link.center_of_mass, joint.mass)} == {0.05}
        assert np.linalg.norm(joint.link.rotation) == pytest.approx(1.0, abs=1e-15)
    described = describe_robot(robot)
    assert described["joints"][1]["name"] == "axis_2" and described["tip"]["origin"] == list(robot.tip.origin)
    assert "length" not in described["joints"][0]


def test_an_entry_of_0_is_known_no_better_than_the_others() -> None:
    """A payload off the axis, or a motor on one side, moves a centre of mass to where CAD has a 0."""
    table = copy.deepcopy(GOOD)
    table["joint"][1] |= {"center_of_mass": [0.3, 0.0, 0.4], "inertia": [0.04, 0.09, 0.1, 0.0, -0.01, 0.0]}
    values = {value.name: value for value in list_parameters(built(table))}
    deviations = {name: value.tolerance * value.reference_size for name, value in values.items()}
    assert [deviations[f"center_of_mass_{axis}_2"] for axis in "xyz"] == pytest.approx([0.05 * 0.5] * 3)
    assert [deviations[f"inertia_{two}_2"] for two in ("xx", "yy", "zz")] == pytest.approx([0.002, 0.0045, 0.005])
    products = [0.05 * math.sqrt(product) for product in (0.04 * 0.09, 0.04 * 0.1, 0.09 * 0.1)]
    assert [deviations[f"inertia_{two}_2"] for two in ("xy", "xz", "yz")] == pytest.approx(products)
    assert deviations["mass_2"] == 0.05 * values["mass_2"].nominal


def test_ten_numbers_a_link_are_parameters_and_geometry_is_none() -> None:
    names = [value.name for value in list_parameters(built(GOOD))]
    own = [f"center_of_mass_{a}_2" for a in "xyz"] + [f"inertia_{e}_2" for e in ("xx", "yy", "zz", "xy", "xz", "yz")]
    assert names[:3] == ["gravity_x", "gravity_y", "gravity_z"]
    assert [name for name in names if name.endswith("_2")][:10] == ["mass_2", *own]
    assert not [name for name in names if name.startswith(("length", "origin", "axis", "rotation"))]
    for value in list_parameters(built(GOOD)):
        assert value.low <= value.nominal <= value.high and (value.low < value.high or value.name.startswith("rat"))


@pytest.mark.parametrize(
    "key", [k for k in TABLE if k.default is not None and k.table == "joint in space"], ids=lambda k: k.name
)
def test_every_default_is_what_the_table_says(key: Key) -> None:
    default = list(key.default) if isinstance(key.default, tuple) else key.default
    assert built(changed(f"joint[1].{key.name}", default)) == built(changed(f"joint[1].{key.name}", ...))


def test_without_a_tip_it_is_the_last_frame() -> None:
    robot = built(changed("tip", ...))
    assert robot.tip is not None and robot.tip.origin == (0, 0, 0) and robot.tip.rotation == (1, 0, 0, 0)


WRONG: list[tuple[str, Any, str]] = [
    ("gravity", [0.0, -9.81], "gravity: found 2 components, possible are 3 of joints in space"),
    ("joint[1].length", 0.2, "joint[1].length: found in a file with joints in space"),
    ("joint[1].inertia_about_joint", 0.2, "joint[1].inertia_about_joint: found in a file with joints in space"),
    ("joint[2].center_of_mass", 0.1, "possible is a list of three numbers from -100 to 100 m"),
    ("joint[2].inertia", 0.1, "possible is a list of six numbers"),
    ("joint[2].inertia", [0.1, 0.1, 0.1], "found a list of 3"),
    ("joint[2].origin", ..., "required is list of three numbers"),
    ("joint[2].origin", [0.0, 0.0, float("nan")], "found nan"),
    ("joint[2].axis", [0.0, 0.0, 0.0], "found the length 0, possible is a unit vector; write a direction"),
    ("joint[2].axis", [0.0, 0.0, 0.5], "found the length 0.5, possible is a unit vector; divide it by its length"),
    ("joint[2].rotation", [1.0, 0.0, 0.0, 0.1], "possible is a unit quaternion w, x, y, z; divide"),
    ("joint[2].rotation", [0.0] * 4, "found the length 0, possible is a unit quaternion"),
    ("joint[2].rotation", [1.0, 0.0, 0.0], "possible is a list of four numbers"),
    ("joint[3].inertia", [0.1, 0.1, -0.1, 0.0, 0.0, 0.0], "principal moments -0.1, 0.1, 0.1 kg m², possible are"),
    ("joint[3].inertia", [0.1, 0.1, 0.1, 0.5, 0.0, 0.0], "possible are moments above 0"),
    ("joint[3].inertia", [0.1, 0.1, 0.3, 0.0, 0.0, 0.0], "possible is none above the sum of the others"),
    ("joint[3].mass", 0.0, "joint[3].mass: found 0.0, possible is a number above 0"),
    ("joint[2].name", "axis_1", 'found "axis_1" as at joint[1]; give each its own label'),
    ("joint[2].name", "../x; rm", "possible are letters, digits and `_.-`"),
    ("joint[2].type", "floating", '"revolute" or "prismatic"'),
    ("tip.rotation", [0.5, 0.0, 0.0, 0.0], "tip.rotation: found the length 0.5"),
    ("tip.pose", [0.5], "tip.pose: found an unknown key"),
    ("effect", [{"name": "gravity_tilt", "joint": 0, "tilt_x": 0.1}], "effect[1].tilt_x: found an unknown key"),
    ("effect", [{"name": "link_flexibility", "joint": 1, "link_share": 0.2}], "effect[1].link_share: found an unkn"),
]


@pytest.mark.parametrize("place, value, words", WRONG, ids=[f"{w[0]} {str(w[1])[:20]}" for w in WRONG])
def test_one_thing_wrong_is_one_sentence_at_its_place(place: str, value: Any, words: str) -> None:
    table = changed(place, value)
    with pytest.raises(RobotError) as refused:
        built(table)
    (sentence,) = refused.value.problems
    assert words in sentence and re.fullmatch(r"robot\.toml, [^\n]+?: found [^\n]+; [^\n]+\.", sentence)
    if not any(word in sentence for word in BEYOND_SCHEMA) and "effect" not in table and "nan" not in sentence:
        assert violations(table, SCHEMA)


def test_the_schema_allows_what_the_reader_allows() -> None:
    assert violations(GOOD, SCHEMA) == []


def test_a_file_in_the_plane_has_no_third_component_of_gravity() -> None:
    table = copy.deepcopy(GOOD) | {"joint": [{"length": 1.0, "mass": 1.0, "center_of_mass": 0.5, "inertia": 0.1}]}
    table["joint"][0]["drive"] = GOOD["joint"][0]["drive"]
    del table["tip"]
    with pytest.raises(RobotError, match="found 3 components, possible are 2 of joints in the plane"):
        built(table)


def test_more_than_twelve_joints_are_refused() -> None:
    table = GOOD | {"joint": [dict(GOOD["joint"][0], name=f"j{k}") for k in range(13)]}
    with pytest.raises(RobotError, match="found 13 joints, possible are 1 to 12"):
        built(table)
    twelve = built(GOOD | {"joint": table["joint"][:12]})
    assert find_singular_pose(twelve.joints) is None


@pytest.mark.parametrize("kinds", ["R", "PR", "RRP", "RRRRRRR"])
def test_the_mass_matrix_gives_the_kinetic_energy(kinds: str) -> None:
    """Positions differentiated in time: places of the centres of mass, and the rotation of each link."""
    rng = np.random.default_rng(len(kinds))
    robot = built(tomllib.loads(space_robots.chain(kinds, 9)))
    h = 1e-6
    for _ in range(5):
        q, v = rng.uniform(-3, 3, len(kinds)), rng.uniform(-2, 2, len(kinds))
        energy = 0.0
        ahead, behind = _place_links(robot, q + h * v), _place_links(robot, q - h * v)
        for joint, (R, _), (R_ahead, c_ahead), (R_behind, c_behind) in zip(
            robot.joints, _place_links(robot, q), ahead, behind, strict=True
        ):
            assert isinstance(joint.link, SpatialLink)
            speed, turning = (c_ahead - c_behind) / (2 * h), R.T @ (R_ahead - R_behind) / (2 * h)
            spin = np.array([turning[2, 1], turning[0, 2], turning[1, 0]])
            xx, yy, zz, xy, xz, yz = (value.nominal for value in joint.link.inertia)
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            energy += (joint.mass.nominal * speed @ speed + spin @ inertia @ spin) / 2
        rotors = sum(j.drive.motor_inertia.nominal * speed**2 for j, speed in zip(robot.joints, v, strict=True)) / 2
        M = mass_matrix(robot.joints, q[None])[0]
        assert v @ M @ v / 2 == pytest.approx(energy + rotors, rel=1e-7)


def _place_links(robot: Robot, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotation and centre of mass of each link, by Rodrigues' formula from link to link."""
    R, o, found = np.eye(3), np.zeros(3), []
    for joint, position in zip(robot.joints, q, strict=True):
        link = joint.link
        assert isinstance(link, SpatialLink)
        o, R = o + R @ np.array(link.origin), R @ make_rotation(link.rotation)
        axis = np.array(link.axis)
        if joint.kind == "prismatic":
            o = o + R @ axis * position
        else:
            K = np.cross(np.eye(3), axis)
            R = R @ (np.eye(3) + np.sin(position) * K + (1 - np.cos(position)) * K @ K)
        found.append((R, o + R @ np.array([value.nominal for value in link.center_of_mass])))
    return found
