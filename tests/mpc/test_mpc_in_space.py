"""The predictive controller of arms in space: axes and Jacobians beside differences, closed loops of seven joints,
walls, IPOPT."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from kept_builds import find_builds
from scipy.spatial.transform import Rotation
from space_robots import chain, seven_joint_arm

from gen.builder.build import assemble_library
from gen.mpc.horizon_stage import Stage, make_stage
from gen.mpc.problem_structure import Structure
from gen.robot.load_robot import load as load_description
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.pose_kinematics import choose_open_posture, find_rotation_gap, find_tip_pose
from hdagen.control.reference_motion import Reference
from hdagen.control.tip_paths import make_tip_path
from hdagen.mpc.benchmark.ipopt_reference import solve_with_ipopt
from hdagen.mpc.closed_loop_trial import evaluate_trial, run_trial
from hdagen.mpc.configuration import Configuration, check_configuration
from hdagen.mpc.predictive_controller import MPC
from hdagen.mpc.wall import Wall, find_least_distance, leave_no_room
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import SpacePush

SPRINGS = {
    "torsional_damping": 1.0,
    "flexspline_stiffness": 3000.0,
    "flexspline_stiffening": 0.2,
    "wave_generator_stiffness": 0.5,
    "wave_generator_stiffening": 0.2,
}
FAR = (Wall((0.0, 0.0, 1.0), 9.0),)
SEVEN, PANDA = "seven joints", "panda"
ROBOTS = [SEVEN, pytest.param(PANDA, marks=pytest.mark.campaign)]  # other tests compile most of the first


@cache
def write_robot(name: str, text: str) -> str:
    """The path of a robot file beside the builds."""
    path = find_builds() / f"mpc_{name}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return str(path)


def find_robot(name: str) -> str:
    """The robot file, without dry friction as the preset, or the preset."""
    text = re.sub(r"coulomb_friction = \S+", "coulomb_friction = 0.0", seven_joint_arm())
    return write_robot("seven_joints", text) if name == SEVEN else name


@cache
def make_arm(robot: str) -> tuple[Arm, Configuration]:
    """An arm with a short horizon of long nodes, and a wall out of reach."""
    c = check_configuration({"mpc": {"nodes": 8, "node": 0.02}, "limits": {"tip_speed": 1.0}}, "test")
    c = c.with_changes(FAR)
    return load(find_robot(robot), "portable", out=find_builds(), mpc=c), c


@cache
def write_stage(kinds: str, flexible: bool) -> Stage:
    """The stage of a chain in space, uncompiled."""
    text = chain(kinds, 5, springs=SPRINGS if flexible else None)
    path = write_robot(f"{kinds}_{flexible}", text)
    model = assemble_library("chain", load_description(path), ())[0].graphs.model
    return make_stage(model, Structure(5, 1, "tip"), ca.vertcat(model.p, *model.inverse_symbols.values()))


def fill_shared(made: Stage) -> np.ndarray:
    """The shared numbers at the robot file's parameters, friction wide, no disturbance, a wall."""
    model = made.model
    p = np.array([q.nominal for q in model.quantities])
    symbols, definition = model.inverse_definitions()
    inverse = np.array(ca.Function("inverse", [model.p], [definition])(p)).ravel() if symbols.numel() else np.empty(0)
    shared = np.zeros(made.shared_offsets["end"])
    known = np.array(made.constants(np.r_[p, inverse])).ravel()
    shared[: len(known)] = known
    shared[made.shared_offsets["smoothing"] :][: model.n] = 2.0
    shared[made.shared_offsets["walls"] :][:4] = [0.6, 0.0, 0.8, 0.1]
    return shared


