"""Impedance (25) and admittance (26) of a tip in space: what they promise, and what they do in singular postures."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
import space_robots
from compiled import Compiled
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from gen.model import rotation_vectors
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.pose_kinematics import find_rotation_gap, find_tip_jacobian, find_tip_pose
from hdagen.control.reference_motion import Reference
from hdagen.control.tip_paths import make_tip_path
from hdagen.simulation.batch_closed_loop import closed_loops
from hdagen.simulation.ideal_admittance import find_left_jacobian, simulate_ideal_admittance
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Simulation, SpacePush, run

LAWS = ("impedance_cartesian", "admittance_cartesian")
POSTURE = np.array(space_robots.SEVEN_POSTURE)
GOOD = {f"posture_{j}": float(q) for j, q in enumerate(POSTURE, 1)}  # gains under which the arm rests at its posture
WRENCH = np.array([12.0, -7.0, 9.0, 0.8, -1.1, 0.6])  # N, N m


# -- rotation vectors, against scipy ----------------------------------------------------------------------------------


def symbolic(function: Callable[..., ca.SX], *sizes: int) -> Callable[..., Array]:
    symbols = [ca.SX.sym("a", size) for size in sizes]
    f = ca.Function("f", symbols, [function(*symbols)])
    return lambda *values: np.array(ca.DM(f(*values)).full())


def draw_vectors(count: int, longest: float) -> Array:
    """Rotation vectors of all lengths from 1e-12 rad on, and none at all."""
    rng = np.random.default_rng(1)
    lengths = np.append(longest * 10 ** -rng.uniform(0, 12, count // 2), rng.uniform(0, longest, count // 2))
    drawn = rng.normal(size=(count, 3))
    return np.vstack([np.zeros(3), drawn / np.linalg.norm(drawn, axis=1, keepdims=True) * lengths[:, None]])


def test_rotation_vectors_and_matrices_are_those_of_scipy() -> None:
    make = symbolic(rotation_vectors.make_rotation_matrix, 3)
    find = symbolic(lambda R: rotation_vectors.find_rotation_vector(ca.reshape(R, 3, 3)), 9)
    for e in draw_vectors(400, np.pi - 1e-3):
        R = Rotation.from_rotvec(e).as_matrix()
        assert make(e) == pytest.approx(R, abs=1e-13)
        assert find(R.T.ravel()).ravel() == pytest.approx(e, rel=1e-9, abs=1e-13)


def test_a_half_turn_stays_finite() -> None:
    find = symbolic(lambda R: rotation_vectors.find_rotation_vector(ca.reshape(R, 3, 3)), 9)
    for axis in np.eye(3):
        assert np.isfinite(find(Rotation.from_rotvec(np.pi * axis).as_matrix().T.ravel())).all()


def test_the_left_jacobian_makes_angular_velocity_and_acceleration() -> None:
    left, back = (symbolic(f, 3) for f in (rotation_vectors.find_left_jacobian, rotation_vectors.invert_left_jacobian))
    turning = symbolic(rotation_vectors.find_angular_acceleration, 3, 3, 3)
    rng, h = np.random.default_rng(2), 1e-5
    for e in draw_vectors(100, 4.0):
        rate, bend = rng.normal(size=(2, 3))

        def spin(t: float, e: Array = e, rate: Array = rate, bend: Array = bend) -> Array:
            """Angular velocity at t, from the matrices before and after."""
            ahead, behind = (Rotation.from_rotvec(e + s * rate + s * s * bend / 2) for s in (t + h / 2, t - h / 2))
            return np.asarray((ahead * behind.inv()).as_rotvec() / h)

        assert left(e) @ rate == pytest.approx(spin(0.0), abs=1e-8)
        assert turning(e, rate, bend).ravel() == pytest.approx((spin(1e-3) - spin(-1e-3)) / 2e-3, abs=2e-5)
        assert back(e) @ left(e) == pytest.approx(np.eye(3), abs=1e-9)
        assert left(e) == pytest.approx(find_left_jacobian(e), abs=1e-13)


# -- the laws, tick by tick -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build(space_robots.seven_joint_arm()).folder)


def unlimited(arm: Arm, law: str, period: float = 1e-3, **gains: float) -> Controller:
    """The law with no limit in the way."""
    guard = Guard(Safe.ZERO, period, torque_limit=(1e6,) * arm.n, torque_rate=(1e12,) * arm.n)
    return Controller(arm, law, guard, {**GOOD, "singularity": 1e-9, "singularity_rotation": 1e-9, **gains})


def rest_at(controller: Controller, q: Array, pose: Array, wrench: Array, ticks: int = 400) -> Array:
    """The torque after a while at rest at q; the drives' torque and the observer have settled."""
    reference = np.concatenate([pose, np.zeros(12)])
    for k in range(ticks):
        status = controller.tick(
            k * controller.guard.period, reference, motor_position=q, joint_position=q, tip_force=wrench
        )
        assert status >= 0
    return controller.torque.copy()


