"""`--into` with arms in space: masses, centres and inertias of an imported model, in the file that holds them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
import pytest
from described_arms import describe_arm

from hdagen.arm.build_loader import PlantError
from hdagen.blind.realities.model_arms import ModelRobot
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.mjcf_patch import PatchedModel
from hdagen.model_export.mjcf_writer import write as write_mjcf
from hdagen.model_export.urdf_writer import write as write_urdf
from hdagen.model_import.chain_reduction import ChainRequest
from hdagen.model_import.robot_writing import import_model

MAIN = """<mujoco model="three links">  <!-- as its user has it -->
  <compiler angle="radian"/>
  <option timestep="0.001" gravity="0 0 -9.81"/>
  <default><default class="big"><joint armature="0.1" damping="2" frictionloss="0.7"/>
    <position kp="90" kv="4"/></default></default>
  <worldbody>
    <body name="base">
      <include file="parts/arm.xml"/>
    </body>
  </worldbody>
  <actuator>
    <position name="servo" class="big" joint="shoulder"/>
    <motor joint='elbow' gear="3"/>
    <general joint="wrist" biastype="affine" gainprm="50" biasprm="0 -50 -2"/>
  </actuator>
</mujoco>
"""
ARM = """<mujocoinclude>
  <body name="upper" pos="0 0 0.3" childclass="big"><joint name="shoulder" axis="0 1 0"/>
    <inertial pos="0.01 0.02 0.1" mass="2" diaginertia="0.03 0.04 0.02" quat="1 0.1 0 0"/>  <!-- weighed -->
    <body name="lower" pos="0 0 0.4" quat="1 1 0 0">
      <joint name="elbow" axis="0 0 1" pos="0 0.05 0" ref="0.3"/>
      <inertial pos='0 0.1 0' mass='1.5' fullinertia='0.03 0.02 0.03 0.001 0 0.002'/>
      <body name="hand" pos="0.1 0.2 0"><joint name="wrist" axis="1 0 0"/>
        <geom type="box" size="0.05 0.04 0.03" mass="0.6"/>
        <body name="finger" pos="0 0 0.1"><inertial pos="0 0 0.02" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/></body>
      </body>
    </body>
  </body>
</mujocoinclude>
"""
URDF = """<robot name="two"><link name="root"/>  <!-- as its user has it -->
 <joint name="a" type="revolute"><parent link="root"/><child link="one"/><axis xyz="0 0 1"/>
  <limit effort="20" velocity="3" lower="-1" upper="1"/><dynamics damping="0.5" friction='0.25'/></joint>
 <link name="one"><inertial><origin xyz="0.1 0 0" rpy="0.3 0 0"/><mass value="1"/>
  <inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="package://nowhere/shell.stl"/></geometry></visual></link>
 <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.3 0 0" rpy="0.2 0.4 0"/>
  <axis xyz="0 1 0"/><limit effort="9" velocity="2" lower="-2" upper="2"/></joint>
 <link name="two"><inertial><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
 </inertial></link>
 <joint name="c" type="fixed"><parent link="two"/><child link="tool"/><origin xyz="0 0 0.1"/></joint>
 <link name="tool"><inertial><mass value="0.2"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>
 </inertial></link></robot>
