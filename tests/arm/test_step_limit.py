"""Springs that are damped far beyond the robot file: rollouts take shorter steps and stay where finer ones are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from compiled import Compiled
from replayed import RIGID

from hdagen.arm.compiled_arm import Arm, load
from hdagen.arm.ratings import compute_rated_torque

Builder = Callable[..., Compiled]


@pytest.fixture(scope="module")
def arm() -> Arm:
    return load("paper")


def swung(arm: Arm, most: float) -> np.ndarray:
    """Joint angles each ms of a push on joint 2."""
    u = np.zeros((200, arm.nu))
    u[:, 1] = 2.0 * np.sin(0.04 * np.arange(200))
    path = arm.rollout(np.zeros(arm.nx), u, 1e-3, exact=True, most=most)
    return path[:, [arm.index(f"joint_position_{j}") for j in (1, 2)]]


def test_a_rollout_with_much_damping_is_that_of_fine_steps(arm: Arm) -> None:
    arm = arm.with_parameters(arm.p)
    arm.parameters["torsional_damping_2"] = 19.0 * arm.parameters["torsional_damping_2"]
    assert arm.stability.longest_step(arm.p) < 1e-3
    coarse, fine = swung(arm, 1e-3), swung(arm, 2e-5)
    assert np.abs(fine).max() > 1e-3
    np.testing.assert_allclose(coarse, fine, atol=1e-4 * np.abs(fine).max())


def test_the_robot_files_own_damping_takes_the_robots_step(arm: Arm) -> None:
    assert arm.stability.longest_step(arm.p) == np.inf
    assert load("emps").stability.longest_step(load("emps").p) == np.inf  # rigid


def fastest(arm: Arm, x: np.ndarray | None = None) -> np.ndarray:
    """The eigenvalues of the linear model at rest or at ``x``, 1/s."""
    x, u = np.zeros(arm.nx) if x is None else x, np.zeros(arm.nu)
    h, columns = 1e-7, []
    for k in range(arm.nx):
        ends = []
        for side in (h, -h):
            moved = x.copy()
            moved[k] += side
            ends.append(arm.evaluate("rhs_exact", x=moved, u=u, sliding=np.ones(arm.n))["rate"])
        columns.append((ends[0] - ends[1]) / (2 * h))
    return np.asarray(np.linalg.eigvals(np.stack(columns, -1).reshape(arm.nx, arm.nx)))


def test_the_bound_is_that_of_the_linear_model(arm: Arm) -> None:
    """The fastest decay of rotor and link at rest, by eigenvalues of the linear model, is no faster than said."""
    arm = arm.with_parameters(arm.p)
    for j in (1, 2):
        arm.parameters[f"torsional_damping_{j}"] = 15.0 * arm.parameters[f"torsional_damping_{j}"]
    decay = float(np.abs(fastest(arm).real).max())
    assert 0.3 < decay * arm.stability.longest_step(arm.p) <= 2.6


@pytest.mark.parametrize("compliance, damping", [(1e-6, 0.0), (1e-6, 5.0), (1e-4, 50.0), (1e-7, 1.0)])
def test_a_spring_that_the_file_does_not_have_takes_steps_that_carry_it(
    build: Builder, compliance: float, damping: float
) -> None:
    arm = Arm(build(RIGID, effects=("missing_compliance",)).folder)
    for j in (1, 2):
        arm.parameters.update({f"missing_compliance_{j}": compliance, f"missing_damping_{j}": damping})
    step = arm.stability.longest_step(arm.p)
    assert 0.3 < float(np.abs(fastest(arm)).max()) * step <= 2.6
    u = np.zeros((100, arm.nu))
    u[:, 0] = 0.5
    path = arm.rollout(np.zeros(arm.nx), u, 1e-3, exact=True, most=1e-3)
    assert np.isfinite(path).all() and np.abs(path).max() < 1e3
    for place, (low, high) in arm.stability.spring_bounds(step).items():  # each alone is carried, too
        assert low <= arm.p[place] * 1.01 and arm.p[place] <= high * 1.01


@pytest.mark.parametrize("side", ["above", "below"])
def test_a_stiff_wall_takes_steps_that_carry_the_spring_at_its_load(side: str) -> None:
    """At a wall the spring is loaded beyond what the motor does, where it is many times as stiff."""
    arm = load("paper", effects=("all",))
    arm.parameters[f"contact_stiffness_{side}_2"] = 100.0
    assert arm.stability.longest_step(arm.p) == np.inf  # one that yields
    arm.parameters.update({f"contact_stiffness_{side}_2": 6000.0, "contact_above_2": 0.01, "contact_below_2": -0.01})
    assert arm.stability.longest_step(arm.p) < 1e-3
    x = np.zeros(arm.nx)
    for part, ratio in (("motor", arm.parameters["ratio_2"]), ("joint", 1.0)):
        x[arm.index(f"{part}_velocity_2")] = (2.0 if side == "above" else -2.0) * ratio
    u = np.zeros((60, arm.nu))
    coarse, fine = (arm.rollout(x, u, 1e-3, exact=True, most=most) for most in (1e-3, 2e-5))
    struck = np.abs(fine[:, arm.index("joint_position_2")]).max()
    assert struck > 0.012  # it was met
    for name in ("motor_position_2", "joint_position_2"):
        k = arm.index(name)
        np.testing.assert_allclose(coarse[:, k], fine[:, k], atol=0.02 * np.abs(fine[:, k]).max())


@pytest.mark.parametrize("share", [0.05, 0.3, 0.7, 1.0])
def test_springs_under_load_take_steps_that_carry_them(arm: Arm, share: float) -> None:
    """They stiffen: the linear model where they are twisted is no faster than said, and a release stays on its way."""
    load = share * compute_rated_torque(arm)
    twist = arm.evaluate("torsion", joint_torque=load)["torsion"]
    x = np.zeros(arm.nx)
    for j in (1, 2):
        x[arm.index(f"motor_position_{j}")] = arm.parameters[f"ratio_{j}"] * twist[j - 1]
    step = arm.stability.longest_step_under_load(arm, load)
    assert 0.2 < float(np.abs(fastest(arm, x)).max()) * step <= 2.6
    u = np.zeros((40, arm.nu))
    coarse, fine = (arm.rollout(x, u, 1e-3, exact=True, most=most) for most in (step, step / 50))
    k = arm.index("joint_position_2")
    assert np.isfinite(coarse).all()
    np.testing.assert_allclose(coarse[:, k], fine[:, k], atol=0.2 * np.abs(fine[:, k]).max())


def test_the_more_load_the_shorter_the_step_and_a_rigid_arm_takes_any(arm: Arm) -> None:
    full = compute_rated_torque(arm)
    steps = [arm.stability.longest_step_under_load(arm, share * full) for share in (0.0, 0.1, 0.5, 1.0)]
    assert steps == sorted(steps, reverse=True) and steps[-1] < 0.5 * steps[0]
    rigid = load("emps")
    assert rigid.stability.longest_step_under_load(rigid, compute_rated_torque(rigid)) == np.inf
