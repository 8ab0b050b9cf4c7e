"""The reader of robot.toml: what it takes, what it fills in, and every wrong file in sentences."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import re
import tempfile
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
import tomlkit
from hypothesis import HealthCheck, given, settings
from planar_links import get_planar_link

from gen.effects.appearance import Abscissa, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port
from gen.presets import find_presets
from gen.robot.description import Robot, RobotError, Value, describe_robot
from gen.robot.gear_catalogue import CATALOGUE, drive_laws
from gen.robot.load_robot import from_table, load
from gen.robot.mass_matrix import mass_matrix
from gen.robot.model_parameters import list_parameters
from gen.robot.schema import TABLE, Key
from gen.robot.schema_document import write_document

ROOT = Path(__file__).parents[2]
PAPER = find_presets()["paper"].read_text(encoding="utf-8")


def _effect(name: str, joints: str = "each", rigid: bool = True) -> Effect:
    bounded = (Parameter("bias", "N m", 0.0, -50.0, 50.0, "torque"), Parameter("width", "rad", 0.1, 0.01, 1.0, "width"))
    experiment, plot = Experiment("hold still", "pushes"), Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE)
    return Effect(
        name,
        Port.MOTOR,
        bounded,
        ("bias",),
        lambda s, p: p["bias"],
        "of this test",
        (),
        rigid,
        joints,
        experiment=experiment,
        plot=plot,
    )


EFFECTS = (
    _effect("current_bias"),
    _effect("gravity_tilt", "arm"),
    _effect("payload", "last"),
    _effect("backlash", rigid=False),
)


def flexible() -> dict[str, Any]:
    """A revolute joint with springs."""
    drive = {
        "ratio": 100.0,
        "motor_inertia": 1e-4,
        "torque_constant": 0.05,
        "viscous_friction": 1e-5,
        "coulomb_friction": 0.03,
        "flexspline_stiffness": 9000.0,
        "flexspline_stiffening": 0.08,
        "wave_generator_stiffness": 2.5,
        "wave_generator_stiffening": 27.0,
    }
    return {"length": 0.2, "mass": 1.0, "center_of_mass": 0.1, "inertia": 0.01, "drive": drive}


def rigid() -> dict[str, Any]:
    """A prismatic joint without springs."""
    drive = {"rigid": True, "ratio": 50.0, "motor_inertia": 0.0, "viscous_friction": 0.0, "coulomb_friction": 0.0}
    return {"type": "prismatic", "mass": 2.0, "center_of_mass": 0.1, "inertia": 0.01, "drive": drive}


def good() -> dict[str, Any]:
    """A robot in order: revolute and flexible, then prismatic and rigid."""
    return {"name": "arm", "gravity": [0.0, -9.81], "joint": [flexible(), rigid()]}


def built(table: dict[str, Any]) -> Robot:
    return from_table(table, "robot.toml", Path("robot.toml"), EFFECTS)


def problems(table: dict[str, Any]) -> list[str]:
    with pytest.raises(RobotError) as refused:
        built(table)
    for sentence in refused.value.problems:
        assert re.fullmatch(r"robot\.toml(, [^\n]+?)?: found [^\n]+; [^\n]+\.", sentence), sentence
        assert len(sentence) < 700 and sentence.isprintable()
    return refused.value.problems


def changed(place: str, value: Any) -> dict[str, Any]:
    """`good` with one key set, or removed where ``value`` is ...; places are written as in the errors."""
    table = good()
    *path, last = re.findall(r"[a-z_]+|\d+", place)
    inner: Any = table
    for step in path:
        inner = inner[int(step) - 1] if step.isdigit() else inner.setdefault(step, {})
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return table


# -- what a file says, and what it leaves open ------------------------------------------------------------------------


def test_plain_numbers_have_the_files_tolerance_and_geometry_none() -> None:
    robot = built(good() | {"tolerance": 0.2})
    joint = robot.joints[0]
    assert joint.mass == Value(1.0, 0.2) and joint.drive.coulomb_friction == Value(0.03, 0.2)
    for exact in (
        get_planar_link(joint).length,
        joint.drive.ratio,
        joint.drive.friction_smoothing,
        joint.drive.law_torque,
        *robot.gravity,
    ):
        assert exact is not None and exact.tolerance == 0
    assert built(good()).tolerance == 0.05 and built(good()).step == 0.0005


def test_a_parameter_states_its_own_tolerance() -> None:
    stated = {"value": 0.3, "tolerance": 0.01}
    robot = built(changed("joint[1].length", stated))
    assert get_planar_link(robot.joints[0]).length == Value(0.3, 0.01)
    assert built(good() | {"gravity": [stated, 0]}).gravity == (Value(0.3, 0.01), Value(0.0, 0.0))


def test_defaults_of_the_drive() -> None:
    first, second = (joint.drive for joint in built(good()).joints)
    assert first.friction_smoothing == Value(1.0, 0.0) and second.friction_smoothing == Value(0.5, 0.0)
    assert first.law_torque == Value(12 / 0.08, 0.0) and first.torsional_damping == Value(0.0, 0.05)
    assert first.hysteresis_loss is None and first.max_current is None
    assert second.torque_constant is None
    assert [second.law_torque, second.torsional_damping, second.flexspline_stiffness] == [None, None, None]


def test_the_catalogue_stands_for_ratio_springs_and_loss() -> None:
    table = good()
    drive = {k: v for k, v in flexible()["drive"].items() if "flexspline" not in k and "wave" not in k and k != "ratio"}
    table["joint"][0]["drive"] = drive | {"catalogue": "CSG-17-100"}
    found, gear = built(table).joints[0].drive, CATALOGUE["CSG-17-100"]
    springs = (
        found.flexspline_stiffness,
        found.flexspline_stiffening,
        found.wave_generator_stiffness,
        found.wave_generator_stiffening,
    )
    assert springs == tuple(Value(number, 0.05) for number in drive_laws(gear))
    assert found.ratio == Value(100.0, 0.0) and found.hysteresis_loss == gear.hysteresis_loss
    drive["hysteresis_loss"] = 0.0
    assert built(table).joints[0].drive.hysteresis_loss == gear.hysteresis_loss
    table["joint"][0]["drive"]["hysteresis_loss"] = 0.0
    assert built(table).joints[0].drive.hysteresis_loss == 0.0


def test_peak_torques_of_the_catalogue_bound_law_and_joint(monkeypatch: pytest.MonkeyPatch) -> None:
    gear = CATALOGUE["CSG-17-100"]
    peaks = dataclasses.replace(gear, repeated_peak_torque=50.0, momentary_peak_torque=100.0)
    monkeypatch.setitem(CATALOGUE, "CSG-17-100", peaks)
    table = good()
    drive = {k: v for k, v in flexible()["drive"].items() if "flexspline" not in k and "wave" not in k}
    table["joint"][0]["drive"] = drive | {"catalogue": "CSG-17-100"}
    joint = built(table).joints[0]
    assert joint.limits.torque == 50.0 and joint.drive.law_torque == Value(100.0, 0.0)
    table["joint"][0]["limits"] = {"torque": 40}
    table["joint"][0]["drive"]["law_torque"] = 80
    joint = built(table).joints[0]
    assert joint.limits.torque == 40.0 and joint.drive.law_torque == Value(80.0, 0.0)


def test_lumped_inertia_is_moved_to_the_centre_of_mass_and_keeps_its_deviation() -> None:
    table = changed("joint[1].inertia", ...)
    table["joint"][0] |= {"inertia_about_joint": 0.008, "mass": 1.0, "center_of_mass": 0.1}
    table["joint"][0]["drive"] = dict(rigid()["drive"]) | {"motor_inertia": 1e-4}
    inertia = get_planar_link(built(table).joints[0]).inertia
    assert inertia.nominal == pytest.approx(-0.002) and abs(inertia.nominal) * inertia.tolerance == pytest.approx(
        0.05 * 0.008
    )


def test_effects_are_stated_with_every_parameter() -> None:
    table = good() | {
        "effect": [
            {"name": "current_bias", "joint": 2, "bias": {"value": 3, "tolerance": 0.5}},
            {"name": "gravity_tilt", "joint": 0, "width": 0.5},
            {"name": "payload", "joint": 2},
            {"name": "backlash", "joint": 1},
        ]
    }
    first, second, *_ = built(table).effects
    assert first.parameters == {"bias": Value(3.0, 0.5), "width": Value(0.1, 0.05)}
    assert second.joint == 0 and second.parameters["width"] == Value(0.5, 0.05)


def test_parameters_stand_in_order_within_bounds() -> None:
    found = list_parameters(built(good()))
    assert [p.name for p in found] == [
        *(
            "gravity_x",
            "gravity_y",
            "length_1",
            "mass_1",
            "center_of_mass_1",
            "inertia_1",
            "ratio_1",
            "motor_inertia_1",
        ),
        *("torque_constant_1", "viscous_friction_1", "coulomb_friction_1", "friction_smoothing_1"),
        *("flexspline_stiffness_1", "flexspline_stiffening_1", "wave_generator_stiffness_1"),
        *("wave_generator_stiffening_1", "torsional_damping_1", "law_torque_1"),
        *("length_2", "mass_2", "center_of_mass_2", "inertia_2", "ratio_2", "motor_inertia_2"),
        *("viscous_friction_2", "coulomb_friction_2", "friction_smoothing_2"),
    ]
    by_name = {p.name: p for p in found}
    assert (by_name["mass_1"].low, by_name["mass_1"].high) == pytest.approx((1 / 10, 10))
    assert (by_name["gravity_y"].low, by_name["gravity_y"].high) == pytest.approx((-9.81 * 3, -9.81 / 3))
    assert (by_name["gravity_x"].low, by_name["gravity_x"].high) == (-10, 10)
    assert (by_name["viscous_friction_2"].low, by_name["viscous_friction_2"].high) == (0, 1e6)
    assert (by_name["length_2"].low, by_name["length_2"].high) == (0, 0)
    assert by_name["ratio_1"].unit == "1" and by_name["ratio_2"].unit == "rad/m" and by_name["mass_2"].joint == 2


def test_a_negative_lumped_inertia_has_bounds_around_it() -> None:
    inertia = next(p for p in list_parameters(load("dfki_2_0")) if p.name == "inertia_2")
    assert inertia.low < inertia.nominal < 0 < inertia.high
    stated = inertia.nominal + inertia.offset  # about the joint, which stays positive
    assert (inertia.low + inertia.offset, inertia.high + inertia.offset) == pytest.approx((stated / 10, stated * 10))


@pytest.mark.parametrize(("source", "tolerance"), [("measured", 0.02), ("data sheet", 0.1), ("CAD", 0.1), ("guess", 1)])
def test_a_source_stands_for_a_tolerance(source: str, tolerance: float) -> None:
    table = good()
    table["joint"][0]["mass"] = {"value": 1.5, "source": source}
    assert built(table).joints[0].mass == Value(1.5, tolerance)


@pytest.mark.parametrize("stated", [{"source": "CAD"}, {"value": 1.0, "source": "CAT"}, {"value": 1.0, "source": 3}])
def test_an_unknown_source_is_refused_in_one_sentence(stated: dict[str, Any]) -> None:
    table = good()
    table["joint"][0]["mass"] = stated
    with pytest.raises(RobotError, match=r"joint\[1\]\.mass: found .* possible is") as raised:
        built(table)
    assert len(raised.value.problems) == 1


def test_a_source_and_a_tolerance_exclude_each_other() -> None:
    table = good()
    table["joint"][0]["mass"] = {"value": 1.0, "source": "CAD", "tolerance": 0.1}
    with pytest.raises(RobotError, match="value, source"):
        built(table)


def test_canonical_is_json_and_knows_no_place() -> None:
    table = good() | {"effect": [{"name": "payload", "joint": 2, "bias": 1}]}
    table["joint"][0]["limits"] = {"position": [-1, 1]}
    description = describe_robot(built(table))
    assert json.loads(json.dumps(description)) == description
    assert "source" not in description and description["joints"][0]["limits"]["position"] == [-1.0, 1.0]
    assert description["effects"][0]["parameters"]["bias"] == {"nominal": 1.0, "tolerance": 0.05}


def test_the_reference_is_current() -> None:
    assert (ROOT / "docs/reference/robot_toml.md").read_text(encoding="utf-8") == write_document(), (
        "python -m gen.robot.schema_document > docs/reference/robot_toml.md"
    )


@pytest.mark.parametrize(
    "key",
    [k for k in TABLE if k.default is not None and k.table not in ("joint in space", "tip")],
    ids=lambda k: f"{k.table}.{k.name}",
)
def test_every_default_is_what_the_table_says(key: Key) -> None:
    joint = "joint[2]" if key.name == "length" else "joint[1]"  # a length has a default at a prismatic joint only
    place = key.table.replace("joint", joint) + "." if key.table else ""
    assert built(changed(f"{place}{key.name}", key.default)) == built(good())


# -- what is wrong with a file ----------------------------------------------------------------------------------------

WRONG: list[tuple[str, Any, str]] = [
    ("mass", 1.0, "move it to [[joint]]"),
    ("nam", "arm", "did you mean name?"),
    ("name", ..., "required is text; add it"),
    ("name", 3, "possible is text in quotes"),
    ("gravity", ..., "required is list of two or three numbers"),
    ("gravity", 9.81, "list of two or three numbers"),
    ("gravity", [0.0, math.nan], "found nan"),
    ("gravity", [0.0, "9.81"], 'found "9.81"'),
    ("tolerance", -0.1, "from 0 to 10"),
    ("step", 0, "from 1e-07 to 0.1 s; "),
    ("joint", ..., "found 0 joints, possible are 1 to 12"),
    ("joint", [], "found 0 joints"),
    ("joint", [flexible()] * 13, "found 13 joints"),
    ("joint", flexible(), "write [[joint]] in two brackets"),
    ("joint[1].type", "spherical", '"revolute" or "prismatic"'),
    ("joint[1].type", "revolut", "did you mean revolute?"),
    ("joint[1].lenght", 0.2, "did you mean length?"),
    ("joint[1].length", ..., "found nothing, required is number"),
    ("joint[2].length", 0.2, "possible is 0 at a prismatic joint"),
    ("joint[1].mass", ..., "mass of the link"),
    ("joint[1].mass", -1.0, "found -1.0, possible is a number from 0 to 10000 kg"),
    ("joint[1].mass", math.nan, "found nan"),
    ("joint[1].mass", math.inf, "found inf"),
    ("joint[1].mass", 1e300, "found 1e+300"),
    ("joint[1].mass", 10**400, "a whole number of 1329 bits"),
    ("joint[1].mass", -(10**5000), "a whole number of"),
    ("joint[1].mass", True, "found true, possible is a number"),
    ("joint[1].mass", "1.6", "write a number without quotes"),
    ("joint[1].mass", [1.6], "found a list of 1"),
    ("joint[1].mass", {}, "found an empty table"),
    ("joint[1].mass", {"value": 1.6}, "found a table with value"),
    ("joint[1].mass", {"value": 1.6, "tolerance": 0.1, "unit": "kg"}, "both and nothing else"),
    ("joint[1].mass", {"value": -1.6, "tolerance": 0.1}, "found -1.6"),
    ("joint[1].mass", {"value": 1.6, "tolerance": True}, "found true"),
    ("joint[1].inertia", -0.01, "from 0 to"),
    ("joint[1].inertia", ..., "found nothing"),
    ("joint[1].inertia_about_joint", 0.1, "found beside inertia"),
    ("joint[1].ratio", 100.0, "move it to [joint.drive]"),
    ("joint[1].drive", [flexible()["drive"]], "write [joint.drive]"),
    ("joint[1].drive", ..., "required is a drive"),
    ("joint[1].drive", 5, "write [joint.drive]"),
    ("joint[1].limits", True, "write [joint.limits]"),
    ("joint[1].drive.ratio", ..., "found nothing"),
    ("joint[1].drive.ratio", 0, "from 0.001 to 100000 (rad/m at a prismatic joint)"),
    ("joint[1].drive.ratio", -100.0, "found -100.0"),
    ("joint[1].drive.ratoi", 100.0, "did you mean ratio?"),
    ("joint[1].drive.motor_inertia", 0.0, "possible is 1e-12 kg m² or more in a drive with springs"),
    ("joint[1].drive.motor_inertia", 1e-300, "found 1e-300, possible is 1e-12"),
    ("joint[1].drive.coulomb_friction", ..., "found nothing"),
    ("joint[1].drive.rigid", "yes", "possible is true or false"),
    ("joint[1].drive.rigid", 1, "possible is true or false"),
    ("joint[1].drive.torque_constant", 0.0, "from 1e-06"),
    ("joint[1].drive.wave_generator_stiffening", ..., "found nothing"),
    ("joint[1].drive.flexspline_stiffening", 0.0, "from 1e-06"),
    ("joint[2].drive.torsional_damping", 1.0, "found with rigid = true"),
    ("joint[2].drive.law_torque", 1.0, "found with rigid = true"),
    ("joint[2].drive.catalogue", "CSG-17-100", "found with rigid = true"),
    ("joint[1].limits.position", [1.0, -1.0], "a low end below the high end"),
    ("joint[1].limits.position", [-1.0], "found a list of 1"),
    ("joint[1].limits.speed", {"value": 1, "tolerance": 0.1}, "possible is a number"),
    ("joint[1].limits.torque", -5, "above 0"),
    ("joint[1].sensor.torque_noise", -1, "from 0"),
    ("joint[1].sensor.nois", 0.1, "found an unknown key"),
    ("effect", {"name": "payload"}, "write [[effect]] in two brackets"),
    ("effect", [3], "write [[effect]]"),
    ("effect", [{"joint": 1}], "found nothing, required is text"),
    ("effect", [{"name": "payload"}], "found nothing, required is whole number from 0 to 12"),
    (
        "effect",
        [{"name": "pay_load", "joint": 2}],
        "current_bias, gravity_tilt, payload, backlash; choose one of them (did",
    ),
    ("effect", [{"name": "payload", "joint": 1}], "found 1, possible for payload is 2 (the last joint)"),
    ("effect", [{"name": "gravity_tilt", "joint": 1}], "possible for gravity_tilt is 0 (the arm as a whole)"),
    ("effect", [{"name": "current_bias", "joint": 3}], "found 3, possible for current_bias is 1 to 2"),
    ("effect", [{"name": "current_bias", "joint": 0}], "found 0, possible"),
    ("effect", [{"name": "current_bias", "joint": 1.0}], "possible is a whole number from 0 to 12"),
    ("effect", [{"name": "current_bias", "joint": True}], "found true, possible is a whole number"),
    ("effect", [{"name": "backlash", "joint": 2}], "whose drive is rigid"),
    ("effect", [{"name": "payload", "joint": 2, "bais": 1}], "did you mean bias?"),
    ("effect", [{"name": "payload", "joint": 2, "bias": 51}], "found 51, possible is a number from -50 to 50 N m"),
    ("effect", [{"name": "payload", "joint": 2}] * 2, "found payload at joint 2 again"),
]


@pytest.mark.parametrize(
    ("place", "value", "expected"), WRONG, ids=[f"{place} {expected}" for place, _, expected in WRONG]
)
def test_one_thing_wrong_is_one_sentence_at_its_place(place: str, value: Any, expected: str) -> None:
    (sentence,) = problems(changed(place, value))
    assert sentence.startswith(f"robot.toml, {place}") and expected in sentence, sentence


HOSTILE = [
    'arm"; rm -rf ~; "',
    "arm*/ int x;",
    "arm\nint main",
    "arm\n",
    "../../etc/passwd",
    "..",
    "a\0b",
    "",
    " arm",
    "1arm",
    "a" * 81,
    "a" * 2000,
    "bras articulé",
    "arm%s",
    "$(id)",
    "int",
    "Double",
    "while",
    "lambda",
]


@pytest.mark.parametrize("name", HOSTILE, ids=[json.dumps(name)[:30] for name in HOSTILE])
def test_hostile_names_are_refused(name: str) -> None:
    (sentence,) = problems(good() | {"name": name})
    assert sentence.startswith("robot.toml, name: found ") and len(sentence) < 300


@given(st.from_regex(r"[A-Za-z][A-Za-z0-9 _.,()+-]{0,79}", fullmatch=True))
def test_a_label_becomes_a_slug(name: str) -> None:
    try:
        slug = built(good() | {"name": name}).slug
    except RobotError as refused:
        assert "a word of C or Python" in str(refused)
        return
    assert re.fullmatch(r"[a-z][a-z0-9_]{0,47}", slug)


def test_everything_wrong_is_said_at_once() -> None:
    table = good() | {"name": "../x", "step": "fast", "colour": "red", "effect": [{"name": "gost", "joint": 13}]}
    table["joint"][0]["mass"] = -1
    table["joint"][0]["drive"]["ratoi"] = 3
    del table["joint"][1]["drive"]["viscous_friction"]
    table["joint"][1]["length"] = 1.0
    found = problems(table)
    places = [re.match(r"robot\.toml, ([^:]+):", sentence)[1] for sentence in found]  # type: ignore[index]
    assert sorted(places) == sorted(
        [
            *("name", "step", "colour", "joint[1].mass", "joint[1].drive.ratoi", "joint[2].length"),
            *("joint[2].drive.viscous_friction", "effect[1].name", "effect[1].joint"),
        ]
    )


def test_a_flood_of_problems_is_cut() -> None:
    found = problems(good() | {f"key{number}": 1 for number in range(20_000)})
    assert len(found) == 101 and "more than 100 problems" in found[-1]


def test_springs_and_catalogue_exclude_each_other() -> None:
    found = problems(changed("joint[1].drive.catalogue", "CSG-17-100"))
    assert len(found) == 4 and all("found beside catalogue" in sentence for sentence in found)


def test_a_ratio_beside_another_in_the_catalogue_is_refused() -> None:
    table = good()
    drive = {k: v for k, v in flexible()["drive"].items() if "flexspline" not in k and "wave" not in k}
    table["joint"][0]["drive"] = drive | {"catalogue": "CSG-17-100", "ratio": 50}
    (sentence,) = problems(table)
    assert "joint[1].drive.ratio: found 50 beside catalogue" in sentence and "possible is 100" in sentence


def test_an_unknown_gear_names_what_there_is_and_asks_for_no_springs() -> None:
    table = good()
    drive = {k: v for k, v in flexible()["drive"].items() if "flexspline" not in k and "wave" not in k}
    table["joint"][0]["drive"] = drive | {"catalogue": "CSG-99-100"}
    (sentence,) = problems(table)
    assert all(json.dumps(name) in sentence for name in CATALOGUE) and "did you mean" not in sentence


def test_a_joint_that_is_no_table_is_refused() -> None:
    (sentence,) = problems(good() | {"joint": [flexible(), 3]})
    assert sentence.startswith("robot.toml, joint[2]: found 3, possible is a table; write [[joint]]")


def test_springs_in_a_rigid_drive_are_refused_each() -> None:
    found = problems(changed("joint[1].drive.rigid", True))
    assert len(found) == 4 and all("found with rigid = true" in sentence for sentence in found)


def test_inertia_about_the_axis_of_a_prismatic_joint_is_refused() -> None:
    table = changed("joint[2].inertia", ...)
    table["joint"][1]["inertia_about_joint"] = 0.1
    (sentence,) = problems(table)
    assert "a prismatic joint has no axis" in sentence


# -- files ------------------------------------------------------------------------------------------------------------


def refused(source: str | Path) -> str:
    with pytest.raises(RobotError) as error:
        load(source, EFFECTS)
    (sentence,) = error.value.problems
    assert sentence.isprintable() and sentence.endswith(".") and ": found " in sentence
    return sentence


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (PAPER.encode("utf-16"), "found text in UTF-16"),
        (PAPER.encode("utf-16-be"), "found "),
        (b'name = "caf\xe9"', "found bytes that are not UTF-8 (the first at byte 11)"),
        (b"name = = 3", "found text that is not TOML"),
        (b'name = "a"\nname = "b"', "found text that is not TOML"),
        (b"x = " + b"[" * 100_000, "found text that is not TOML"),
        (b"x = " + b"9" * 5_000, "found text that is not TOML"),
        (b"\0\0\0", "found text that is not TOML"),
        (b"#" * 1_000_001, "found more than 1000000 bytes"),
    ],
    ids=["utf-16", "utf-16-be", "latin-1", "no value", "twice", "nested", "digits", "nul", "huge"],
)
def test_files_that_are_none(tmp_path: Path, content: bytes, expected: str) -> None:
    file = tmp_path / "robot.toml"
    file.write_bytes(content)
    sentence = refused(file)
    assert sentence.startswith(f"{file}: ") and expected in sentence


def test_places_without_a_file(tmp_path: Path) -> None:
    assert "found no such file" in refused(tmp_path / "none.toml") and "paper_table1" in refused("papre")
    assert "found no regular file" in refused(tmp_path)
    assert "found no such file" in refused("a\0b") and "\\u0000" in refused("a\0b")
    assert refused("x" * 5_000)
    assert "found no regular file" in refused("/dev/zero")


def test_windows_files_load(tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_bytes(b"\xef\xbb\xbf" + PAPER.replace("\n", "\r\n").encode())
    assert load(str(file)).joints == load("paper").joints


# -- the mass matrix --------------------------------------------------------------------------------------------------


def _chain(kinds: str, rng: np.random.Generator) -> Robot:
    joints = []
    for kind in kinds:
        joint = copy.deepcopy(rigid() if kind == "P" else rigid() | {"type": "revolute", "length": rng.uniform(0.1, 1)})
        joint |= {"mass": rng.uniform(0.1, 3), "center_of_mass": rng.uniform(-0.5, 1), "inertia": rng.uniform(0.01, 1)}
        joint["drive"]["motor_inertia"] = rng.uniform(0, 1e-3)
        joints.append(joint)
    return built(good() | {"joint": joints})


def _kinetic_energy(robot: Robot, q: np.ndarray, v: np.ndarray) -> float:
    """From the motion of the centres of mass along q + t v, by differences in the complex plane."""

    def centers(t: float) -> tuple[np.ndarray, np.ndarray]:
        at, angle, found, angles = 0j, 0.0, [], []
        for joint, position in zip(robot.joints, q + t * v, strict=True):
            if joint.kind == "revolute":
                angle += position
            else:
                at += position * np.exp(1j * angle)
            found.append(at + get_planar_link(joint).center_of_mass.nominal * np.exp(1j * angle))
            angles.append(angle)
            at += get_planar_link(joint).length.nominal * np.exp(1j * angle)
        return np.array(found), np.array(angles)

    h = 1e-5
    (ahead, turned), (behind, back) = centers(h), centers(-h)
    speeds, spins = abs(ahead - behind) / (2 * h), (turned - back) / (2 * h)
    rotors = [j.drive.motor_inertia.nominal * j.drive.ratio.nominal**2 for j in robot.joints]
    masses = [joint.mass.nominal for joint in robot.joints]
    inertias = [get_planar_link(joint).inertia.nominal for joint in robot.joints]
    return float(np.dot(masses, speeds**2) + np.dot(inertias, spins**2) + np.dot(rotors, v**2)) / 2


@pytest.mark.parametrize("kinds", ["R", "P", "RR", "RPR", "PRP", "RRRRRR", "PPRRPR"])
def test_the_mass_matrix_gives_the_kinetic_energy(kinds: str) -> None:
    rng = np.random.default_rng(len(kinds))
    robot = _chain(kinds, rng)
    for q, v in zip(rng.uniform(-3, 3, (20, len(kinds))), rng.uniform(-2, 2, (20, len(kinds))), strict=True):
        M = mass_matrix(robot.joints, q[None])[0]
        assert v @ M @ v / 2 == pytest.approx(_kinetic_energy(robot, q, v), rel=1e-7)
        assert pytest.approx(M.T) == M


@pytest.mark.parametrize(
    "change",
    [
        {"mass": 0.0, "inertia": 0.0},  # nothing moves
        {"mass": 0.0, "inertia": 1e-300},  # as good as nothing
        {"center_of_mass": 0.0, "inertia": 0.0},  # a point on its own axis
    ],
)
def test_a_link_without_inertia_is_refused(change: dict[str, float]) -> None:
    table = good() | {"joint": [flexible(), flexible() | change]}
    (sentence,) = problems(table)
    assert "a mass matrix that is not positive definite" in sentence


def test_an_arm_that_is_singular_only_when_straight_is_refused() -> None:
    massless, point = flexible() | {"mass": 0.0, "inertia": 0.0}, flexible() | {"inertia": 0.0}
    (sentence,) = problems(good() | {"joint": [massless, point]})
    assert "at the joint positions [0, 0]" in sentence or "at the joint positions [0, 3.14]" in sentence
    ballast = rigid()["drive"] | {"motor_inertia": 1e-3}
    assert built(good() | {"joint": [massless | {"drive": ballast}, point]})


def test_lumped_inertia_may_go_as_far_as_the_chain_allows() -> None:
    def arm(about_joint: float) -> dict[str, Any]:
        last = {k: v for k, v in flexible().items() if k != "inertia"} | {"inertia_about_joint": about_joint}
        return good() | {"joint": [flexible() | {"mass": 5.0, "inertia": 0.5}, last | {"center_of_mass": 0.3}]}

    assert get_planar_link(built(arm(0.05)).joints[1]).inertia.nominal == pytest.approx(0.05 - 0.09)
    (sentence,) = problems(arm(0.004))
    assert "not positive definite" in sentence


# -- anything at all --------------------------------------------------------------------------------------------------

SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(min_value=10**300, max_value=10**6000),
    st.floats(),
    st.text(max_size=20),
    st.sampled_from(["payload", "backlash", "prismatic", "CSG-17-100", 0, 1, 0.5, -1.0, 1e308]),
    st.dates(),
)
NAMES = st.one_of(
    st.sampled_from([key.name for key in TABLE] + ["joint", "drive", "effect", "value"]), st.text(max_size=8)
)
ANYTHING = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(NAMES, inner, max_size=5), max_leaves=12
)


def _places(table: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    return [path, *(place for step, part in inner for place in _places(part, (*path, step)))][0 if path else 1 :]


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_anything_in_any_place_gives_a_robot_or_sentences(data: st.DataObject) -> None:
    table = good() | {"effect": [{"name": "payload", "joint": 2, "bias": 1.0}]}
    for _ in range(data.draw(st.integers(1, 3))):
        *path, last = data.draw(st.sampled_from(_places(table)))
        inner = table
        for step in path:
            inner = inner[step]
        if data.draw(st.booleans()) and isinstance(inner, dict):
            inner[data.draw(NAMES)] = data.draw(ANYTHING)
        else:
            inner[last] = data.draw(ANYTHING)
    try:
        robot = built(table)
    except RobotError as refused:
        assert refused.problems and all(sentence.isprintable() for sentence in refused.problems)
        return
    assert all(p.low <= p.nominal <= p.high and math.isfinite(p.nominal) for p in list_parameters(robot))
    json.dumps(describe_robot(robot), allow_nan=False)


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(NAMES, ANYTHING, max_size=6))
def test_any_table_gives_sentences(table: dict[str, Any]) -> None:
    with pytest.raises(RobotError):
        built(table | {"joint": table.get("joint", [])})


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(PAPER.encode()) - 1), st.integers(0, 255)), min_size=1, max_size=6))
def test_any_bytes_in_the_file_give_a_robot_or_sentences(edits: list[tuple[int, int]]) -> None:
    raw = bytearray(PAPER.encode())
    for place, byte in edits:
        raw[place] = byte
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.toml"
        file.write_bytes(raw)
        try:
            assert len(load(file, EFFECTS).joints) == 2
        except RobotError as refused:
            assert all(sentence.isprintable() for sentence in refused.problems)


def test_what_tomlkit_writes_is_read_back(tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text(tomlkit.dumps(good()), encoding="utf-8")
    assert load(file).joints == built(good()).joints
