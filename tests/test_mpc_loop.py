"""Closed loops of the predictive controller: nearness to the ideal admittance, limits kept, estimator, fallbacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mpc_arms import WALLS, built

from hdagen.mpc.comparison import kept as held
from hdagen.mpc.comparison import random_runs, vary
from hdagen.mpc.controller import MPC
from hdagen.mpc.jolt import jolt
from hdagen.mpc.sensing import consistent
from hdagen.mpc.trials import Outcome, Trial, outcome, trial
from hdagen.plant import Arm, load
from hdagen.reference import circle
from hdagen.simulate import Push, Sensors, run

HARD = (Push(0.6, 1.2, (25.0, 0.0)), Push(1.5, 2.0, (0.0, 25.0)))


@pytest.fixture(scope="module")
def hard() -> tuple[Arm, Trial, Outcome]:
    """A loop pushed hard against a wall that bears 20 N and a fixture."""
    arm, c = built()
    path = circle(0.05, (0.2, 0.0), 5.0, 2.5)
    controller = MPC(arm, c)
    found = trial(arm, controller, path, HARD, Sensors(), WALLS, seed=1)
    return arm, found, outcome(arm, c, path, found, controller)


def test_limits_hold_where_the_ideal_motion_would_break_them(hard: tuple[Arm, Trial, Outcome]) -> None:
    arm, found, result = hard
    assert result.refused == 0
    assert held(arm, built()[1], result), result.violated
    assert 15.0 < result.contact < 25.0  # it presses, and not more than it may
    assert result.largest > 0.02  # the ideal motion would have gone through the wall
    assert max(r.active["wall"] for r in found.reports) > 3
    assert max(r.active["tip_speed"] for r in found.reports) > 3


def test_no_plan_runs_into_a_springs_pole(hard: tuple[Arm, Trial, Outcome]) -> None:
    """A flexspline stiffens towards a pole not far beyond the limit of its torque; a plan that was linearised there
    swings from tick to tick, by thousands of N m and hundreds of rad/s."""
    reports = hard[1].reports
    assert max(r.foreseen["motor_speed"] for r in reports) < 1.0
    assert max(r.foreseen["joint_torque"] for r in reports) < 200.0
    assert max(r.foreseen["tip_speed"] for r in reports) < 0.03
    assert all(r.solved == 0 for r in reports)


def test_a_force_that_comes_at_once_moves_the_tip_before_any_torque_answers() -> None:
    arm, _ = built()
    found = jolt(arm, np.array([[0.2, 0.05], [0.2, -0.05]]), 30.0)
    assert 0.001 < found.when < 0.01
    assert 0.02 < found.median < found.largest < 0.1
    assert abs(jolt(arm, np.array([[0.2, 0.05], [0.2, -0.05]]), 3.0).largest / found.largest - 0.1) < 0.02


def test_where_no_limit_is_near_the_tip_moves_as_the_ideal_admittance() -> None:
    arm, c = built()
    far = tuple(type(w)(w.normal, 10.0) for w in WALLS)
    c = c.changed(far, limits__tip_speed=1.0)
    path = circle(0.05, (0.2, 0.0), 5.0, 2.0)
    controller = MPC(arm, c)
    found = trial(arm, controller, path, [Push(0.8, 1.3, (15.0, 0.0))], Sensors(), (), seed=1)
    result = outcome(arm, c, path, found, controller)
    assert result.distance < 1e-4
    assert result.largest < 2.5e-3  # the push itself: no controller knows it before it comes
    assert (found.simulation.status >= 0).all()


@pytest.mark.parametrize("spread", [0.0, 0.1])
def test_the_estimator_is_consistent(spread: float) -> None:
    """Normalised innovations of 4 encoders have the mean 4, 95 % of them lie below chi-square's quantile, and
    neighbours are not alike; also where the arm is not quite the one that the filter knows."""
    arm, c = built()
    plant = load("paper", "portable", out=arm.folder.parent, mpc=c)
    if spread:
        vary(plant, np.random.default_rng(1))
    far = tuple(replace(w, offset=10.0) for w in WALLS)
    controller = MPC(arm, c.changed(far, limits__tip_speed=1.0))
    path = circle(0.05, (0.2, 0.0), 5.0, 2.0)
    found = consistent("", arm, trial(plant, controller, path, [Push(1.0, 1.5, (10.0, 5.0))], Sensors(), (), seed=2))
    assert found.readings == 4
    assert 3.0 < found.mean < 5.0
    assert 0.92 < found.below < 1.0
    assert abs(found.correlation) < 0.25


def test_a_measurement_that_is_given_again_or_lost_does_not_mislead_the_estimate() -> None:
    """The estimate of a loop in which every tenth sample comes twice, and the next one too late for its own tick."""
    arm, c = built()
    far = tuple(replace(w, offset=10.0) for w in WALLS)
    controller = MPC(arm, c.changed(far, limits__tip_speed=1.0))
    kept: dict[str, np.ndarray] = {}
    stamps = [0.0]

    def tick() -> None:
        if len(stamps) % 10 == 0:
            controller.measurement[:] = kept["last"]
        kept["last"] = controller.measurement.copy()
        stamps.append(float(controller.measurement[0]))
        controller.prepare()
        controller.step()
        seen.append(controller.report().x)

    seen: list[np.ndarray] = []
    controller.through(tick)
    path = circle(0.05, (0.2, 0.0), 5.0, 1.0)
    found = run(arm, controller, path, [Push(0.5, 0.8, (8.0, 0.0))], Sensors(), 3)
    controller.through(None)
    assert set(found.status) <= {0, 1, 4}
    assert 90 <= int(np.sum(found.status == 4)) <= 110
    wrong = np.abs(np.array(seen)[200:, : arm.n] - found.state[200:, : arm.n])
    assert np.median(wrong) < 1e-3  # rad at the motors: less than a count
    assert wrong.max() < 0.2


@pytest.mark.parametrize("size", [10.0, 20.0])
def test_the_momentum_observer_follows_a_step_of_force(size: float) -> None:
    """Its delay to half of the step, its bias on it, and no collision before it."""
    arm, c = built()
    far = tuple(type(w)(w.normal, 10.0) for w in WALLS)
    controller = MPC(arm, c.changed(far, limits__tip_speed=1.0))
    path = circle(0.03, (0.2, 0.0), 5.0, 1.4)
    found = trial(arm, controller, path, [Push(0.8, 1.4, (size, 0.0))], Sensors(), (), seed=3)
    seen = np.array([r.observed_force[0] for r in found.reports])
    half = int(np.argmax(seen[800:] > 0.5 * size))
    assert 2 <= half <= 40
    assert abs(np.mean(seen[1000:1200]) - size) < 0.3 * size
    called = np.array([r.collision for r in found.reports])
    assert not called[100:800].any()
    assert called[800 : 800 + 60].any()


def test_it_tracks_with_the_estimated_force_too() -> None:
    arm, c = built()
    far = tuple(type(w)(w.normal, 10.0) for w in WALLS)
    c = c.changed(far, admittance__force="estimate", limits__tip_speed=1.0)
    path = circle(0.03, (0.2, 0.0), 5.0, 1.2)
    controller = MPC(arm, c)
    found = trial(arm, controller, path, [Push(0.6, 1.0, (10.0, 0.0))], Sensors(), (), seed=3)
    assert (found.simulation.status >= 0).all()
    assert outcome(arm, c, path, found, controller).distance < 3e-3


@pytest.mark.parametrize("delay", [1, 3])
def test_a_delay_that_the_stamps_tell_of_is_carried_over(delay: int) -> None:
    arm, c = built()
    far = tuple(type(w)(w.normal, 10.0) for w in WALLS)
    c = c.changed(far, limits__tip_speed=1.0)
    path = circle(0.05, (0.2, 0.0), 5.0, 1.5)
    controller = MPC(arm, c)
    found = trial(arm, controller, path, [Push(0.8, 1.2, (10.0, 0.0))], Sensors(delay=delay), (), seed=2)
    assert outcome(arm, c, path, found, controller).distance < 2e-4


def test_the_same_seed_gives_the_same_run() -> None:
    arm, c = built()
    path = circle(0.05, (0.2, 0.0), 5.0, 0.3)
    one, other = (trial(arm, MPC(arm, c), path, HARD, Sensors(), WALLS, seed=5).simulation.torque for _ in range(2))
    assert np.array_equal(one, other)


@pytest.mark.parametrize("count", [2, pytest.param(1000, marks=pytest.mark.campaign)])
def test_random_runs_keep_every_limit_and_follow_no_worse_than_the_admittance_law(count: int) -> None:
    """Pushes, parameters, noise and delay at random; the law's gains are those that `hdagen mpc table` tunes."""
    tuned = {"bandwidth": 74.2, "observer_bandwidth": 52.8, "velocity_cutoff": 136.8}
    ratios = []
    for one in random_runs(count, tuned, "portable", out=built()[0].folder.parent):
        assert one.legal, one
        assert one.kept, one
        ratios.append(one.free.distance / one.admittance.distance)
    assert np.median(ratios) <= 1.0
    assert max(ratios) <= 1.1
