"""URDF and MJCF models become robot files: what is read, what is assumed, and one sentence for each thing wrong."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from sample_models import ARM, chain, link, urdf, write

from gen.robot.description import Robot
from gen.robot.load_robot import from_table
from gen.robot.mass_matrix import mass_matrix
from hdagen.model_import.chain_reduction import ChainRequest
from hdagen.model_import.model_file import ModelError, is_model_file
from hdagen.model_import.robot_writing import import_model, make_quaternion
from hdagen.support.mujoco_warnings import collect_mujoco_warnings


def built(text: str) -> Robot:
    return from_table(tomllib.loads(text), "robot.toml", Path("robot.toml"))


def full_mass_matrix(text: str, q: dict[str, float]) -> np.ndarray:
    """MuJoCo's own mass matrix of the three links at joint positions, without geometry, and without the fingers."""
    spec = mujoco.MjSpec.from_string(text)
    for geom in [geom for body in spec.bodies for geom in body.geoms]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, value in q.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return M[:3, :3]


def test_a_chain_with_a_gripper_is_what_mujoco_computes(tmp_path: Path) -> None:
    made = import_model(write(tmp_path, ARM))
    robot = built(made.text)
    assert [joint.name for joint in robot.joints] == ["shoulder", "elbow", "reach"]
    assert [joint.kind for joint in robot.joints] == ["revolute", "revolute", "prismatic"]
    rng = np.random.default_rng(1)
    for q in rng.uniform(-1.5, 1.5, (5, 3)):
        theirs = full_mass_matrix(ARM, dict(zip(("shoulder", "elbow", "reach"), q, strict=True)))
        assert mass_matrix(robot.joints, q[None])[0] == pytest.approx(theirs, rel=1e-9, abs=1e-12)


def test_every_number_has_its_source_and_every_assumption_is_told(tmp_path: Path) -> None:
    made = import_model(write(tmp_path, ARM))
    assert all("  # " in line for line in made.text.splitlines() if "=" in line and not line.startswith("#"))
    told = "\n".join(made.notes)
    for words in (
        "assumed: the tip is the site grip of hand",
        "held: finger_l at 0, finger_r at 0.01, and welded",
        "left out: the servo of shoulder; the input is its torque",
        "left out: 1 keyframes",
    ):
        assert words in told, told
    table = tomllib.loads(made.text)
    first, second, third = table["joint"]
    numbers = {"motor_inertia": 0.1, "viscous_friction": 2.0, "coulomb_friction": 0.7}
    guesses = {name: {"value": value, "source": "guess"} for name, value in numbers.items()}
    drive = {"rigid": True, "ratio": 1.0, **guesses}
    assert first["drive"].items() >= drive.items() and table["gravity"] == [0.0, 0.0, -9.81]
    assert first["limits"]["torque"] == 40.0 and second["limits"]["torque"] == 15.0
    assert "torque" not in third["limits"] and first["limits"]["position"] == [-2.0, 2.0]
    assert "<inertial> of slider, hand, left, right, welded" in made.text


def test_base_tip_joints_and_held_joints_are_chosen(tmp_path: Path) -> None:
    path = write(tmp_path, ARM)
    table = tomllib.loads(import_model(path, ChainRequest(base="upper", tip="grip")).text)
    assert [joint["name"] for joint in table["joint"]] == ["elbow", "reach"]
    raised = [0.0, 0.0, 0.4 + 0.05]  # the anchor lies along y of a frame that is turned
    assert table["joint"][0]["origin"] == pytest.approx(raised, abs=1e-12)
    fewer = import_model(path, ChainRequest(joints=("shoulder", "reach"), held=(("elbow", 0.8),)))
    robot = built(fewer.text)
    assert [joint.name for joint in robot.joints] == ["shoulder", "reach"] and "elbow at 0.8" in fewer.notes[-3]
    q = np.array([0.4, -0.2])
    theirs = full_mass_matrix(ARM, {"shoulder": 0.4, "elbow": 0.8, "reach": -0.2})[np.ix_([0, 2], [0, 2])]
    assert mass_matrix(robot.joints, q[None])[0] == pytest.approx(theirs, rel=1e-9, abs=1e-12)


def test_a_held_finger_moves_what_is_welded(tmp_path: Path) -> None:
    path = write(tmp_path, ARM)
    closed, opened = (built(import_model(path, ChainRequest(held=(("finger_l", at),))).text) for at in (0.0, 0.1))
    assert closed.joints[0].link == opened.joints[0].link
    assert closed.joints[2].link != opened.joints[2].link


