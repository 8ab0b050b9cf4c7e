"""A compiled arm in space: forward dynamics, derivatives, energy, control and refusals. One build serves all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
import space_robots
from compiled import Compiled
from test_chain_in_space import Pinocchio

import hdagen
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.bench import simulator_race
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.joint_swing import swing_joints
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push, SpacePush, run

FRICTION = space_robots.FOUR_JOINTS_FRICTION
TEXT = space_robots.four_joint_arm()
ROWS = 300


@pytest.fixture(scope="module")
def built(build: Callable[..., Compiled]) -> Compiled:
    return build(TEXT)


@pytest.fixture(scope="module")
def arm(built: Compiled) -> Arm:
    return Arm(built.folder)


def draw(arm: Arm, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Random states and inputs."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-2.0, 2.0, (rows, arm.nx))
    return x, rng.uniform(-20.0, 20.0, (rows, arm.nu))


def test_names_say_what_moves_and_what_pushes(arm: Arm) -> None:
    assert arm.moves_in_space and arm.state_names[0] == "joint_position_1" and arm.nx == 8
    wrench = tuple(f"tip_{noun}_{axis}" for noun in ("force", "moment") for axis in "xyz")
    assert arm.input_names[4:] == wrench
    assert arm.robot["joints"][1]["name"] == "axis_2"


def test_forward_dynamics_with_friction_and_a_wrench_agree_with_pinocchio(arm: Arm) -> None:
    reference, n = Pinocchio(TEXT), arm.n
    x, u = draw(arm, ROWS)
    ours = arm.rhs(x, u)[:, n:]
    drives = [joint["drive"] for joint in arm.robot["joints"]]
    viscous = np.array([drive["viscous_friction"]["nominal"] for drive in drives])
    width = np.array([drive["friction_smoothing"]["nominal"] for drive in drives])
    drag = viscous * x[:, n:] + FRICTION * np.tanh(x[:, n:] / width)
    for k in range(ROWS):
        q, v, torque = x[k, :n], x[k, n:], u[k, :n] - drag[k]
        theirs = reference.all(q, v, np.zeros(n), u[k, n:], torque)["acceleration"]
        assert ours[k] == pytest.approx(theirs, rel=1e-9, abs=1e-10 * np.abs(theirs).max())


def test_pose_jacobian_and_outputs_are_one_motion(arm: Arm) -> None:
    n, h = arm.n, 1e-6
    x, u = draw(arm, 20)
    q, v = x[:, :n], x[:, n:]
    found = arm.evaluate("tip_jacobian", q=q, v=v)
    ahead, behind = (arm.evaluate("tip_pose", q=q + s * h * v) for s in (1, -1))
    moved = (ahead["position"] - behind["position"]) / (2 * h)
    assert found["tip_velocity"][:, :3] == pytest.approx(moved, abs=1e-7)
    R = arm.evaluate("tip_pose", q=q)["rotation"].reshape(-1, 3, 3).transpose(0, 2, 1)
    R_rate = ((ahead["rotation"] - behind["rotation"]) / (2 * h)).reshape(-1, 3, 3).transpose(0, 2, 1)
    spin = R_rate @ R.transpose(0, 2, 1)
    turned = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    assert found["tip_velocity"][:, 3:] == pytest.approx(turned, abs=1e-7)
    assert R @ R.transpose(0, 2, 1) == pytest.approx(np.broadcast_to(np.eye(3), R.shape), abs=1e-14)
    shown = arm.outputs(x, u)
    assert np.array_equal(shown["tip_velocity"], found["tip_velocity"])
    points = arm.evaluate("points", q=q)["points"].reshape(-1, n + 1, 3)
    assert points[:, -1] == pytest.approx(shown["tip"], abs=1e-14)


def test_derivatives_are_difference_quotients(arm: Arm) -> None:
    x, u = draw(arm, 1)
    found = arm.evaluate("rhs_jacobian", x=x, u=u)
    p, h = arm.p.copy(), 1e-6

    def by(change: Callable[[float, int], np.ndarray], many: int) -> np.ndarray:
        return np.column_stack([(change(h, k) - change(-h, k)) / (2 * h) for k in range(many)])

    by_x = by(lambda s, k: arm.rhs(x[0] + s * np.eye(arm.nx)[k], u[0]), arm.nx)
    by_u = by(lambda s, k: arm.rhs(x[0], u[0] + s * np.eye(arm.nu)[k]), arm.nu)
    by_p = by(lambda s, k: arm.with_parameters(p + s * np.eye(len(p))[k]).rhs(x[0], u[0]), len(p))
    for name, expected in (("by_x", by_x), ("by_u", by_u), ("by_p", by_p)):
        ours = found[name].reshape(-1, arm.nx).T
        assert np.abs(ours - expected).max() < 1e-6 * np.abs(expected).max()


def test_energy_is_kept_without_friction(arm: Arm) -> None:
    names = [f"{name}_friction_{j}" for name in ("viscous", "coulomb") for j in range(1, arm.n + 1)]
    p = arm.p.copy()
    p[[list(arm.parameters.described).index(name) for name in names]] = 0.0
    free = arm.with_parameters(p)
    start = np.concatenate([[0.4, 0.1, -0.3, 0.5], [1.0, 0.2, -1.5, 2.0]])
    x = free.rollout(start, np.zeros((400, arm.nu)), 0.0025, most=0.00025)
    energy = np.sum([part[:, 0] for part in free.evaluate("energy", x=x).values()], axis=0)
    swing = np.ptp(free.evaluate("energy", x=x)["kinetic"])
    assert swing > 1.0 and np.abs(energy - energy[0]).max() < 1e-7 * swing


def test_mass_matrix_is_positive_and_its_rate_less_2C_is_skew(arm: Arm) -> None:
    n, h = arm.n, 1e-6
    x, _ = draw(arm, 1000)
    q, v = x[:, :n], x[:, n:]

    def M(at: np.ndarray) -> np.ndarray:
        return arm.evaluate("mass_matrix", q=at)["M"].reshape(-1, n, n)

    np.linalg.cholesky(M(q))
    assert np.array_equal(M(q), M(q).transpose(0, 2, 1))
    C = arm.evaluate("coriolis_matrix", q=q, v=v)["C"].reshape(-1, n, n).transpose(0, 2, 1)
    S = (M(q + h * v) - M(q - h * v)) / (2 * h) - 2 * C
    assert np.abs(C).max() > 1.0 and np.abs(S + S.transpose(0, 2, 1)).max() < 1e-7 * np.abs(C).max()


def test_the_file_in_c_is_the_interpreter_s_to_the_bit(built: Compiled, arm: Arm, tmp_path: Path) -> None:
    from graphs import assembled, toml

    x, u = draw(arm, 50)
    rhs = next(f.graph for f in assembled(toml(tmp_path, TEXT)).functions if f.name == "rhs")
    theirs = np.array([np.array(rhs(a, b, arm.c)).ravel() for a, b in zip(x, u, strict=True)])
    assert np.array_equal(arm.rhs(x, u), theirs)


@pytest.mark.parametrize("law", ["position", "impedance_joint", "admittance_joint"])
def test_a_law_in_joint_space_follows_a_swing(arm: Arm, law: str) -> None:
    guard = Guard(Safe.DAMPING, safe_damping=(2.0,) * arm.n)
    motion = swing_joints(arm, 2.0, 1.5)
    sensors = Sensors(delay=0)
    found = run(arm, Controller(arm, law, guard), motion, (SpacePush(0.5, 0.7, (0.0, 3.0, -2.0)),), sensors)
    assert (found.status >= 0).all() and found.push.shape == (1500, 6) and found.tip.shape == (1500, 3)
    gap = np.abs(found.state[:, : arm.n] - motion.position)
    assert gap.max() < {"position": 0.05}.get(law, 0.25), gap.max(axis=0)
    assert found.log["tip_force_z"].shape == (1500,) and np.all(found.log["tip_moment_x"] == 0)


def test_a_swing_is_smooth_and_within_the_limits(arm: Arm) -> None:
    motion = swing_joints(arm, 1.0, 3.0)
    assert np.abs(motion.velocity).max() <= 3.0 * 0.5 and np.abs(motion.position).max() <= 1.5
    slope = np.gradient(motion.position, motion.period, axis=0)[2:-2]
    assert slope == pytest.approx(motion.velocity[2:-2], abs=1e-3)
    bend = np.gradient(motion.velocity, motion.period, axis=0)[2:-2]
    assert bend == pytest.approx(motion.acceleration[2:-2], abs=2e-2)
    assert np.all(motion.velocity[0] == 0) and np.all(motion.acceleration[0] == 0)


def test_a_push_of_the_plane_is_refused(arm: Arm) -> None:
    guard = Guard(Safe.DAMPING, safe_damping=(2.0,) * arm.n)
    controller = Controller(arm, "position", guard)
    with pytest.raises(PlantError, match="a push on this arm's tip has 3 or 6 components, not 2"):
        run(arm, controller, swing_joints(arm, 1.0, 0.01), (Push(0.0, 0.005, (1.0, 0.0)),))


def test_a_log_in_space_is_checked_and_replayed(built: Compiled, tmp_path: Path) -> None:
    robot, out = tmp_path / "robot.toml", built.folder.parent
    robot.write_text(TEXT)
    arm = hdagen.load_robot(robot, out=out)
    guard = Guard(Safe.DAMPING, safe_damping=(2.0,) * arm.n)
    sensors = Sensors((1e-4,) * arm.n, (1e-4,) * arm.n, (0.02,) * arm.n, force_noise=0.0)
    push = SpacePush(0.5, 2.0, (0.0, 3.0, -2.0, 0.5, 0.0, -0.5))
    log = run(arm, Controller(arm, "position", guard), swing_joints(arm, 2.0, 3.0), (push,), sensors).log
    assert hdagen.check(arm, log).is_usable
    assert hdagen.replay(arm, log).gap < 1.5
    blind = {"time": log.logged_time} | {k: v for k, v in log.columns.items() if not k.startswith("tip_")}
    assert hdagen.replay(arm, blind).gap > 5.0  # the wrench on the tip is a part of the motion
    named = {k.replace("_2", "_axis_2") if k.startswith("joint_pos") else k: v for k, v in blind.items()}
    assert "joint_position_axis_2" in named and hdagen.replay(arm, named).gap == hdagen.replay(arm, blind).gap


def test_the_simulators_that_are_raced_have_the_same_arm(arm: Arm) -> None:
    """Accelerations of the models that `hdagen bench` times are ours, without dry friction; and each run runs."""
    document = simulator_race._write_model(arm)
    model = simulator_race.compile_frictionless(mujoco, document)
    data = mujoco.MjData(model)
    names = [f"coulomb_friction_{j}" for j in range(1, arm.n + 1)]
    p = arm.p.copy()
    p[[list(arm.parameters.described).index(name) for name in names]] = 0.0
    free, (x, _) = arm.with_parameters(p), draw(arm, 5)
    for row in x:
        data.qpos[:], data.qvel[:] = row[: arm.n], row[arm.n :]
        mujoco.mj_forward(model, data)
        assert free.rhs(row, np.zeros(arm.nu))[arm.n :] == pytest.approx(data.qacc, rel=1e-6, abs=1e-6)
    runs = simulator_race.list_simulator_runs(arm)
    assert list(runs)[:3] == ["forward dynamics", "forward dynamics with derivatives", "MuJoCo, Runge–Kutta step"]
    for repeat, count in runs.values():
        repeat()
        assert count == simulator_race.STEPS
