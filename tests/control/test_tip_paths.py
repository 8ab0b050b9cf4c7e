"""Paths of the tip and of the joints, waypoints, and the inverse kinematics of a pose. One build serves all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import space_robots
from compiled import Compiled
from scipy.spatial.transform import Rotation

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.joint_swing import SINES, swing_joints
from hdagen.control.pose_kinematics import choose_open_posture, find_tip_jacobian, find_tip_pose, solve_tip_pose
from hdagen.control.reference_motion import Reference, convert_to_joint_motion
from hdagen.control.tip_paths import TIP_PATHS, make_tip_path
from hdagen.control.waypoints import connect_waypoints, read_waypoints
from hdagen.log.data_table import LogError

POSTURE = np.array(space_robots.SEVEN_POSTURE)
POSE = np.array([0.4, 0.1, 0.3, 0.2, -1.0, 0.5])
AWAY = np.array([0.1, -0.05, 0.04, 0.3, 0.2, -0.4])


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build(space_robots.seven_joint_arm()).folder)


def check_derivatives(motion: Reference, tolerance: float = 2e-3) -> None:
    """Velocity and acceleration are those of the position, angular ones in the base frame; it begins at rest."""
    h, places = motion.period, motion.position.copy()
    velocity = np.gradient(places, h, axis=0)
    if motion.space == "tip" and places.shape[1] == 6:
        at = Rotation.from_rotvec(places[:, 3:])
        velocity[1:-1, 3:] = (at[2:] * at[:-2].inv()).as_rotvec() / (2 * h)
    assert velocity[1:-1] == pytest.approx(motion.velocity[1:-1], abs=tolerance)
    bend = np.gradient(motion.velocity, h, axis=0)[1:-1]
    assert bend == pytest.approx(motion.acceleration[1:-1], abs=20 * tolerance)
    assert np.all(motion.velocity[0] == 0) and np.abs(motion.acceleration[0]).max() < 1e-9


@pytest.mark.parametrize("shape", TIP_PATHS)
@pytest.mark.parametrize("pose", [POSE, POSE[:2]], ids=["space", "plane"])
def test_a_path_begins_at_the_pose_and_is_smooth(shape: str, pose: np.ndarray) -> None:
    motion = make_tip_path(shape, pose, 0.1, 2.0, 4.0, (1.0, -2.0, 0.5)[: min(len(pose), 3)])
    assert motion.position[0] == pytest.approx(pose) and np.ptp(motion.position[:, 0]) > 0.03
    assert np.all(motion.position[:, 3:] == pose[3:])
    check_derivatives(motion)


def test_a_circle_and_a_line_are_what_they_are_called() -> None:
    axis = np.array([1.0, -2.0, 0.5])
    circle = make_tip_path("circle", POSE, 0.1, 2.0, 4.0, axis).position[:, :3]
    middle = (circle.max(axis=0) + circle.min(axis=0)) / 2
    assert np.linalg.norm(circle - middle, axis=1) == pytest.approx(0.1, abs=1e-6)
    assert (circle - circle[0]) @ axis == pytest.approx(0.0, abs=1e-12)
    line = make_tip_path("line", POSE, 0.1, 2.0, 4.0, axis).position[:, :3] - POSE[:3]
    assert np.cross(line, axis) == pytest.approx(0.0, abs=1e-12) and np.abs(line).max() > 0.08


@pytest.mark.parametrize(
    "change, sentence",
    [
        ({"shape": "spiral"}, "a path is one of circle, line, lissajous"),
        ({"pose": POSE * np.nan}, "6 finite numbers"),
        ({"pose": POSE[:3]}, "2 or 6 finite numbers"),
        ({"size": 0.0}, "positive, finite numbers; found size 0.0"),
        ({"seconds": 1e12}, "make no motion"),
        ({"direction": (0.0, 0.0, 0.0)}, "not all 0"),
        ({"direction": (1.0, 0.0)}, "3 finite numbers"),
    ],
)
def test_what_makes_no_path_is_refused(change: dict[str, object], sentence: str) -> None:
    given = {"shape": "line", "pose": POSE, "size": 0.1, "turn": 2.0, "seconds": 1.0, **change}
    with pytest.raises(PlantError, match=sentence):
        make_tip_path(**given)  # type: ignore[arg-type]


def test_waypoints_are_passed_at_rest_and_turned_about_one_axis() -> None:
    time, points = np.array([0.2, 1.0, 1.5]), np.array([POSE, POSE + AWAY, POSE - AWAY])
    motion = connect_waypoints("tip", time, points)
    check_derivatives(motion, 1e-2)
    for t, point in zip(time[:2], points[:2], strict=True):
        k = round(t / motion.period)
        assert motion.position[k] == pytest.approx(point, abs=1e-9) and np.abs(motion.velocity[k]).max() < 1e-9
    assert np.all(motion.position[:200] == motion.position[0]) and len(motion.position) == 1500


def test_a_file_of_waypoints_moves_the_tip_or_the_joints(arm: Arm, tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    file.write_text("time,x,y,z\n0,0.5,0.1,0.3\n0.5,0.45,0.15,0.3\n")
    tip = read_waypoints(file, arm, POSTURE)
    assert tip.space == "tip" and tip.position[-1, :3] == pytest.approx([0.45, 0.15, 0.3], abs=1e-4)
    assert np.allclose(tip.position[:, 3:], find_tip_pose(arm, POSTURE)[3:])
    names = ",".join(f"joint_position_{j}" for j in range(1, 8))
    file.write_text(f"time,{names}\n0.3,1,2,3,4,5,6,7\n0.5,7,6,5,4,3,2,1\n")
    joints = read_waypoints(file, arm, POSTURE)
    assert joints.space == "joint" and joints.position[0].tolist() == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("time,x,y\n0,1,1\n1,2,2\n", "found the columns time, x, y, possible are time, joint_position_1"),
        ("time,x,y,z,rx\n0,1,1,1,1\n1,1,1,1,1\n", "found the columns"),
        ("x,y,z\n0,1,1\n1,2,2\n", "found the columns"),
        ("time,x,y,z\n0,1,1,\n1,2,2,2\n", "finite numbers"),
        ("time,x,y,z\n0,1,1,1\n0,2,2,2\n", "grow from row to row"),
        ("time,x,y,z\n-1,1,1,1\n1,2,2,2\n", "begin at 0 s or later"),
        ("time,x,y,z\n0,1,1,1\n1e9,2,2,2\n", "end between"),
        ("time,x,y,z\n0,1,1,1\n", "end between"),
        ("time,x,y,z\n0,1,one,1\n1,2,2,2\n", "one"),
        ("time,x,y,z\n", "points.csv"),
    ],
)
def test_a_wrong_file_of_waypoints_is_refused(arm: Arm, tmp_path: Path, text: str, sentence: str) -> None:
    file = tmp_path / "points.csv"
    file.write_text(text)
    with pytest.raises((PlantError, LogError), match=sentence):
        read_waypoints(file, arm, POSTURE)


def test_a_pose_is_reached_from_nearby_and_one_beyond_reach_is_refused(arm: Arm) -> None:
    rng = np.random.default_rng(4)
    for _ in range(10):
        wanted = POSTURE + rng.uniform(-0.4, 0.4, 7)
        pose = find_tip_pose(arm, wanted)
        found = find_tip_pose(arm, solve_tip_pose(arm, pose, POSTURE))
        assert found[:3] == pytest.approx(pose[:3], abs=1e-8)
        gap = Rotation.from_rotvec(found[3:]) * Rotation.from_rotvec(pose[3:]).inv()
        assert gap.magnitude() < 1e-8
    with pytest.raises(PlantError, match="the tip does not reach"):
        solve_tip_pose(arm, find_tip_pose(arm, POSTURE) + np.array([3.0, 0, 0, 0, 0, 0]), POSTURE)
    with pytest.raises(PlantError, match="a finite pose"):
        solve_tip_pose(arm, np.full(6, np.nan), POSTURE)


def test_a_path_of_the_tip_becomes_one_of_the_joints(arm: Arm) -> None:
    path = make_tip_path("lissajous", find_tip_pose(arm, POSTURE), 0.05, 2.0, 0.6, period=2e-3)
    joints = convert_to_joint_motion(arm, path, POSTURE)
    tip = find_tip_pose(arm, joints.position)
    assert tip == pytest.approx(path.position, abs=1e-7)
    moved = np.einsum("tij,tj->ti", find_tip_jacobian(arm, joints.position), joints.velocity)
    assert moved == pytest.approx(path.velocity, abs=1e-7)
    assert np.gradient(joints.position, 2e-3, axis=0)[2:-2] == pytest.approx(joints.velocity[2:-2], abs=1e-3)


def test_the_open_posture_is_within_the_ranges_and_far_from_singular(arm: Arm) -> None:
    q = choose_open_posture(arm)
    assert np.array_equal(q, choose_open_posture(arm)) and np.abs(q).max() < 2.8
    least = np.linalg.svd(find_tip_jacobian(arm, q), compute_uv=False)[-1]
    assert least > np.linalg.svd(find_tip_jacobian(arm, POSTURE), compute_uv=False)[-1] / 2


def test_a_multisine_keeps_the_limits_and_is_smooth(arm: Arm) -> None:
    motion = swing_joints(arm, 2.0, 4.0, sines=SINES)
    check_derivatives(motion, 5e-3)
    assert np.abs(motion.velocity).max() <= 2.5 and np.abs(motion.position).max() <= 2.8
    spectrum = np.abs(np.fft.rfft(motion.position[1000:, 0] - motion.position[1000:, 0].mean()))
    assert (spectrum > 0.1 * spectrum.max()).sum() >= 3