def differentiate(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Central differences, a column an entry of x."""
    return np.stack([(f(x + step * e) - f(x - step * e)) / (2 * step) for e in np.eye(len(x))], 1)


@pytest.mark.parametrize("kinds, flexible", [("RPR", False), ("RR", True)])
def test_jacobians_of_a_node_are_those_of_its_differences(kinds: str, flexible: bool) -> None:
    """Accelerations by state and torque; places, turns and rows by state, the turn as an angular velocity's."""
    made, rng = write_stage(kinds, flexible), np.random.default_rng(1)
    shared, n, half = fill_shared(made), made.model.n, made.nx // 2
    x = np.r_[0.4 * rng.normal(size=half), 0.01 * rng.normal(size=half)]
    if flexible:
        x[:n] = x[n : 2 * n] + 1e-3  # motors near their joints
    T, F = 0.1 * rng.normal(size=n), rng.normal(size=6)
    rate: Any = lambda x, T: np.array(made.rate(x, T, F, shared)[0]).ravel()  # noqa: E731
    _, J, B = (np.array(part).ravel() for part in made.rate(x, T, F, shared))
    for found, wanted in (
        (J.reshape(made.nx, half).T, differentiate(lambda at: rate(at, T), x)),
        (B.reshape(n, half).T, differentiate(lambda at: rate(x, at), T)),
    ):
        assert np.abs(found - wanted).max() < 2e-6 * np.abs(wanted).max()
    y, Y, g, G = (np.array(part).ravel() for part in made.output_graph(x, shared))
    R = Rotation.from_matrix(y[made.ny :].reshape(3, 3).T)

    def outputs(at: np.ndarray) -> np.ndarray:
        seen = np.array(made.output_graph(at, shared)[0]).ravel()
        turned = Rotation.from_matrix(seen[made.ny :].reshape(3, 3).T)
        return np.r_[seen[:3], (turned * R.inv()).as_rotvec(), seen[6 : made.ny]]

    rows = differentiate(lambda at: np.array(made.output_graph(at, shared)[2]).ravel(), x)
    assert np.abs(Y.reshape(made.nx, made.ny).T - differentiate(outputs, x)).max() < 1e-6
    assert np.abs(G.reshape(made.nx, made.ng).T - rows).max() < 1e-6 * np.abs(rows).max()
    assert abs(g[-1] - (0.6 * y[0] + 0.8 * y[2] - 0.1)) < 1e-12


def test_the_axes_of_a_pose_are_those_of_rotations() -> None:
    """A target that begins at the arm is at the arm and at rest; goal and pull are the group's own."""
    axes, rng = write_stage("RPR", False).axes, np.random.default_rng(2)
    _, begin, pull, goal = axes.list_functions(ca.SX.sym("c", 500))
    R = Rotation.random(random_state=3)
    columns = R.as_matrix().T.ravel()
    path = np.r_[rng.normal(size=3), 0.8, -0.5, 0.4, rng.normal(size=6)]
    moved = np.array(begin(np.r_[0.1, 0.2, 0.3, columns], path)).ravel()
    found = np.array(goal(path, moved, columns)).ravel()
    assert np.abs(found[:3] - [0.1, 0.2, 0.3]).max() < 1e-12
    assert np.abs(found[3:]).max() < 1e-6
    e, rate = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.4, -0.3])
    moved = np.r_[0.0, 0.0, 0.0, e, 0.0, 0.0, 0.0, rate]
    found = np.array(goal(path, moved, columns)).ravel()
    wanted = Rotation.from_rotvec(e) * Rotation.from_rotvec(path[3:6])
    assert np.abs(found[3:6] - (wanted * R.inv()).as_rotvec()).max() < 1e-9
    step = 1e-6
    turn = (Rotation.from_rotvec(e + step * rate) * Rotation.from_rotvec(e).inv()).as_rotvec() / step
    assert np.abs(found[9:12] - turn - Rotation.from_rotvec(e).apply(path[9:12])).max() < 1e-5
    wrench = rng.normal(size=6)
    pulled = np.array(pull(moved, wrench)).ravel()
    assert abs(pulled[3:] @ rate - wrench[3:] @ turn) < 1e-5  # the same power


def test_the_stage_of_a_plane_has_the_operations_that_it_had() -> None:
    model = assemble_library("paper", load_description("paper"), ())[0].graphs.model
    made = make_stage(model, Structure(), ca.vertcat(model.p, *model.inverse_symbols.values()))
    assert (made.rate.n_instructions(), made.output_graph.n_instructions()) <= (660, 792)


