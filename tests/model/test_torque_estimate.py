"""Joint torque without a sensor: the three estimates on exact, moving, disturbed and coarse data.

Legend as in `gen.model.torque_estimate`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from compiled import Compiled
from robots import effect
from scipy.optimize import brentq

from gen.presets import find_presets
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm

ESTIMATES = ("series", "quasi_static", "dynamic")
ONCE = 3e-4  # rad, of the kinematic error


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build("paper").folder)


@pytest.fixture(scope="module")
def undamped(build: Callable[..., Compiled]) -> Arm:
    return Arm(
        build(find_presets()["paper"].read_text().replace("torsional_damping = 6.0", "torsional_damping = 0.0")).folder
    )


def law(arm: Arm, torque: float) -> float:
    """(11) of joint 1 with (2) within the law, rad."""
    p = {name: arm.parameters[f"{name}_1"] for name in ("flexspline_stiffness", "flexspline_stiffening", "ratio")}
    c_w, K_w = arm.parameters["wave_generator_stiffening_1"], arm.parameters["wave_generator_stiffness_1"]
    flexspline = np.arctan(p["flexspline_stiffening"] * torque) / (
        p["flexspline_stiffening"] * p["flexspline_stiffness"]
    )
    wound = np.sign(torque) * -np.expm1(-c_w * abs(torque) / p["ratio"]) / (c_w * p["ratio"] * K_w)
    return float(flexspline + wound)


def estimate(arm: Arm, theta: Array, q: Array, omega: Array, alpha: Array, torque: Array) -> dict[str, Array]:
    return arm.evaluate(
        "torque_estimate",
        motor_position=theta,
        joint_position=q,
        motor_velocity=omega,
        motor_acceleration=alpha,
        motor_torque=torque,
    )


def motion(arm: Arm, current: float = 1.6, seconds: float = 3.0) -> dict[str, Array]:
    """What exact sensors and an exact torque sensor read while both motors are driven to and fro, sliding and stuck."""
    h = 2e-4
    t = np.arange(round(seconds / h)) * h
    u = np.zeros((len(t), arm.nu))
    u[:, :2] = current * np.sin(2 * np.pi * t)[:, None]
    x = arm.rollout(arm.rest([0.5, 0.5]), u, h, exact=True)[:-1]
    true = arm.outputs(x, u)
    rate = arm.evaluate("rhs_exact", x=x, u=u, sliding=np.sign(true["motor_velocity"]))["rate"]
    constant = [arm.parameters[f"torque_constant_{j}"] for j in (1, 2)]
    spring = true["joint_torque"] - damping(arm, true)
    return {**true, "acceleration": rate[:, 4:6], "motor_torque": u[:, :2] * constant, "spring": spring}


def damping(arm: Arm, true: dict[str, Array]) -> Array:
    """Part of the joint torque that no estimate sees: torsional damping."""
    slip = true["motor_velocity"] / 100.0 - true["joint_velocity"]
    return np.array([arm.parameters[f"torsional_damping_{j}"] for j in (1, 2)]) * slip


def of(arm: Arm, data: dict[str, Array], **changed: Array) -> dict[str, Array]:
    d = {**data, **changed}
    keys = ("motor_position", "joint_position", "motor_velocity", "acceleration", "motor_torque")
    return estimate(arm, *(d[key] for key in keys))


def test_the_series_estimate_inverts_the_spring_law(arm: Arm) -> None:
    torque = np.concatenate([-np.geomspace(1e-6, 29.9, 200), [0.0], np.geomspace(1e-6, 29.9, 200)])
    phi = np.array([law(arm, value) for value in torque])
    theta = np.column_stack([100 * phi, 100 * phi])
    zero = np.zeros(2)
    found = estimate(arm, theta, zero, zero, zero, zero)["series"]
    assert np.abs(found - torque[:, None]).max() < 1e-9 * 30


def test_the_series_estimate_agrees_with_a_root_search(arm: Arm) -> None:
    for phi in np.linspace(1e-5, law(arm, 29.0), 30):
        root = brentq(lambda value, phi=phi: law(arm, value) - phi, 0.0, 30.0, xtol=1e-14)
        zero = np.zeros(2)
        assert abs(estimate(arm, np.full(2, 100 * phi), zero, zero, zero, zero)["series"][0] - root) < 1e-8


def test_the_dynamic_estimate_is_exact_while_sliding_and_the_quasi_static_is_not(undamped: Arm) -> None:
    data = motion(undamped)
    found = of(undamped, data)
    true, scale = data["spring"], np.abs(data["spring"]).max()
    sliding = np.abs(data["motor_velocity"]) > 1e-6
    assert sliding.mean() > 0.3
    assert np.abs(found["series"] - true).max() < 1e-8 * scale
    assert np.abs(found["dynamic"] - true)[sliding].max() < 1e-6 * scale
    fast = np.abs(data["acceleration"]) > 0.5 * np.abs(data["acceleration"]).max()
    assert np.abs(found["quasi_static"] - true)[fast & sliding].max() > 0.1 * scale


def test_damping_costs_the_dynamic_estimate_the_wave_generators_share(arm: Arm) -> None:
    """The wave generator feels the damping torque, which winds no flexspline: an error of at most its share, 28 %."""
    data = motion(arm)
    sliding = np.abs(data["motor_velocity"]) > 1e-6
    error, extra = np.abs(of(arm, data)["dynamic"] - data["spring"]), np.abs(damping(arm, data))
    assert (error <= 0.4 * extra + 1e-6)[sliding].all()  # 28 % of the compliance, 0.28/0.72 of the flexspline's
    assert error[sliding].max() > 0.2 * extra.max()


def test_every_estimate_is_right_at_rest(arm: Arm) -> None:
    """Sliding to a stop at constant torque, or stuck: (17) is made for it."""
    torque = np.array([[0.5, -0.5], [2.0, -3.0], [12.0, -9.0], [25.0, 25.0]])
    level = np.array([arm.parameters[f"coulomb_friction_{j}"] for j in (1, 2)])
    theta = 100 * arm.evaluate("torsion", joint_torque=torque)["torsion"]
    zero = np.zeros(2)
    motor = torque / 100 + np.sign(torque) * level  # just about to slide
    found = estimate(arm, theta, zero, zero, zero, motor)
    assert np.allclose(found["quasi_static"], torque, rtol=1e-9)
    stuck = estimate(arm, theta, zero, zero, zero, 0.9 * np.sign(motor) * level)
    assert np.allclose(stuck["quasi_static"], torque, rtol=1e-9)


def test_the_stiffness_level_scales_both_springs(undamped: Arm) -> None:
    undamped.parameters.update({"stiffness_level_1": 1.2, "stiffness_level_2": 0.8})
    data = motion(undamped, seconds=1.0)
    found, sliding = of(undamped, data), np.abs(data["motor_velocity"]) > 1e-6
    undamped.parameters.reset()
    scale = np.abs(data["spring"]).max()
    assert np.abs(found["series"] - data["spring"]).max() < 1e-8 * scale
    assert np.abs(found["dynamic"] - data["spring"])[sliding].max() < 1e-6 * scale


def test_beyond_the_law_the_estimates_go_on_along_the_tangent(arm: Arm) -> None:
    """Where tan would turn round to the other sign; monotone, continuous, as the spring itself."""
    zero, motor = np.zeros(2), np.full(2, 0.35)
    phi = np.linspace(0.0, 4e-3, 400)
    found = estimate(arm, np.column_stack([100 * phi] * 2), zero, np.ones(2), zero, motor)
    for name in ESTIMATES:
        assert (np.diff(found[name][:, 0]) > 0).all(), name
    slope = np.diff(found["dynamic"][:, 0]) / np.diff(phi)
    assert slope[-1] == pytest.approx(slope[-50], rel=1e-9)


def test_the_kinematic_error_is_taken_out_where_the_model_has_it(build: Callable[..., Compiled]) -> None:
    """With it the estimate is right; without it wrong by stiffness times the error."""
    stated = effect("kinematic_error", 1, kinematic_sine_once=ONCE)
    with_it = Arm(build(find_presets()["paper"].read_text() + stated).folder)
    without = Arm(build("paper").folder)
    data = motion(with_it, seconds=1.0)
    scale = np.abs(data["spring"]).max()
    right, wrong = of(with_it, data)["series"][:, 0], of(without, data)["series"][:, 0]
    error = ONCE * np.sin(data["motor_position"][:, 0])
    stiffness = tangent(without, right)
    predicted = -stiffness * error
    small = np.abs(right) < 0.3 * scale
    assert np.abs(wrong - right).max() > 0.5 * stiffness.min() * ONCE
    assert np.abs(wrong - right - predicted)[small].max() < 0.15 * stiffness.max() * ONCE
    true = data["joint_torque"][:, 0]
    quiet = np.abs(true - right) < np.abs(true - wrong)
    assert quiet.mean() > 0.9


def tangent(arm: Arm, torque: Array) -> Array:
    """dτ/dφ, N m/rad, by differences of the law."""
    step = 1e-4
    return np.array([2 * step / (law(arm, value + step) - law(arm, value - step)) for value in torque])


@pytest.mark.parametrize("counts", [2**17, 2**20])
def test_encoder_resolution_costs_what_it_must(arm: Arm, counts: int) -> None:
    """Rounding both encoders gives an error of stiffness × sqrt(Δ_q² + (Δ_θ/N)²)/√12, in the mean square."""
    data = motion(arm, seconds=2.0)
    joint, motor = 2 * np.pi / counts, 2 * np.pi / 4096
    coarse = of(
        arm,
        data,
        joint_position=np.round(data["joint_position"] / joint) * joint,
        motor_position=np.round(data["motor_position"] / motor) * motor,
    )["series"][:, 0]
    true = data["spring"][:, 0]
    stiffness = np.sqrt(np.mean(tangent(arm, true) ** 2))
    predicted = stiffness * np.hypot(joint, motor / 100) / np.sqrt(12)
    assert np.sqrt(np.mean((coarse - true) ** 2)) == pytest.approx(predicted, rel=0.15)


def test_a_rigid_drive_has_no_torsion_to_read(build: Callable[..., Compiled]) -> None:
    arm = Arm(build("emps").folder)
    zero = np.zeros(1)
    assert all(np.isnan(value).all() for value in estimate(arm, zero, zero, zero, zero, zero).values())
