"""What a verdict changes for a controller: nothing where it says nothing, and the closed form of a press."""

import dataclasses

import numpy as np
import pytest
from replayed import simulated

from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.diagnosis.residuals.controller_impact import CONTROL_LAW, PRESS_DEPTH, WALL_STIFFNESS, compare_controllers


def test_a_verdict_that_changes_nothing_changes_nothing() -> None:
    plain = load("paper")
    found = compare_controllers(plain, Arm(plain.folder), simulated(plain, 3.0))
    assert found.tracking[0] == found.tracking[1] and found.force[0] == found.force[1]
    assert 0.0 < found.tracking[0] < 5e-3


def test_a_press_is_that_of_the_joints_stiffness_and_the_wall_in_series() -> None:
    plain = load("paper")
    log = simulated(plain, 3.0)
    q = np.stack([log[f"joint_position_{j}"] for j in (1, 2)], 1)
    middle = 0.5 * np.quantile(q, (0.2, 0.8), axis=0).sum(0)
    tip = plain.evaluate("points", q=middle)["points"][-2:]
    reach = float(np.linalg.norm(tip))
    gains = Controller(plain, CONTROL_LAW, Guard(Safe.DAMPING, torque_rate=(1e3, 1e3), safe_damping=(0.02, 0.02))).gains
    stiffness = gains[next(name for name in gains if name.startswith("stiffness"))]
    expected = PRESS_DEPTH / (1.0 / WALL_STIFFNESS + reach**2 / stiffness)
    force = compare_controllers(plain, plain, log).force[1]
    assert expected == pytest.approx(force, rel=0.3)  # the largest on the way: a little above that at rest


def test_a_load_that_the_controller_does_not_know_leads_it_astray() -> None:
    plain, machine = load("paper"), load("paper")
    machine.parameters["mass_2"] = 3.0 * machine.parameters.described["mass_2"].nominal
    found = compare_controllers(plain, machine, simulated(plain, 3.0))
    assert found.tracking[0] > 1.05 * found.tracking[1]
    assert set(found.content) == {"law", "tracking", "contact_force"}
    assert dataclasses.asdict(found)["force"] == found.force