@pytest.mark.parametrize("law", LAWS)
def test_at_rest_on_its_target_the_torque_is_that_of_gravity(arm: Arm, law: str) -> None:
    torque = rest_at(unlimited(arm, law), POSTURE, find_tip_pose(arm, POSTURE), np.zeros(6))
    g = arm.evaluate("gravity_torque", q=POSTURE)["g"]
    assert np.abs(g).max() > 10 and torque == pytest.approx(g, abs=1e-9)


def test_a_force_and_a_moment_stretch_the_springs(arm: Arm) -> None:
    """F = K x and m = K e, and nothing accelerates: the torque is that of gravity less that of the wrench."""
    stiffness = np.array([400.0, 600.0, 900.0, 30.0, 30.0, 30.0])
    names = ("x", "y", "z", "rx", "ry", "rz")
    gains = {f"stiffness_{name}": value for name, value in zip(names, stiffness, strict=True)}
    pose, moved = find_tip_pose(arm, POSTURE), WRENCH / stiffness
    wanted = pose.copy()
    wanted[:3] -= moved[:3]
    wanted[3:] = (Rotation.from_rotvec(-moved[3:]) * Rotation.from_rotvec(pose[3:])).as_rotvec()
    controller = unlimited(arm, "impedance_cartesian", observer_bandwidth=0.0, **gains)
    torque = rest_at(controller, POSTURE, wanted, WRENCH)
    g = arm.evaluate("gravity_torque", q=POSTURE)["g"]
    assert torque == pytest.approx(g - find_tip_jacobian(arm, POSTURE).T @ WRENCH, abs=1e-8)


def test_the_posture_pulls_without_moving_the_tip(arm: Arm) -> None:
    pose = find_tip_pose(arm, POSTURE)
    torques = []
    for shift in (0.0, 0.3):
        gains = {f"posture_{j}": float(q + shift * j) for j, q in enumerate(POSTURE, 1)}
        controller = unlimited(arm, "impedance_cartesian", observer_bandwidth=0.0, **gains)
        torques.append(rest_at(controller, POSTURE, pose, np.zeros(6)))
    u = np.zeros((2, arm.nu))
    u[:, : arm.n] = torques
    x = np.concatenate([POSTURE, np.zeros(arm.n)])
    pull = np.diff(arm.rhs(np.tile(x, (2, 1)), u)[:, arm.n :], axis=0)[0]
    assert np.abs(pull).max() > 0.1
    assert np.abs(find_tip_jacobian(arm, POSTURE) @ pull).max() < 1e-6 * np.abs(pull).max()