"""
LINKS = {"mass_1": 2.2, "mass_3": 0.8, "center_of_mass_x_2": 0.02, "center_of_mass_z_3": 0.03, "inertia_yy_1": 0.042,
         "inertia_xy_2": -0.002}  # fmt: skip


@pytest.fixture
def model(tmp_path: Path) -> Path:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.xml").write_text(ARM)
    (tmp_path / "model.xml").write_text(MAIN)
    (tmp_path / "two.urdf").write_text(URDF)
    return tmp_path / "model.xml"


def read_numbers(model: Path, tip: str) -> dict[str, float]:
    """The numbers of the links and drives, as parameters of a robot file, and of gravity."""
    return describe_arm_text(ModelRobot(import_model(str(model), ChainRequest(tip=tip)).text).table)


def describe_arm_text(table: dict[str, Any]) -> dict[str, float]:
    found = {f"gravity_{axis}": value for axis, value in zip("xyz", table["gravity"], strict=True)}
    for j, joint in enumerate(table["joint"], 1):
        found[f"mass_{j}"] = joint["mass"]
        found |= {f"center_of_mass_{axis}_{j}": x for axis, x in zip("xyz", joint["center_of_mass"], strict=True)}
        entries = ("xx", "yy", "zz", "xy", "xz", "yz")
        found |= {f"inertia_{entry}_{j}": x for entry, x in zip(entries, joint["inertia"], strict=True)}
        found |= {
            f"{key}_{j}": joint["drive"][key] for key in ("motor_inertia", "viscous_friction", "coulomb_friction")
        }
    return found


def correct(model: Path, tip: str, **changes: float) -> CorrectedRobot:
    """The imported robot with other numbers."""
    robot = describe_arm(import_model(str(model), ChainRequest(tip=tip)).text)
    after = describe_arm(import_model(str(model), ChainRequest(tip=tip)).text)
    cast("dict[str, float]", after.file.parameters).update(changes)
    return replace(robot, corrected=after.file)


def test_links_change_in_the_file_that_holds_them(model: Path) -> None:
    """The bodies, one without <inertial> and one with a finger welded to it, are then what the verdict says."""
    before, out = read_numbers(model, "finger"), model.with_name("new.xml")
    done = write_mjcf(correct(model, "finger", **LINKS), out, into=model)
    added = model.parent / "parts" / "arm_new.xml"
    assert done.files == (out, added) and not done.left_out
    assert {change.where for change in done.changes} >= {"shoulder.mass", "elbow.center_of_mass_x", "wrist.mass"}
    after = read_numbers(out, "finger")
    assert after == {name: pytest.approx(value, rel=1e-9, abs=1e-11) for name, value in (before | LINKS).items()}
    assert out.read_text() == MAIN.replace("parts/arm.xml", "parts/arm_new.xml")
    assert model.read_text() == MAIN and (model.parent / "parts" / "arm.xml").read_text() == ARM
    untouched = re.compile(r"<inertial[^>]*>|\s")
    assert untouched.sub("", added.read_text()) == untouched.sub("", ARM)
    assert 'pos="0.01 0.02 0.1" mass="2.2" fullinertia' in added.read_text() and "0.1 0 0" not in added.read_text()
    assert mujoco.MjModel.from_xml_path(str(out)).nbody == mujoco.MjModel.from_xml_path(str(model)).nbody


def test_friction_servos_and_gravity_change_in_the_main_file_alone(model: Path) -> None:
    changes = {
        "torque_gain_1": 1.2,
        "torque_gain_2": 0.9,
        "torque_gain_3": 1.5,
        "gravity_x": 0.4,
        "saturation_inverse_1": 0.02,
    }
    done = write_mjcf(correct(model, "finger", **changes), model.with_name("new.xml"), into=model)
    assert done.files == (model.with_name("new.xml"),) and not done.left_out
    made = mujoco.MjModel.from_xml_path(str(done.files[0]))
    assert made.opt.gravity == pytest.approx([0.4, 0, -9.81])
    assert made.actuator_gainprm[:, 0] == pytest.approx([90 * 1.2, 0.9, 75.0])
    assert made.actuator_biasprm[:, :3] == pytest.approx(np.array([[0, -108, -4.8], [0, 0, 0], [0, -75, -3]]))
    assert made.actuator_forcerange[0] == pytest.approx([-60, 60])
    assert made.actuator_ctrlrange[0] == pytest.approx([0, 0])


SPRING = {"missing_compliance_2": 1e-3, "missing_damping_2": 0.5}


def test_a_spring_in_series_moves_the_joint_to_a_body_around(model: Path, tmp_path: Path) -> None:
    """MuJoCo then accelerates as by a model that is written whole from the same numbers."""
    robot, out = correct(model, "finger", **SPRING, motor_inertia_2=0.25), model.with_name("new.xml")
    done = write_mjcf(robot, out, into=model)
    assert not done.left_out and any("elbow_torsion is the link's against it" in note for note in done.notes)
    write_mjcf(robot, tmp_path / "whole.xml")
    pair = [mujoco.MjModel.from_xml_path(str(path)) for path in (out, tmp_path / "whole.xml")]
    names = [[made.joint(k).name for k in range(made.njnt)] for made in pair]
    assert names[0] == names[1] == ["shoulder", "elbow", "elbow_torsion", "wrist"]
    assert pair[0].jnt_stiffness == pytest.approx([0, 0, 1000, 0]) and pair[0].dof_armature[1] == 0.25
    rng, found = np.random.default_rng(1), []
    state = rng.uniform(-0.5, 0.5, (20, 2, 4)) * [1, 1, 1e-3, 1]
    for made in pair:
        made.dof_frictionloss[:] = 0
        made.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        data = mujoco.MjData(made)
        for q, v in state:
            data.qpos[:], data.qvel[:] = q, v
            mujoco.mj_forward(made, data)
            found.append(data.qacc.copy())
    assert np.array(found[:20]) == pytest.approx(np.array(found[20:]), rel=1e-6, abs=1e-6 * np.abs(found).max())


@pytest.mark.parametrize(
    "change, more, words",
    [
        (("</mujoco>", '<keyframe><key qpos="0 0 0"/></keyframe></mujoco>'), {}, "keyframes"),
        (("", ""), {"backlash_angle_2": 0.001}, "a play needs a tendon"),
        (("", ""), {"cable_stiffness_2": 3.0}, "a spring to the base"),
    ],
)
def test_a_spring_that_has_no_place_is_left_out(
    model: Path, change: tuple[str, str], more: dict[str, float], words: str
) -> None:
    model.write_text(MAIN.replace(*change))
    done = write_mjcf(
        correct(model, "finger", **SPRING, viscous_friction_1=3.0, **more), model.with_name("new.xml"), into=model
    )
    assert words in done.left_out["elbow.torsion.linear"] and "torsion" not in model.with_name("new.xml").read_text()


def test_the_torsion_of_a_model_that_has_one_is_corrected(model: Path) -> None:
    once, twice = model.with_name("new.xml"), model.with_name("again.xml")
    write_mjcf(correct(model, "finger", **SPRING), once, into=model)
    robot = correct(model, "finger", **SPRING)
    later = correct(model, "finger", missing_compliance_2=2e-3, missing_damping_2=0.75)
    done = write_mjcf(replace(robot, file=robot.corrected, corrected=later.corrected), twice, into=once)
    made = mujoco.MjModel.from_xml_path(str(twice))
    assert not done.left_out and made.jnt_stiffness[2] == 500 and made.dof_damping[2] == 0.75


def test_a_payload_becomes_part_of_the_last_link(model: Path) -> None:
    robot, out = correct(model, "finger", payload_mass_3=0.5, payload_x_3=0.03), model.with_name("new.xml")
    before = read_numbers(model, "finger")
    assert not write_mjcf(robot, out, into=model).left_out
    after, tip = read_numbers(out, "finger"), np.array(robot.file.robot["tip"]["origin"])
    assert after["mass_3"] == pytest.approx(before["mass_3"] + 0.5)
    place = tip + np.array([0.03, 0.0, 0.0])  # of the payload; the tip is not turned
    for axis, x in zip("xyz", place, strict=True):
        name = f"center_of_mass_{axis}_3"
        assert after["mass_3"] * after[name] == pytest.approx(before["mass_3"] * before[name] + 0.5 * x, abs=1e-12)


def test_a_urdf_takes_links_damping_and_friction(model: Path) -> None:
    urdf, out = model.with_name("two.urdf"), model.with_name("new.urdf")
    changes = {
        "mass_1": 1.2,
        "inertia_xz_1": 0.001,
        "viscous_friction_1": 0.7,
        "coulomb_friction_2": 0.125,
        "mass_2": 0.9,
    }
    done = write_urdf(correct(urdf, "tool", **changes, motor_inertia_1=0.1), out, into=urdf)
    assert list(done.left_out) == ["a.armature"] and "no place in URDF" in done.left_out["a.armature"]
    after = read_numbers(out, "tool")
    expected = read_numbers(urdf, "tool") | changes
    assert after == {name: pytest.approx(value, rel=1e-9, abs=1e-11) for name, value in expected.items()}
    text = out.read_text()
    assert urdf.read_text() == URDF and "<!-- as its user has it -->" in text and "friction='0.25'" in text
    assert '<origin xyz="0.1 0 0"/><mass value="1.2"/>' in text


IMPOSSIBLE = URDF.replace('ixx="0.01" iyy="0.01"', 'ixx="0.001" iyy="0.001"')  # of the link two


@pytest.mark.parametrize("before, after, is_refused", [(URDF, IMPOSSIBLE, True), (IMPOSSIBLE, IMPOSSIBLE, False)])
def test_an_inertia_that_no_body_has_is_written_only_where_the_user_states_it(
    before: str, after: str, is_refused: bool, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    urdf, out = model.with_name("two.urdf"), model.with_name("new.urdf")
    robot = correct(urdf, "tool", viscous_friction_1=0.7)
    urdf.write_text(before)
    patched = PatchedModel({out: after.encode()}, (), {})
    monkeypatch.setattr("hdagen.model_export.urdf_writer.patch_urdf", lambda *_: patched)
    if not is_refused:
        write_urdf(robot, out, into=urdf)
        return
    with pytest.raises(PlantError, match="no body has the inertia that link two would have; write a whole URDF"):
        write_urdf(robot, out, into=urdf)
    assert not out.exists()


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"mass_3": 0.05}, "no body has"),  # less than the finger that is welded to it
        ({"inertia_xx_1": 1.0}, "no body has"),
    ],
)
def test_what_no_body_has_is_left_out(model: Path, changes: dict[str, float], words: str) -> None:
    with pytest.raises(PlantError, match="can hold nothing of the verdict"):
        write_mjcf(correct(model, "finger", **changes), model.with_name("new.xml"), into=model)
    done = write_mjcf(
        correct(model, "finger", **changes, viscous_friction_1=3.0), model.with_name("new.xml"), into=model
    )
    assert all(words in sentence for sentence in done.left_out.values()) and len(done.left_out) == 1


def test_a_model_that_weighs_something_else_is_refused(model: Path) -> None:
    robot = correct(model, "finger", mass_1=2.5)
    (model.parent / "parts" / "arm.xml").write_text(ARM.replace('mass="2"', 'mass="2.1"'))
    with pytest.raises(PlantError, match="mass of the link behind joint 'shoulder' is 2.1, and the robot file has 2:"):
        write_mjcf(robot, model.with_name("new.xml"), into=model)
    assert not model.with_name("new.xml").exists() and not (model.parent / "parts" / "arm_new.xml").exists()


def test_a_model_whose_joints_stand_elsewhere_keeps_its_bodies(model: Path) -> None:
    robot = correct(model, "finger", mass_1=2.5, viscous_friction_1=3.0)
    (model.parent / "parts" / "arm.xml").write_text(ARM.replace('pos="0.1 0.2 0"', 'pos="0.1 0.21 0"'))
    done = write_mjcf(robot, model.with_name("new.xml"), into=model)
    assert "joints stand elsewhere" in done.left_out["shoulder.mass"]


def test_masses_that_the_compiler_makes_anew_are_left_out(model: Path) -> None:
    model.write_text(MAIN.replace('angle="radian"', 'angle="radian" settotalmass="4.2"'))
    robot = correct(model, "finger", mass_1=2.5, viscous_friction_1=3.0)
    done = write_mjcf(robot, model.with_name("new.xml"), into=model)
    assert "settotalmass" in done.left_out["shoulder.mass"]


def test_nothing_is_left_where_the_corrected_model_does_not_load(model: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    robot = correct(model, "finger", mass_1=2.5)
    with pytest.raises(PlantError, match="there is no folder"):
        write_mjcf(robot, elsewhere / "new.xml", into=model)
    (elsewhere / "parts").mkdir()
    model.write_text(
        MAIN.replace("<worldbody>", '<asset><texture name="t" type="2d" file="t.png"/></asset><worldbody>')
    )
    (model.parent / "parts" / "arm_new.xml").write_text("mine")
    model.write_text(MAIN)
    with pytest.raises(PlantError, match=r"arm_new.xml: is there already and would be lost"):
        write_mjcf(robot, model.with_name("new.xml"), into=model)
    assert [*elsewhere.rglob("*.xml")] == [] and (model.parent / "parts" / "arm_new.xml").read_text() == "mine"


def test_a_file_that_is_read_only_stays(model: Path) -> None:
    out = model.with_name("new.xml")
    out.write_text("mine")
    out.chmod(0o444)
    with pytest.raises(PlantError, match="is there and read-only"):
        write_mjcf(correct(model, "finger", mass_1=2.5), out, into=model)
    assert out.read_text() == "mine"
