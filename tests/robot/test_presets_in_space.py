"""The presets of real arms against their sources: URDFs of example-robot-data by Pinocchio, and published tables."""

from __future__ import annotations

import importlib.util
import sysconfig
import tomllib
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from gen.presets import find_presets
from gen.robot.description import Robot
from gen.robot.link_geometry import list_link_geometry, make_rotation
from gen.robot.load_robot import load
from gen.robot.mass_matrix import mass_matrix

ROBOTS = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
URDFS = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand_tcp"),
    "so101": ("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
}
EXACT = 1e-9
SIX_DIGITS = 1e-5  # with which robosuite states quaternions and principal moments of the Gen3
POSES = 20


def turn_about(axis: np.ndarray, angle: float) -> np.ndarray:
    return make_rotation((np.cos(angle / 2), *(np.sin(angle / 2) * axis)))


def move_to(robot: Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The tip's rotation and place, and the torque that holds the weight (n), N m."""
    R, o, gravity = np.eye(3), np.zeros(3), np.array([value.nominal for value in robot.gravity])
    axes, origins, weight = [], [], np.zeros(len(q))
    for angle, link in zip(q, list_link_geometry(robot.joints), strict=True):
        o, R = o + R @ link.origin, R @ link.rotation
        axes.append(R @ link.axis)
        origins.append(o)
        R = R @ turn_about(link.axis, angle)
        for k, (axis, origin) in enumerate(zip(axes, origins, strict=True)):
            weight[k] -= link.mass * axis @ np.cross(o + R @ link.center_of_mass - origin, gravity)
    assert robot.tip is not None
    return R @ make_rotation(robot.tip.rotation), o + R @ np.array(robot.tip.origin), weight


@pytest.mark.parametrize("name", URDFS)
def test_a_preset_is_its_urdf(name: str) -> None:
    """Masses, poses of the tip, weight and mass matrix at random positions."""
    if not ROBOTS.is_dir():
        pytest.skip("example-robot-data is not installed: pip install 'hdagen[robots]'")
    robot, whole = load(name), pin.buildModelFromUrdf(str(ROBOTS / URDFS[name][0]))
    joints = [joint.name for joint in robot.joints]
    others = [whole.getJointId(joint) for joint in whole.names[1:] if joint not in joints]
    model = pin.buildReducedModel(whole, others, pin.neutral(whole))
    data, tip = model.createData(), model.getFrameId(URDFS[name][1])
    assert [*model.names[1:]] == joints
    stated = [joint.limits for joint in robot.joints]
    assert [limits.position for limits in stated] == [
        *map(tuple, np.stack([model.lowerPositionLimit, model.upperPositionLimit], 1).tolist())
    ]
    assert [limits.speed for limits in stated] == model.upperVelocityLimit.tolist()
    assert [limits.torque for limits in stated] == model.upperEffortLimit.tolist()
    for joint, body in zip(robot.joints, [*model.inertias][1:], strict=True):
        assert joint.mass.nominal == pytest.approx(body.mass, rel=EXACT)
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, len(joints))):
        R, o, weight = move_to(robot, q)
        pin.framesForwardKinematics(model, data, q)
        assert (
            pytest.approx(data.oMf[tip].rotation, abs=EXACT) == R
            and pytest.approx(data.oMf[tip].translation, abs=EXACT) == o
        )
        theirs = pin.computeGeneralizedGravity(model, data, q)
        assert weight == pytest.approx(theirs, rel=EXACT, abs=EXACT * np.abs(theirs).max())
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        assert mass_matrix(robot.joints, q[None])[0] == pytest.approx(M, rel=EXACT, abs=EXACT * np.abs(M).max())