def test_a_urdf_is_read_without_its_meshes(tmp_path: Path) -> None:
    made = import_model(write(tmp_path, urdf(), "two.urdf"))
    table = tomllib.loads(made.text)
    first, second = table["joint"]
    assert first["limits"] == {"position": [-1, 1], "speed": 3, "torque": 20, "motor_torque_rate": 2000}
    assert first["drive"]["viscous_friction"] == {"value": 0.5, "source": "guess"}
    assert first["drive"]["coulomb_friction"] == {"value": 0.25, "source": "guess"}
    assert first["drive"]["motor_inertia"] == 0.0  # nothing is known, and nothing is claimed
    assert "assumed: gravity of 9.81 m/s² against z of the root link, as URDF states none" in made.notes
    assert any("right angles" in note for note in made.notes) and built(made.text).in_space
    half = np.sqrt(0.5)
    assert second["rotation"] == pytest.approx([half, half, 0, 0], abs=1e-15) and "torque" not in second["limits"]
    c, s = np.cos(0.3), np.sin(0.3)
    R = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    tensor = R @ np.diag([0.02, 0.02, 0.02]) @ R.T
    assert first["inertia"] == pytest.approx([*np.diag(tensor), 0, 0, 0], abs=1e-12)


SENSOR = """<joint name="{at}_camera" type="fixed"><parent link="{at}"/><child link="camera_of_{at}"/>
  <origin xyz="0.1 0 0"/></joint>
 <link name="camera_of_{at}"><inertial><mass value="{mass}"/>
  <inertia ixx="{ixx}" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


@pytest.mark.parametrize("ixx", ["1e-3", "0"])
def test_an_impossible_inertia_counts_only_in_the_sum_of_its_link(ixx: str, tmp_path: Path) -> None:
    base = SENSOR.format(at="root", mass=1e-6, ixx="-1e-8")
    made = import_model(write(tmp_path, urdf(more=base + SENSOR.format(at="two", mass=0.2, ixx=ixx)), "two.urdf"))
    second = tomllib.loads(made.text)["joint"][1]
    assert "counted as stated, though no body has such an inertia: camera_of_root, camera_of_two" in made.notes
    away = 0.5 * 0.2 / 0.7 * 0.1**2  # kg m², of two masses 0.1 m apart about their centre
    assert second["mass"] == pytest.approx(0.7)
    assert second["inertia"][:3] == pytest.approx([0.01 + float(ixx), 0.01 + away, 0.01 + away], rel=1e-9)


def test_another_encoding_is_refused(tmp_path: Path) -> None:
    """In which a document type would not be found."""
    path = tmp_path / "a.xml"
    path.write_bytes(('<!DOCTYPE a [<!ENTITY b "c">]>' + chain(1)).encode("utf-16"))
    with pytest.raises(ModelError, match="found text that is not in UTF-8; save it in UTF-8"):
        import_model(str(path))


def test_a_quaternion_is_made_a_unit_one(tmp_path: Path) -> None:
    made = import_model(write(tmp_path, chain(2).replace('name="b1"', 'name="b1" quat="2 0 0 2"')))
    assert tomllib.loads(made.text)["joint"][1]["rotation"] == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])


@pytest.mark.parametrize(
    "request_, words",
    [
        (ChainRequest(tip="zzz"), "--tip names no link or site: found 'zzz', possible are world, base, upper, lower,"),
        (
            ChainRequest(base="hnad"),
            "--base names no link or site: found 'hnad' (did you mean hand?), possible are",
        ),
        (ChainRequest(base="hand", tip="upper"), "upper does not hang on hand"),
        (ChainRequest(joints=("finger_l",)), "--joints names finger_l, which is not between base and tip"),
        (ChainRequest(joints=("elbwo",)), "found no joint named 'elbwo' (did you mean elbow?)"),
        (ChainRequest(held=(("wrist", 1.0),)), "found no joint named 'wrist'"),
    ],
    ids=lambda part: "" if isinstance(part, str) else str(part)[13:50],
)
def test_a_chain_that_is_not_there_is_refused(request_: ChainRequest, words: str, tmp_path: Path) -> None:
    with pytest.raises(ModelError) as refused:
        import_model(write(tmp_path, ARM), request_)
    assert words in str(refused.value)


def test_a_model_of_100_megabytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "huge.urdf"
    with path.open("wb") as stream:
        stream.truncate(100_000_000)
    with pytest.raises(ModelError, match="100000000 bytes"):
        import_model(str(path))


def test_hostile_names_become_labels(tmp_path: Path) -> None:
    made = import_model(write(tmp_path, chain(2).replace("j_b0", "9; rm -rf ~/&quot;x").replace("j_b1", "ok")))
    first, second = tomllib.loads(made.text)["joint"]
    assert first["name"] == "j9__rm_-rf____x" and second["name"] == "ok"
    assert any("is called j9__rm_-rf____x" in note for note in made.notes) and built(made.text).in_space


def test_a_floating_base_is_left_out(tmp_path: Path) -> None:
    body = '<body name="hull"><freejoint/><inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>'
    text = f"<mujoco><worldbody>{body}{link('a')}{link('b')}</body></body></body></worldbody></mujoco>"
    made = import_model(write(tmp_path, text))
    assert "left out: the free joint of hull, which is the base" in made.notes
    assert len(tomllib.loads(made.text)["joint"]) == 2


def test_the_command_writes_the_file_whole_or_not_at_all(tmp_path: Path) -> None:
    out = tmp_path / "robot.toml"
    command = [sys.executable, "-m", "hdagen", "robot", "import"]
    path = write(tmp_path, ARM)
    done = subprocess.run([*command, path, "--out", str(out)], capture_output=True, text=True, check=True)
    assert done.stdout == f"{out}\n" and "held: finger_l" in done.stderr
    assert built(out.read_text()).name == "three links"
    before = out.read_text()
    done = subprocess.run(
        [*command, write(tmp_path, "<x/>"), "--out", str(out)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and out.read_text() == before and done.stderr.count("\n") == 1


def test_nothing_is_left_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any) -> None:
    """MuJoCo writes what it warns of to MUJOCO_LOG.TXT in the folder where it runs, and to standard error."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    path = write(tmp_path, urdf().replace('lower="-1" upper="1"', 'lower="0" upper="0"'), "a.urdf")
    made = import_model(path, ChainRequest(held=(("a", 0.0),)))
    assert [joint["name"] for joint in tomllib.loads(made.text)["joint"]] == ["b"]
    assert not list((tmp_path / "here").iterdir()) and capfd.readouterr() == ("", "")