def follow(
    arm: Arm, c: Configuration, pushes: tuple[SpacePush, ...], seconds: float, turn: float = 1.5
) -> tuple[Reference, MPC, Any, Any]:
    start = choose_open_posture(arm)
    path = make_tip_path("circle", find_tip_pose(arm, start), 0.05, turn, seconds)
    controller = MPC(arm, c)
    found = run_trial(arm, controller, path, pushes, Sensors(), c.walls, 1, start)
    q = found.simulation.state[:, [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]]
    gap = find_rotation_gap(path.position[:, 3:], arm.evaluate("tip_pose", q=q)["rotation"])
    return path, controller, found, gap


@pytest.mark.parametrize("robot", ROBOTS)
def test_an_arm_follows_its_path_and_yields_as_its_admittance(robot: str) -> None:
    """A force and a moment move the tip as mass, damper and spring; before them it is on the path, unturned."""
    arm, c = make_arm(robot)
    push = SpacePush(0.3, 0.7, (4.0, -3.0, 2.0, 0.3, -0.2, 0.4))
    path, controller, found, gap = follow(arm, c, (push,), 0.7)
    assert (found.simulation.status >= 0).all()
    before = slice(50, 290)
    assert np.linalg.norm(found.simulation.tip - path.position[:, :3], axis=1)[before].max() < 5e-4
    assert np.linalg.norm(gap[before], axis=1).max() < 1e-3
    result = evaluate_trial(arm, c, path, found, controller)
    assert result.largest < 1e-3
    assert not any(result.violated.values())
    turned = found.reports[-1].target_displacement[3:6]
    assert np.linalg.norm(turned) > 0.01
    assert np.abs(gap[-1] + turned).max() < 2e-3


@pytest.mark.parametrize("robot", ROBOTS)
def test_walls_and_limits_hold_in_space(robot: str) -> None:
    """A wall cuts the circle, the tip's speed and a joint's are limited: all of them active, none broken."""
    arm, c = make_arm(robot)
    tip = find_tip_pose(arm, choose_open_posture(arm))[:3]
    normal = np.array([-0.6, 0.0, -0.8])
    wall = Wall(tuple(normal.tolist()), float(normal @ tip) + 0.01)
    c = c.with_changes((wall,), limits__tip_speed=0.12, limits__motor_speed=(2.0, 0.15, 2.0, 2.0, 2.0, 2.0, 2.0))
    push = SpacePush(0.2, 0.8, (*(8 * normal).tolist(),))
    path, controller, found, _ = follow(arm, c, (push,), 1.0, 4.0)
    assert (found.simulation.status >= 0).all()
    assert min(max(r.active[name] for r in found.reports) for name in ("wall", "tip_speed", "motor_speed")) > 0
    result = evaluate_trial(arm, c, path, found, controller)
    assert result.largest > 0.005  # which the wall does not let through
    allowed = {"wall_1": 1e-3, "tip_speed": 0.01, "motor_speed": 0.01, "joint_position": 0.0, "joint_torque": 0.0}
    assert all(result.violated[name] <= most for name, most in allowed.items()), result.violated