def test_the_virtual_mass_follows_its_equation(arm: Arm) -> None:
    """Large turns: the memory of an admittance, against the equation of motion of the rotation vector by scipy."""
    h, pose = 1e-3, find_tip_pose(arm, POSTURE)
    law = next(law for law in arm.manifest["controllers"] if law["name"] == "admittance_cartesian")
    gains = {gain["name"]: gain["nominal"] for gain in law["gains"]} | GOOD
    gains |= {"stiffness_rx": 4.0, "stiffness_rz": 9.0, "mass_ry": 0.2, "period": h}
    M, B, K = (
        np.array([gains[f"{kind}_{name}"] for name in ("x", "y", "z", "rx", "ry", "rz")])
        for kind in ("mass", "damping", "stiffness")
    )
    reference, wrench = np.concatenate([pose, np.zeros(12)]), WRENCH * [1, 1, 1, 8, 8, 8]
    measured, still = np.concatenate([POSTURE, POSTURE, wrench]), np.zeros(arm.n)
    state = arm.evaluate("admittance_cartesian_start", measured=measured, reference=reference)["state"]
    numbers = list(gains.values())
    for _ in range(300):
        state = arm.evaluate(
            "admittance_cartesian_tick", measured=measured, sent=still, reference=reference, gains=numbers, state=state
        )["next"]

    def rate(_: float, z: Array) -> Array:
        pull = np.concatenate([wrench[:3], find_left_jacobian(z[3:6]).T @ wrench[3:]])
        return np.concatenate([z[6:], (pull - B * z[6:] - K * z[:6]) / M])

    exact = solve_ivp(rate, (0, 300 * h), np.zeros(12), rtol=1e-9, atol=1e-11).y[:, -1]
    first = law["state"].index("yield_position_x")
    assert np.abs(exact[3:6]).max() > 0.5
    assert state[first : first + 12] == pytest.approx(exact, abs=3e-3 * np.abs(exact).max())


@pytest.mark.parametrize("law", LAWS)
def test_a_singular_posture_stays_finite_and_legal(arm: Arm, law: str) -> None:
    """Stretched out, the least singular value being 0: a push, and a reference that leaves the reach of the arm."""
    stretched = np.zeros(arm.n)
    assert np.linalg.svd(find_tip_jacobian(arm, stretched), compute_uv=False)[-1] < 1e-10
    pose = find_tip_pose(arm, stretched)
    still = Reference("tip", 1e-3, np.tile(pose, (400, 1)), *np.zeros((2, 400, 6)))
    leaving = make_tip_path("line", pose, 0.05, 1.2, 0.6)
    for reference, pushes in ((still, [SpacePush(0.1, 0.3, tuple(WRENCH))]), (leaving, [])):
        guard = Guard(Safe.DAMPING, safe_damping=(2.0,) * arm.n)
        controller = Controller(arm, law, guard, dict.fromkeys(GOOD, 0.0))
        result = run(arm, controller, reference, pushes, Sensors(), start=stretched)
        assert np.isfinite(result.state).all() and np.abs(result.torque).max() <= 120.0
        assert np.abs(result.state[:, : arm.n]).max() < 1.0  # rad: it does not swing away
        assert (result.status >= 0).all()


# -- the promise, under dry friction ----------------------------------------------------------------------------------


def miss(arm: Arm, controller: Controller, result: Simulation, reference: Reference) -> tuple[float, float]:
    """Largest distance from the promised motion as a share of its size: of the tip, and of its orientation."""
    moved = simulate_ideal_admittance(controller, result.push, reference.period)
    turned = arm.evaluate("tip_pose", q=result.state[:, : arm.n])["rotation"]
    wanted = (Rotation.from_rotvec(moved[:, 3:]) * Rotation.from_rotvec(reference.position[:, 3:])).as_rotvec()
    gaps = result.tip - reference.position[:, :3] - moved[:, :3], find_rotation_gap(wanted, turned)
    far, share = (np.linalg.norm(gap, axis=1).max() for gap in gaps), moved.reshape(len(moved), 2, 3)
    of_tip, of_turn = (
        gap / max(size, 1e-3) for gap, size in zip(far, np.linalg.norm(share, axis=2).max(axis=0), strict=True)
    )
    return float(of_tip), float(of_turn)


