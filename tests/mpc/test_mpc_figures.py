"""What the predictive controller's commands print: growth, the price of a closed loop, detection, bars."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mpc_arms import WALLS, built

from hdagen.arm.compiled_arm import load
from hdagen.control.reference_motion import circle
from hdagen.mpc.benchmark.estimator_consistency import SensingResult, measure_detection
from hdagen.mpc.benchmark.estimator_consistency import format_sensing as sensed
from hdagen.mpc.benchmark.requirements import MpcRequirement
from hdagen.mpc.benchmark.scaling import fit_exponent, format_chain_robot
from hdagen.mpc.benchmark.sqp_convergence import LoopCosts, compute_loop_cost, format_loop_costs
from hdagen.mpc.closed_loop_trial import run_trial
from hdagen.mpc.predictive_controller import MPC
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push


def test_growth_is_the_exponent() -> None:
    sizes = [10, 20, 50, 100]
    assert abs(fit_exponent(sizes, [3.0 * n for n in sizes]) - 1) < 1e-12
    assert abs(fit_exponent(sizes, [0.1 * n**3 for n in sizes]) - 3) < 1e-12


def test_a_chain_of_three_is_a_robot_with_the_controller_in_it(tmp_path: Path) -> None:
    arm, c = built(nodes=7, space="joint", walls=0)
    c = c.with_changes(tuple(replace(w, offset=10.0) for w in WALLS))
    path = tmp_path / "robot.toml"
    path.write_text(format_chain_robot(arm.robot, 3))
    found = load(path, out=arm.folder.parent, mpc=c)
    assert found.n == 3
    controller = MPC(found, c)
    controller.path[:, :3] = 0.3
    ratio = np.array([found.parameters[f"ratio_{j}"] for j in (1, 2, 3)])
    for k in range(20):
        q = np.full(3, 0.3)
        assert controller.tick(k * 1e-3, motor_position=ratio * q, joint_position=q, tip_force=(0.0, 0.0)) == 0
        controller.prepare()


def test_one_step_a_tick_costs_no_more_than_the_converged_problem_where_no_limit_is_near() -> None:
    arm, c = built()
    far = c.with_changes(tuple(replace(w, offset=10.0) for w in WALLS), limits__tip_speed=1.0)
    path = circle(0.05, (0.2, 0.0), 5.0, 1.6)
    prices = []
    for steps in (1, 20):
        controller = MPC(arm, far.with_changes(far.walls, mpc__steps=steps))
        found = run_trial(arm, controller, path, [Push(0.6, 1.0, (15.0, 0.0))], Sensors(), (), seed=1)
        prices.append(compute_loop_cost(arm, far, path, found, controller))
    assert prices[1] > 0
    assert abs(prices[0] / prices[1] - 1) < 0.01  # noise differs by as much over so short a run
    said = format_loop_costs((LoopCosts("course", prices[0], prices[1], prices[0] / prices[1] - 1, 0.0),))
    assert "bar: at most +0.5%" in said[1]


def test_hits_are_called_collisions_within_a_stated_time() -> None:
    arm, c = built()
    far = c.with_changes(tuple(replace(w, offset=10.0) for w in WALLS), limits__tip_speed=1.0)
    found = measure_detection(arm, MPC(arm, far), 15.0, hits=6)
    assert found.share == 1.0
    assert 0.001 < found.median < 0.015
    assert found.largest < 0.02
    said = sensed(SensingResult((), (), (found,), 6.0, 0, 360.0))
    assert "fewer than 30 an hour" in said[-1]


@pytest.mark.parametrize(
    "kind, asked, reached, met", [("least", 10.0, 12.0, True), ("least", 10.0, 9.0, False), ("most", 6.0, 6.5, False)]
)
def test_a_bar_says_whether_it_is_met(kind: str, asked: float, reached: float, met: bool) -> None:
    assert MpcRequirement("x", kind, asked, reached).is_met is met