UR5E = (  # d, a, m; alpha; mass, kg; centre of mass, m: as Universal Robots publishes them
    (0.1625, 0.0, np.pi / 2, 3.761, (0.0, -0.02561, 0.00193)),
    (0.0, -0.425, 0.0, 8.058, (0.2125, 0.0, 0.11336)),
    (0.0, -0.3922, 0.0, 2.846, (0.15, 0.0, 0.0265)),
    (0.1333, 0.0, np.pi / 2, 1.37, (0.0, -0.0018, 0.01634)),
    (0.0997, 0.0, -np.pi / 2, 1.3, (0.0, 0.0018, 0.01634)),
    (0.0996, 0.0, 0.0, 0.365, (0.0, 0.0, -0.001159)),
)


def test_ur5e_is_its_published_table() -> None:
    """Tip and weight by Denavit and Hartenberg's frames, which lie at the ends of the links."""
    robot, x, z = load("ur5e"), np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (POSES, 6)):
        R, o, axes, origins, weight = np.eye(3), np.zeros(3), [], [], np.zeros(6)
        for angle, (d, a, alpha, mass, center) in zip(q, UR5E, strict=True):
            axes.append(R @ z)
            origins.append(o)
            turned = R @ turn_about(z, angle)
            R, o = turned @ turn_about(x, alpha), o + d * (R @ z) + a * (turned @ x)
            for k in range(len(axes)):
                weight[k] += 9.81 * mass * axes[k] @ np.cross(o + R @ np.array(center) - origins[k], z)
        ours = move_to(robot, q)
        assert ours[0] == pytest.approx(R, abs=EXACT) and ours[1] == pytest.approx(o, abs=EXACT)
        assert ours[2] == pytest.approx(weight, abs=EXACT * np.abs(weight).max())


def test_gen3_weighs_and_reaches_what_its_data_sheet_says() -> None:
    """8.2 kg with a base of 1.7 kg and a camera of 0.14 kg, and 0.902 m from the shoulder to the interface's end."""
    robot = load("kinova_gen3")
    assert sum(joint.mass.nominal for joint in robot.joints) == pytest.approx(8.2 - 1.697 - 0.136, abs=0.05)
    shoulder = 0.15643 + 0.12838
    straight = move_to(robot, np.zeros(7))[1]
    assert straight[:2] == pytest.approx([0.0, 0.0], abs=0.03)
    assert straight[2] - shoulder == pytest.approx(0.902, abs=0.01)


def test_gen3_has_the_links_of_robosuite(tmp_path: Path) -> None:
    """Masses, centres, inertias and frames of links 1 to 6; robosuite's bracelet carries the vision module, too."""
    found = importlib.util.find_spec("robosuite")
    folders = [] if found is None else [*(found.submodule_search_locations or ())]
    if not folders:
        pytest.skip("robosuite is not installed: pip install --no-deps robosuite")
    from hdagen.model_import.chain_reduction import ChainRequest
    from hdagen.model_import.robot_writing import import_model

    model = Path(folders[0]) / "models/assets/robots/kinova3/robot.xml"
    theirs = tomllib.loads(import_model(str(model), ChainRequest(tip="Bracelet_Link")).text)["joint"]
    ours = tomllib.loads(find_presets()["kinova_gen3"].read_text())["joint"]
    assert len(theirs) == len(ours) == 7
    for one, other in zip(ours, theirs, strict=True):
        assert other["origin"] == pytest.approx(one["origin"], abs=SIX_DIGITS)
        turns = [make_rotation(tuple(table["rotation"])) for table in (one, other)]
        assert turns[1] == pytest.approx(turns[0], abs=SIX_DIGITS)
        assert other["axis"] == pytest.approx(one["axis"], abs=SIX_DIGITS)
    for one, other in zip(ours[:6], theirs[:6], strict=True):
        assert other["mass"] == one["mass"]
        assert other["center_of_mass"] == pytest.approx(one["center_of_mass"], abs=EXACT)
        largest = max(one["inertia"])
        assert other["inertia"] == pytest.approx(one["inertia"], abs=SIX_DIGITS * largest)