PUSHES = {
    "x": (15.0, 0.0, 0.0),
    "y": (0.0, 15.0, 0.0),
    "z": (0.0, 0.0, -15.0),
    "moment": (0.0, 0.0, 0.0, 0.8, 1.8, -0.6),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("push", PUSHES)
def test_the_displacement_is_the_ideal_one_within_a_tenth(arm: Arm, law: str, push: str) -> None:
    """Dry friction of 1.5 and 0.4 N m, encoders with noise, the force sensor with 0.2 N, all a tick late."""
    controller = Controller(arm, law, Guard(Safe.DAMPING, safe_damping=(2.0,) * arm.n), GOOD)
    pose = find_tip_pose(arm, POSTURE)
    still = Reference("tip", 1e-3, np.tile(pose, (800, 1)), *np.zeros((2, 800, 6)))
    shaken = (1e-5,) * arm.n
    sensors = Sensors(delay=1, motor_noise=shaken, joint_noise=shaken, force_noise=0.2)
    result = run(arm, controller, still, [SpacePush(0.2, 0.6, PUSHES[push])], sensors, start=POSTURE)
    assert result.status.min() >= 0
    of_tip, of_turn = miss(arm, controller, result, still)
    assert (of_turn if push == "moment" else of_tip) < 0.1


def test_without_the_observer_friction_holds_the_arm_back(arm: Arm) -> None:
    """The bar above is the observer's merit: without it a push of 2 N is missed by a third or more."""
    pose = find_tip_pose(arm, POSTURE)
    still = Reference("tip", 1e-3, np.tile(pose, (700, 1)), *np.zeros((2, 700, 6)))
    misses = []
    for bandwidth in (0.0, 100.0):
        gains = GOOD | {"observer_bandwidth": bandwidth}
        controller = Controller(arm, "impedance_cartesian", Guard(Safe.DAMPING, safe_damping=(2.0,) * arm.n), gains)
        result = run(arm, controller, still, [SpacePush(0.2, 0.6, (2.0, 0.0, 0.0))], Sensors(), start=POSTURE)
        misses.append(miss(arm, controller, result, still)[0])
    assert misses[0] > 3 * misses[1] and misses[0] > 0.3, misses


@pytest.mark.parametrize("law", LAWS)
def test_closed_loops_in_lanes_are_the_simulation(arm: Arm, law: str) -> None:
    """Without dry friction, which is smooth in lanes: two independent loops to 1e-8 m."""
    smooth = arm.with_parameters(arm.p)
    smooth.parameters.update({f"coulomb_friction_{j}": 0.0 for j in range(1, arm.n + 1)})
    controller = Controller(smooth, law, Guard(Safe.DAMPING, safe_damping=(2.0,) * arm.n), GOOD)
    path = make_tip_path("lissajous", find_tip_pose(arm, POSTURE), 0.05, 1.5, 0.3)
    pushes, sensors = [SpacePush(0.1, 0.2, tuple(WRENCH))], Sensors(force_noise=0.2, delay=1)
    alone = run(smooth, controller, path, pushes, sensors, 3, POSTURE)

    def list_tips(tip: Array, _: Array) -> Array:
        return tip.transpose(1, 0, 2).reshape(tip.shape[1], -1)

    sets = {"stiffness_rx": [20.0, 5.0]}
    found = closed_loops(smooth, controller, path, sets, list_tips, pushes, sensors, 3, POSTURE)
    assert (alone.status >= 0).all()
    assert np.abs(found[0].reshape(-1, 3) - alone.tip).max() < 1e-8 < np.abs(found[1] - found[0]).max()


@pytest.mark.parametrize("law", LAWS)
def test_four_joints_follow_a_line_and_give_up_the_orientation(build: Callable[..., Compiled], law: str) -> None:
    arm = Arm(build(space_robots.four_joint_arm()).folder)
    controller = Controller(arm, law, Guard(Safe.DAMPING, safe_damping=(2.0,) * arm.n))
    q = np.array([0.4, 0.1, -0.5, 0.7])
    reference = make_tip_path("line", find_tip_pose(arm, q), 0.02, 2.0, 1.2, (1.0, 1.0, 0.0))
    result = run(arm, controller, reference, (), Sensors(), start=q)
    assert result.status.min() >= 0 and np.isfinite(result.state).all()
    assert np.linalg.norm(result.tip - reference.position[:, :3], axis=1).max() < 2e-3