@pytest.mark.parametrize(
    ("robot", "jump", "is_touching"),
    [
        (SEVEN, (0.01, 0.0, -0.01, 0.05, 0.0, 0.0), False),
        pytest.param(PANDA, (0.01, 0.0, -0.01, 0.05, 0.0, 0.0), False, marks=pytest.mark.campaign),
        pytest.param(PANDA, (0.0, 0.02, 0.0, 0.0, -0.1, 0.08), True, marks=pytest.mark.campaign),
    ],
)
def test_a_converged_plan_in_space_costs_what_ipopts_does(
    robot: str, jump: tuple[float, ...], is_touching: bool
) -> None:
    """Pose, wrench and seven joints: dynamics integrated finely, turns by their rotation vector, another solver. The
    last jump makes motors reach their speeds, which the finely integrated plan then touches: there the first torque
    alone is compared, as in the plane."""
    arm, c = make_arm(robot)
    controller = MPC(arm, c.with_changes(c.walls, mpc__steps=30, mpc__node=0.01))
    q, shift = choose_open_posture(arm), np.array(jump)
    pose = find_tip_pose(arm, q)
    controller.path[:, :6], controller.path[:, 6:] = pose, 0.0
    for k in range(4):  # the path jumps away from an arm that stands
        if k == 1:
            controller.path[:, :3] += shift[:3]
            turned = Rotation.from_rotvec(shift[3:]) * Rotation.from_rotvec(pose[3:])
            controller.path[:, 3:6] = turned.as_rotvec()
        moment = (1.0, 0.0, 2.0, 0.1, 0.0, 0.1)
        assert controller.tick(k * 1e-3, motor_position=q, joint_position=q, tip_force=moment) >= 0
    data = controller.nonlinear_problem().data
    (answer,) = solve_with_ipopt(find_robot(robot), c.structure, [data])
    assert answer["status"] == "Solve_Succeeded"
    first = np.array(data["T"]).reshape(-1, arm.n)[0]
    assert np.abs(np.array(answer["T"])[0] - first).max() < 0.01  # of the motor's largest
    if not is_touching:
        assert answer["cost"] > 1e-4
        assert 0.999 * answer["cost"] < answer["cost_of_plan"] < 1.002 * answer["cost"]


def test_the_nearest_point_behind_walls_is_that_of_a_solver() -> None:
    from scipy.optimize import minimize

    rng = np.random.default_rng(4)
    for _ in range(20):
        normals = rng.normal(size=(5, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        offsets = normals @ rng.normal(size=3) + rng.uniform(0.0, 0.2, 5)
        walls = [Wall(tuple(n.tolist()), float(o)) for n, o in zip(normals, offsets, strict=True)]
        behind = {"type": "ineq", "fun": lambda x, N=normals, o=offsets: o - N @ x}
        found = minimize(lambda x: x @ x, np.zeros(3), constraints=[behind], method="SLSQP", tol=1e-12)
        assert find_least_distance(walls) == pytest.approx(np.sqrt(found.fun), abs=1e-5)
    assert leave_no_room((Wall((0.0, 0.0, 1.0), 0.1), Wall((0.0, 0.0, -1.0), -0.2)))


@pytest.mark.parametrize(
    "robot, tables, words",
    [
        ("panda", {"wall": [{"normal": [1.0, 0.0], "offset": 0.3}]}, "normal has 2 numbers .* moves in space; give 3"),
        ("panda", {"wall": [{"normal": [1.0, 0.0, 0.0], "offset": -9.0}]}, "walls leave only what is 9 m"),
        ("panda", {"admittance": {"rotation_mass": [1.0, 2.0]}}, "has 2 numbers and there are 3 turns"),
        ("panda", {"admittance": {"mass": [1.0, 2.0]}}, "has 2 numbers and there are 3 axes"),
        ("panda", {"limits": {"joint_low": [0.0] * 6}}, "has 6 numbers and there are 7 joints"),
        ("panda", {"mpc": {"space": "joint"}, "weights": {"orientation": 1.0}}, "of the orientation of a tip in space"),
        ("paper", {"weights": {"orientation": 1.0}}, "of the orientation of a tip in space"),
        ("paper", {"wall": [{"normal": [1.0, 0.0, 0.0], "offset": 0.3}]}, "moves in the plane; give 2"),
    ],
)
def test_what_does_not_fit_the_space_is_one_sentence(robot: str, tables: dict[str, Any], words: str) -> None:
    with pytest.raises(PlantError, match=words) as caught:
        load(robot, "portable", mpc=check_configuration(tables, "file"))
    assert "\n" not in str(caught.value)


def test_walls_of_both_kinds_are_refused() -> None:
    walls = [{"normal": [1.0, 0.0], "offset": 0.3}, {"normal": [1.0, 0.0, 0.0], "offset": 0.3}]
    with pytest.raises(PlantError, match="normals of two and of three numbers"):
        check_configuration({"wall": walls}, "file")
