"""A node of the horizon: the exponential step beside the simulator's, its Jacobians beside differences, any size."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from mpc_arms import built
from mpc_problems import Sizes

from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.reference_motion import Reference, circle
from hdagen.mpc.closed_loop_trial import run_trial
from hdagen.mpc.configuration import check_configuration
from hdagen.mpc.predictive_controller import MPC
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push

NODE_ERROR = (2e-5, 3e-4)  # rad at the joints, median and largest, of a node of 10 ms, against steps of 0.5 ms


def test_a_node_lies_beside_the_simulator(arm: Arm) -> None:
    """The plan's next state from a state on the circle, against the simulator's with the same torque held."""
    controller = MPC(arm, built()[1])
    path = circle(0.05, (0.2, 0.0), 5.0, 0.8)
    errors = []
    rows, seen = [], []

    def tick() -> None:
        controller.prepare()
        controller.step()
        report, whole = controller.report(), controller.nonlinear_problem().data
        rows.append(
            (
                report.state_estimate.copy(),
                report.planned_torque[0].copy(),
                report.predicted_states[0].copy(),
                whole["force"],
                report.disturbance,
            )
        )
        seen.append(report.solved)

    controller.wrap_tick(tick)
    from hdagen.simulation.simulator import run

    run(arm, controller, path, [Push(0.3, 0.6, (10.0, 0.0))], Sensors.exact(arm.n), 0)
    controller.wrap_tick(None)
    constants = np.array([arm.parameters[f"torque_constant_{j}"] for j in (1, 2)])
    smooth = dict(arm.parameters)
    for j in (1, 2):
        arm.parameters[f"friction_smoothing_{j}"] = 2.8705  # as wide as the prediction's
    try:
        for x, T, predicted, force, d in rows[100::50]:
            u = np.r_[(T + d) / constants, force]
            end = arm.rollout(x, np.tile(u, (20, 1)), 5e-4)[-1]
            errors.append(float(np.abs(end - predicted)[2:4].max()))
    finally:
        arm.parameters.update({name: smooth[name] for name in ("friction_smoothing_1", "friction_smoothing_2")})
    assert 0 < np.median(errors) < NODE_ERROR[0]
    assert max(errors) < NODE_ERROR[1]


@pytest.fixture(scope="module")
def arm() -> Arm:
    return built()[0]


def test_the_dynamics_of_the_problem_are_the_derivatives_of_its_step(arm: Arm) -> None:
    """A and B of a node are exp(J h) and its integral: J from the model's own graph, exp by another algorithm."""
    from scipy.linalg import expm

    from gen.builder.build import assemble_library
    from gen.mpc.horizon_stage import VELOCITY_UNIT, make_stage
    from gen.mpc.problem_structure import parse_structure
    from gen.robot.load_robot import load

    c = built()[1]
    controller = MPC(arm, c)
    q = np.array([0.6, -1.2])
    tip = arm.evaluate("points", q=q)["points"][-2:]
    controller.path[:] = np.r_[tip, 0.0, 0.0]
    controller.tick(1e-3, motor_position=q * 100.0, joint_position=q, tip_force=(0.0, 0.0))
    problem, _ = controller.quadratic_problem()
    m = arm.manifest["mpc"]
    sizes = Sizes(arm.n, len(m["state"]), m["nodes"], len(m["rows"]) - 4 * arm.n, tuple(m["simple"]))
    ours = sizes.split(problem)
    made, _, _ = assemble_library("paper", load("paper"), ())
    model = made.graphs.model
    structure = parse_structure(c.structure)
    assert structure is not None
    node = make_stage(model, structure, ca.vertcat(model.p, *model.inverse_symbols.values()))
    whole = controller.nonlinear_problem().data
    x = np.array([q[0], q[1], q[0], q[1], 0, 0, 0, 0], float)
    _, J, B = (np.array(v) for v in node.rate(x, np.zeros(2), np.zeros(2), whole["shared"]))
    nx, half = sizes.nx, sizes.nx // 2
    full = np.zeros((nx + arm.n, nx + arm.n))
    full[:half, half:nx] = VELOCITY_UNIT * np.eye(half)
    full[half:nx, :nx] = J.reshape(nx, half).T
    full[half:nx, nx:] = B.reshape(arm.n, half).T
    E = expm(full * c.grid[0])
    assert np.abs(ours["A"][0].T - E[:nx, :nx]).max() < 1e-6 * np.abs(E).max()
    assert np.abs(ours["B"][0].T - E[:nx, nx:]).max() < 1e-6 * np.abs(E[:nx, nx:]).max()


