"""URDF and MJCF models become robot files: what is read, what is assumed, and one sentence for each thing wrong."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mutants import fate, kinds, mutant

from gen.robot.description import Robot
from gen.robot.load_robot import from_table
from gen.robot.mass_matrix import mass_matrix
from hdagen.model_import.chain_reduction import ChainRequest
from hdagen.model_import.model_file import ModelError, is_model_file
from hdagen.model_import.robot_writing import import_model, make_quaternion

BODY = '<inertial pos="0.01 0.02 0.1" mass="{mass}" fullinertia="0.03 0.04 0.02 0.001 -0.002 0.003"/>'
ARM = f"""<mujoco model="three links">
  <option gravity="0 0 -9.81"/><compiler angle="radian"/>
  <default><default class="big"><joint armature="0.1" damping="2" frictionloss="0.7" range="-2 2"/></default></default>
  <asset><mesh name="shell" file="nowhere.stl"/></asset>
  <worldbody>
    <body name="base"><geom type="mesh" mesh="shell"/>
      <body name="upper" pos="0 0 0.3" childclass="big"><joint name="shoulder" axis="0 1 0"/>{BODY.format(mass=2)}
        <geom type="mesh" mesh="shell"/>
        <body name="lower" pos="0 0 0.4" quat="1 1 0 0"><joint name="elbow" axis="0 0 1" pos="0 0.05 0" ref="0.3"/>
          {BODY.format(mass=1.5)}
          <body name="slider" pos="0.1 0 0"><joint name="reach" type="slide" axis="1 0 0"/>{BODY.format(mass=1)}
            <body name="hand" pos="0 0 0.1" euler="0 0 0.5">{BODY.format(mass=0.4)}<site name="grip" pos="0 0 0.05"/>
              <body name="left"><joint name="finger_l" type="slide"/>{BODY.format(mass=0.02)}</body>
              <body name="right"><joint name="finger_r" type="slide" ref="0.01"/>{BODY.format(mass=0.03)}</body>
            </body></body></body></body></body>
  </worldbody>
  <actuator><motor joint="elbow" gear="3" ctrlrange="-5 5"/>
    <position joint="shoulder" kp="100" forcerange="-40 50"/></actuator>
  <keyframe><key qpos="1 1 0.1 0 0"/></keyframe>