def test_mujoco_warns_where_its_caller_listens_and_as_before_afterwards(capfd: Any) -> None:
    before = mujoco.get_mju_user_warning()
    with collect_mujoco_warnings() as told:
        mujoco.MjSpec.from_string(urdf().replace('lower="-1" upper="1"', 'lower="1" upper="1"'))
    assert len(told) == 1 and "equal lower and upper limits" in told[0]
    assert mujoco.get_mju_user_warning() == before and capfd.readouterr() == ("", "")


def test_a_joint_beside_the_chain_is_held_at_its_only_position(tmp_path: Path) -> None:
    """A finger that cannot move."""
    turned = ARM.replace('name="finger_l" type="slide"', 'name="finger_l" type="slide" range="0.02 0.02"')
    made = import_model(write(tmp_path, turned))
    assert any("held: finger_l at 0.02, finger_r at 0.01" in note for note in made.notes), made.notes
    held = import_model(write(tmp_path, ARM), ChainRequest(held=(("finger_l", 0.02),)))
    assert built(made.text).joints[2].link == built(held.text).joints[2].link


def test_an_end_that_a_urdf_leaves_out_is_zero(tmp_path: Path) -> None:
    made = import_model(write(tmp_path, urdf().replace('lower="-1" upper="1"', 'lower="-1"'), "a.urdf"))
    assert tomllib.loads(made.text)["joint"][0]["limits"]["position"] == [-1.0, 0.0]


def test_sizes_that_a_file_states_ask_for_no_memory(tmp_path: Path) -> None:
    stated = '<size memory="100T" nuserdata="2000000000" nuser_body="1000000000"/>'
    plain, large = (import_model(write(tmp_path, chain(1).replace("<world", f"{s}<world"))) for s in ("", stated))
    assert plain.text == large.text


def test_quaternions_of_every_turn_come_back() -> None:
    from gen.robot.link_geometry import make_rotation

    rng = np.random.default_rng(0)
    turns = [*rng.normal(size=(50, 4)), *np.eye(4), [1, 1, 0, 0], [1, 0, 0, -1], [0, 1, 1, 0], [1, -1, 1, -1]]
    for turn in turns:
        R = make_rotation(tuple(np.asarray(turn) / np.linalg.norm(turn)))
        assert make_rotation(tuple(make_quaternion(R))) == pytest.approx(R, abs=1e-15)
    assert is_model_file("a.URDF") and is_model_file("b.xml") and not is_model_file("c.toml")