@pytest.mark.parametrize("nodes, space, walls", [(7, "joint", 0), (17, "tip", 3)])
def test_other_sizes_run_the_loop_too(nodes: int, space: str, walls: int) -> None:
    arm, c = built(nodes=nodes, space=space, walls=walls)
    from hdagen.control.reference_motion import convert_to_joint_motion

    path = circle(0.03, (0.2, 0.0), 5.0, 0.6)
    path = convert_to_joint_motion(arm, path, [0.6, 0.6]) if space == "joint" else path
    found = run_trial(arm, MPC(arm, c), path, [Push(0.2, 0.4, (5.0, 0.0))], Sensors(), (), seed=0)
    assert (found.simulation.status >= 0).all()
    assert np.mean([r.solved == 0 for r in found.reports]) > 0.98


RIGID = """name = "one rigid joint"
gravity = [0.0, 0.0]
[[joint]]
length = 0.2
mass = 1.0
center_of_mass = 0.1
inertia = 0.01
[joint.drive]
rigid = true
ratio = 50.0
motor_inertia = 2e-5
torque_constant = 0.05
max_current = 10.0
viscous_friction = 1e-4
coulomb_friction = 0.005
[joint.limits]
position = [-2.0, 2.0]
speed = 1.0
motor_torque_rate = 100.0
"""


def test_the_speed_of_a_rigid_joints_motor_is_limited_through_its_gear(tmp_path: Path) -> None:
    """A path twice as fast as the joint's speed limit: the joint keeps it, the motor's over its ratio."""
    robot = tmp_path / "robot.toml"
    robot.write_text(RIGID)
    c = check_configuration({"mpc": {"space": "joint", "nodes": 10}, "limits": {"tip_speed": 1.0}}, "test")
    arm = load(robot, out=built()[0].folder.parent, mpc=c)
    time = np.arange(1200) * 1e-3
    speed = 2.0 * np.sin(np.pi * time / 1.2) ** 2
    way = np.cumsum(speed) * 1e-3
    path = Reference("joint", 1e-3, way[:, None], speed[:, None], np.gradient(speed, 1e-3)[:, None])
    found = run_trial(arm, MPC(arm, c), path, (), Sensors(), start=np.zeros(1))
    assert (found.simulation.status >= 0).all()
    assert max(r.active["motor_speed"] for r in found.reports) > 3
    turned = found.simulation.state[:, arm.index("joint_velocity_1")]
    assert 0.95 < turned.max() < 1.0  # rad/s
    assert max(r.violated["motor_speed"] for r in found.reports) < 0.02 * 50.0  # rad/s at the motor


def test_a_rigid_sliding_joint_follows_its_path() -> None:
    arm, c = built("emps", nodes=8, space="joint", walls=1, limits__motor_torque=200.0, limits__torque_rate=1e4)
    time = np.arange(500) * 1e-3
    way = 0.05 * (1 - np.cos(2 * np.pi * time / 1.6))
    speed = np.gradient(way, 1e-3)
    path = Reference("joint", 1e-3, way[:, None], speed[:, None], np.gradient(speed, 1e-3)[:, None])
    stiff = c.with_changes(c.walls, admittance__mass=100.0, admittance__damping=500.0, limits__tip_speed=1.0)
    found = run_trial(arm, MPC(arm, stiff), path, (), Sensors(), start=np.zeros(1))
    assert (found.simulation.status >= 0).all()
    assert np.abs(found.simulation.state[:, 0] - way).max() < 2e-3
