"""Torque estimation on the prototype: the bars, with and without compensation, and what disturbs the start."""

from __future__ import annotations

import numpy as np
import pytest

from hdagen.paper.figures import estimation_validation
from hdagen.paper.figures.handle_forces import (
    LARGEST_ERROR_SHARE,
    LEAST_IMPROVEMENT,
    START_SECONDS,
    compare_causes,
    compare_compensation,
    compensating_model,
    errors_by_axis,
    push_handle,
)
from hdagen.paper.prototype.torque_estimator import column_rms, estimate_torques, integrate_hysteresis
from hdagen.paper.prototype.virtual_prototype import Bench, drive_arm, fine_sensors, make_encoders
from hdagen.simulation.simulated_sensors import Sensors


def test_in_motion_and_compensated_the_error_is_below_five_percent_of_the_peak(bench: Bench) -> None:
    """4096 counts at the motor, a disc of 2^18; at least three times better than uncompensated where both are
    defined."""
    run = push_handle(bench, True, fine_sensors())
    table = errors_by_axis(run, compare_compensation(bench, run, True))
    peak = np.abs(run.joint_torque).max(axis=0)
    ours, plain = np.array(table["compensated, whole"]), np.array(table["uncompensated, whole"])
    assert (ours < LARGEST_ERROR_SHARE * peak).all() and (plain > LEAST_IMPROVEMENT * ours).all()
    assert (np.abs(np.diff(run.log["joint_position_1"])) > 0).mean() > 0.3, "the arm moves"
    assert (np.array(table["compensated, torsion"]) > 2 * ours).all(), "what hysteresis and smoothing bring"


def test_from_current_and_disc_hall_sensors_reach_what_torsion_cannot(bench: Bench) -> None:
    run = push_handle(bench, True, None)
    table = errors_by_axis(run, compare_compensation(bench, run, False))
    raw, current = np.array(table["compensated, torsion"]), np.array(table["from current"])
    assert (raw > 3.0).all() and (current < 0.5).all()


def test_an_estimate_without_sensors_errors_is_exact_at_rest(bench: Bench) -> None:
    """The motor still, a load that rises and stays: the springs say it, once the hysteresis is wound up."""
    arm = bench.arm()
    time = np.arange(3000) * 1e-3
    push = np.zeros((3000, 2))
    push[:, 1] = 12.0 * np.clip(time / 2.0, 0, 1)
    run = drive_arm(arm, np.zeros((3000, 2)), push, [0.0, 0.6], Sensors.exact(2))
    found = estimate_torques(arm, run.log)
    assert np.abs(found.whole - run.joint_torque)[2600:].max() < 0.02 * np.abs(run.joint_torque).max()
    assert np.isnan(found.current[2600:]).all(), "nothing to say of a motor at rest"


def test_the_hysteresis_state_follows_its_equation() -> None:
    phi = 3e-4 * np.sin(np.linspace(0, 12, 4000))
    z = integrate_hysteresis(phi, 1e-4)
    exact = np.zeros(len(phi))
    for k in range(1, len(phi)):  # dz = (dφ − |dφ| z)/δ in a hundred steps
        step = (phi[k] - phi[k - 1]) / 100
        for _ in range(100):
            exact[k] = exact[k - 1] if not _ else exact[k]
            exact[k] += (step - abs(step) * exact[k]) / 1e-4
    assert np.abs(z - exact).max() < 1e-3 and np.abs(z).max() <= 1
    assert np.array_equal(integrate_hysteresis(phi, 0.0), np.zeros(len(phi)))


def test_the_start_up_error_has_a_cause_that_can_be_switched_off(bench: Bench) -> None:
    """A zero taken under load, until the disc's mark; the disc's tolerance instead errs from beginning to end."""
    found = compare_causes(bench)
    none, zeroed = found["none of these"], found["zero of the disc taken while held, until its mark comes by"]
    known = found["held by the handle when it begins"]
    assert zeroed[0] > 2 * known[0] and zeroed[0] > 2 * zeroed[1] and zeroed[1] == pytest.approx(known[1], rel=0.05)
    off_centre = found["disc off centre by 20 µm"]
    assert min(off_centre) > 10 * none[1]


def test_the_ratio_of_two_takes_another_second_arm(bench: Bench) -> None:
    """Fig. 9: 1.37 with Table I's J_a about each joint, as rigid joints say; 2 with a lighter second arm."""
    result = estimation_validation.make_fig9(bench)
    ratio, rotor = result.numbers["ratio"], 100.0**2 * 1.289e-4
    assert ratio["step"] == pytest.approx(estimation_validation.torque_ratio(0.876, 0.876, rotor), rel=0.01)
    assert ratio["lighter second arm"] == pytest.approx(2.0, rel=0.01)
    assert estimation_validation.torque_ratio(0.876, 0.876, 1e6) == pytest.approx(1.5, rel=1e-3)
    assert [claim.holds for claim in result.claims] == [False, True]


def test_finer_encoders_buy_better_torque(bench: Bench) -> None:
    known, zero = compensating_model(bench, True)
    errors = []
    for counts in (128, 1024, 16384):
        run = push_handle(bench, True, make_encoders(counts, 18))
        error = estimate_torques(known, run.log, zero).whole - run.joint_torque
        errors.append(column_rms(error, run.log.time >= START_SECONDS))
    assert (errors[1] < 0.5 * errors[0]).all()
    assert (errors[2] < 1.2 * errors[1]).all(), "from there on the disc decides"