</mujoco>"""


def write(folder: Path, text: str, name: str = "arm.xml") -> str:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return str(path)


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


URDF = """<robot name="two"><link name="root"/>
 <joint name="a" type="{kind}"><parent link="root"/><child link="one"/><axis xyz="0 0 1"/>
  <limit effort="20" velocity="3" lower="-1" upper="1"/><dynamics damping="0.5" friction="0.25"/></joint>
 <link name="one"><inertial><origin xyz="0.1 0 0" rpy="0.3 0 0"/><mass value="{mass}"/>
  <inertia ixx="{ixx}" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="package://nowhere/shell.stl"/></geometry></visual></link>
 <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.3 0 0" rpy="1.57079632679 0 0"/>
  <axis xyz="0 1 0"/><limit effort="0" velocity="0" lower="-2" upper="2"/></joint>
 <link name="two"><inertial><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
 </inertial></link>{more}</robot>"""


def urdf(kind: str = "revolute", mass: str = "1", ixx: str = "0.02", more: str = "") -> str:
    return URDF.format(kind=kind, mass=mass, ixx=ixx, more=more)


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


def link(name: str, mass: float = 1.0) -> str:
    return f'<body name="{name}"><joint name="j_{name}"/><inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/>'


def chain(many: int) -> str:
    return f"<mujoco><worldbody>{''.join(link(f'b{k}') for k in range(many))}{'</body>' * many}</worldbody></mujoco>"


TIE = '<joint name="c" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
BAD: dict[str, tuple[str, str, str]] = {
    "no file": ("", "missing.urdf", "missing.urdf: "),
    "no XML": ("not xml", "a.xml", "found text that is no XML"),
    "other XML": ("<html/>", "a.xml", "found the element 'html' at the top, possible are <robot> and <mujoco>"),
    "entity bomb": ('<!DOCTYPE r [<!ENTITY a "aaaa">]><robot>&a;</robot>', "a.urdf", "found a DOCTYPE or ENTITY"),
    "xacro": (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:a/></robot>',
        "a.urdf",
        "a.urdf > model.urdf`",
    ),
    "xacro file": ("<robot/>", "a.xacro", "expand it by `xacro"),
    "include outside": ('<mujoco><include file="../x.xml"/></mujoco>', "in/a.xml", "possible is a file in the model's"),
    "include loop": ('<mujoco><include file="a.xml"/></mujoco>', "a.xml", "names 'a.xml' again"),
    "include missing": ('<mujoco><include file="b.xml"/></mujoco>', "a.xml", "b.xml: "),
    "0 joints": ('<mujoco><worldbody><body name="b"/></worldbody></mujoco>', "a.xml", "found 0 joints between"),
    "13 joints": (chain(13), "a.xml", "found 13 joints between base and tip, possible are 1 to 12"),
    "negative inertia": (urdf(ixx="-0.02"), "a.urdf", "joint a: found the principal moments -0.02, 0.02, 0.02 kg m²"),
    "triangle": (urdf(ixx="0.05"), "a.urdf", "joint a: found the principal moments 0.02, 0.02, 0.05 kg m² of one,"),
    "negative inertia in MJCF": (chain(1).replace('"1 1 1"', '"-1 1 1"'), "a.xml", "MuJoCo refuses it"),
    "massless": (urdf(mass="0", ixx="0"), "a.urdf", "link one behind joint a: found no mass, possible is above 0"),
    "axis of length 0": (chain(1).replace("<joint ", '<joint axis="0 0 0" '), "a.xml", "MuJoCo refuses it"),
    "quaternion 0": (chain(1).replace('name="b0"', 'name="b0" quat="0 0 0 0"'), "a.xml", "MuJoCo "),
    "NaN": (chain(1).replace('mass="1.0"', 'mass="nan"'), "a.xml", "<inertial>: found NaN in mass, possible are"),
    "duplicate joints": (chain(2).replace("j_b1", "j_b0"), "a.xml", "MuJoCo"),
    "two parents": (urdf(more=TIE.format("two", "one")), "a.urdf", "<joint> 'c': 'one' is another joint's child, too;"),
    "cyclic": (urdf(more=TIE.format("two", "root")), "a.urdf", "every link is another one's child, possible is a tree"),
    "cyclic beside": (
        urdf(
            more='<link name="x"/><link name="y"/>' + TIE.format("x", "y") + TIE.format("y", "x").replace('"c"', '"d"')
        ),
        "a.urdf",
        "hangs on itself, possible is a tree; cut the loop",
    ),
    "two roots": (urdf(more='<link name="lonely"/>'), "a.urdf", "found the roots lonely, root, possible is one; join"),
    "duplicate links": (urdf(more='<link name="one"/>'), "a.urdf", "found 2 <link> with the name 'one'; give each its"),
    "joints of one name": (urdf().replace('name="b"', 'name="a"'), "a.urdf", "found 2 <joint> with the name 'a'"),
    "no such child": (
        urdf().replace('child link="one"', 'child link="no"'),
        "a.urdf",
        "found the child 'no', possible",
    ),
    "NaN in a frame": (urdf().replace('xyz="0.3 0 0"', 'xyz="0 nan 0"'), "a.urdf", "<origin>: found NaN in xyz"),
    "NaN of an axis": (chain(1).replace("<joint ", '<joint axis="0 0 -NaN" '), "a.xml", "'j_b0': found NaN in axis"),
    "NaN of gravity": (
        chain(1).replace("<world", '<option gravity="nan 0 0"/><world'),
        "a.xml",
        "found NaN in gravity",
    ),
    "infinite inertia": (
        chain(1).replace("1 1 1", "inf inf inf"),
        "a.xml",
        "body b0: found NaN, infinity or a number beyond 1e+12",
    ),
    "infinite inertia of a link": (
        urdf(ixx="inf"),
        "a.urdf",
        "body one: found NaN, infinity or a number beyond 1e+12",
    ),
    "infinite reference": (chain(1).replace("<joint ", '<joint ref="inf" '), "a.xml", "in <option> or ref"),
    "negative mass": (
        chain(1).replace('mass="1.0"', 'mass="-1"'),
        "a.xml",
        "body b0: found the mass -1 kg, possible are",
    ),
    "negative mass of a link": (urdf(mass="-1"), "a.urdf", "<link> 'one': found the mass -1 kg"),
    "negative damping": (urdf().replace("0.5", "-0.5"), "a.urdf", "<joint> 'a': found the damping -0.5, possible are"),
    "negative armature": (chain(1).replace("<joint ", '<joint armature="-3" '), "a.xml", "j_b0: found the armature -3"),
    "negative effort": (urdf().replace("20", "-20"), "a.urdf", "<joint> 'a': found the effort -20, possible are"),
    "range upside down": (urdf().replace('lower="-1"', 'lower="5"'), "a.urdf", "'a': found the range 5 to 1, possible"),
    "millimetres": (
        chain(2).replace('name="b1"', 'name="b1" pos="0 0 333"'),
        "a.xml",
        "the distance 333 m, possible are",
    ),
    "far too heavy": (
        chain(1).replace('mass="1.0"', 'mass="1e300"'),
        "a.xml",
        "body b0: found NaN, infinity or a number beyond",
    ),
    "too heavy": (chain(1).replace('mass="1.0"', 'mass="1e6"'), "a.xml", "the mass 1e+06 kg, possible are 10000 kg"),
    "no mass between": (
        chain(3).replace('mass="1.0"', 'mass="0"', 1),
        "a.xml",
        "link b0 behind joint j_b0: found no mass",
    ),
    "copies": (
        chain(1).replace("<body", '<replicate count="100000000"><geom/></replicate><body'),
        "a.xml",
        "1e+08 copies",
    ),
    "copies of copies": (
        chain(1).replace("<body", '<replicate count="200"><replicate count="300"><geom/></replicate></replicate><body'),
        "a.xml",
        "found elements that make 60000 copies, possible are 10000; leave them out",
    ),
    "copies of a file": (
        chain(1).replace("<body", '<replicate count="2"><include file="b.xml"/></replicate><body'),
        "a.xml",
        "found elements that make inf copies",
    ),
    "ball": (chain(1).replace("<joint ", '<joint type="ball" '), "a.xml", "is ball, possible are revolute and prism"),
    "floating": (urdf(kind="floating"), "a.urdf", "<joint> 'a': found the type floating, possible is one below"),
    "two tips": (
        f"<mujoco><worldbody>{link('l')}</body>{link('r')}</body></worldbody></mujoco>",
        "a.xml",
        "found a tree with several tips, possible is one chain; name its end by --tip",
    ),
    "two tips behind a fixed link": (
        f'<mujoco><worldbody><body name="trunk">{link("l")}</body>{link("r")}</body></body></worldbody></mujoco>',
        "a.xml",
        "possible is one chain; name its end by --tip, of l, r",
    ),
    "mesh inertia": (
        '<mujoco><asset><mesh name="m" file="m.stl"/></asset><worldbody><body name="b"><joint/>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
        "a.xml",
        "body b: found no inertia but that of a mesh",
    ),
    "mimic": (
        chain(2).replace("</mujoco>", '<equality><joint joint1="j_b0" joint2="j_b1"/></equality></mujoco>'),
        "a.xml",
        "is coupled to another joint, possible are independent joints; leave it out by --joints",
    ),
    "closed loop": (
        chain(2).replace("</mujoco>", '<equality><connect body1="b1" anchor="0 0 0"/></equality></mujoco>'),
        "a.xml",
        "b1 is tied to another body in a closed loop",
    ),
    "two joints": (chain(1).replace("<joint ", '<joint name="more"/><joint '), "a.xml", "b0 has several joints"),
    "no name": (chain(1).replace(' name="j_b0"', ""), "a.xml", "needs a name"),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_wrong_is_one_sentence(what: str, tmp_path: Path) -> None:
    text, name, words = BAD[what]
    path = tmp_path / name
    if text:
        write(tmp_path, text, name)
    with pytest.raises(ModelError) as refused:
        import_model(str(path))
    sentence = str(refused.value)
    assert words in sentence and "\n" not in sentence and sentence.isprintable() and len(sentence) < 700, sentence


def test_damaged_models_are_read_or_refused_in_sentences(tmp_path: Path) -> None:
    made = [kind for kind in kinds(tmp_path) if kind.name.startswith("model.")]
    for kind in made:
        for seed in kind.seeds.values():
            assert fate(kind, seed, tmp_path) == "read"
        for number in range(150):
            assert fate(kind, mutant(kind, number), tmp_path) in ("read", "refused"), (kind.name, number)


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
        (ChainRequest(tip="nobody"), "--tip names no link or site: found 'nobody'"),
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


def test_quaternions_of_every_turn_come_back() -> None:
    from gen.robot.link_geometry import make_rotation

    rng = np.random.default_rng(0)
    turns = [*rng.normal(size=(50, 4)), *np.eye(4), [1, 1, 0, 0], [1, 0, 0, -1], [0, 1, 1, 0], [1, -1, 1, -1]]
    for turn in turns:
        R = make_rotation(tuple(np.asarray(turn) / np.linalg.norm(turn)))
        assert make_rotation(tuple(make_quaternion(R))) == pytest.approx(R, abs=1e-15)
    assert is_model_file("a.URDF") and is_model_file("b.xml") and not is_model_file("c.toml")
