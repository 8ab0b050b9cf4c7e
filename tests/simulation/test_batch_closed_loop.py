"""Closed loops in lanes: the same as the simulation one by one, every lane its own, and refused in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from compiled import Compiled

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import circle
from hdagen.paper.prototype.virtual_prototype import fine_sensors, make_controller
from hdagen.simulation.batch_closed_loop import MOST_DELAY_TICKS, closed_loops
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push, run

PATH = circle(0.05, (0.2, 0.0), 2.0, 1.2)
PUSHES = (Push(0.4, 0.6, (10.0, 0.0)), Push(0.8, 1.0, (0.0, -8.0)))
FRICTIONLESS = {"coulomb_friction_1": 0.0, "coulomb_friction_2": 0.0}
Loaded = Callable[..., Arm]


@pytest.fixture(scope="module")
def load(build: Callable[..., Compiled]) -> Loaded:
    def loaded(robot: str, profile: str, **changes: float) -> Arm:
        arm = Arm(build(robot, profile).folder)
        arm.parameters.update(changes)
        return arm

    return loaded


def trajectories(tip: Array, _: Array) -> Array:
    """What `closed_loops` is asked for: the whole path of each set."""
    return tip.transpose(1, 0, 2).reshape(tip.shape[1], -1)


def law(arm: Arm, name: str) -> Controller:
    return Controller(arm, name, Guard(Safe.DAMPING, safe_damping=(2e-3, 2e-3), motor_jump=(2.0, 2.0)))


@pytest.mark.parametrize("profile", ["native", "portable"])
@pytest.mark.parametrize(
    "name", ["impedance_cartesian", "admittance_cartesian", "impedance_joint", "admittance_joint", "position"]
)
def test_without_dry_friction_it_is_the_simulation(load: Loaded, profile: str, name: str) -> None:
    """Two independent loops, one in Python over compiled ticks and one in lanes, to 1e-9 m."""
    arm = load("paper", profile, **FRICTIONLESS)
    sensors = Sensors(force_noise=0.2, delay=2)
    regulator = law(arm, name)
    alone = run(arm, regulator, PATH, PUSHES, sensors, seed=3)
    found = closed_loops(arm, regulator, PATH, {"bandwidth": [50.0]}, trajectories, PUSHES, sensors, seed=3)
    assert np.abs(found[0].reshape(-1, 2) - alone.tip).max() < 1e-9
    assert np.ptp(alone.tip, axis=0).max() > 0.05 and (alone.status >= 0).all()


def test_with_everything_the_prototype_has(load: Loaded) -> None:
    """Current loop, delay on the bus, saturation, torsion, hysteresis, Hall sensors; a controller that knows less."""
    plant = load("paper_prototype", "native", **FRICTIONLESS)
    known = load("paper_prototype", "native", ratio_error_1=0.0, coulomb_friction_1=0.0)
    regulator = make_controller(known, "impedance", {"mass_x": 3.0})
    alone = run(plant, regulator, PATH, PUSHES, Sensors(delay=1), seed=5)
    sets = {"mass_x": [3.0], "stiffness_y": [500.0]}
    found = closed_loops(plant, regulator, PATH, sets, trajectories, PUSHES, Sensors(delay=1), seed=5)
    assert np.abs(found[0].reshape(-1, 2) - alone.tip).max() < 1e-7
    assert (alone.torque != 0).any() and (alone.status == 1).any(), "the rate limit is met in both"


def test_dry_friction_is_smooth_and_says_by_how_much_that_differs(load: Loaded) -> None:
    arm = load("paper", "native")
    regulator = law(arm, "admittance_cartesian")
    exact = run(arm, regulator, PATH, PUSHES, fine_sensors(), seed=1)
    found = closed_loops(arm, regulator, PATH, {"mass_x": [2.0]}, trajectories, PUSHES, fine_sensors(), seed=1)
    apart = np.abs(found[0].reshape(-1, 2) - exact.tip).max()
    assert 1e-7 < apart < 2e-4


def test_every_lane_is_its_own(load: Loaded) -> None:
    """More sets than lanes, all different: each as if it were alone, in the order in which they were given."""
    arm = load("paper", "native")
    regulator = law(arm, "impedance_cartesian")
    count = arm.module.batch_width + 3
    masses, springs = np.linspace(1, 8, count), np.linspace(900, 300, count)
    sets = {"mass_x": masses, "mass_y": masses, "stiffness_x": springs}
    together = closed_loops(arm, regulator, PATH, sets, trajectories, PUSHES, threads=2)
    for k in (0, 1, arm.module.batch_width, count - 1):
        one = {name: values[k : k + 1] for name, values in sets.items()}
        assert np.array_equal(closed_loops(arm, regulator, PATH, one, trajectories, PUSHES)[0], together[k])
    assert np.unique(together.round(9), axis=0).shape[0] == count


def test_a_lost_trajectory_leaves_the_others_alone(load: Loaded) -> None:
    arm = load("paper", "native")
    regulator = law(arm, "impedance_cartesian")
    sets = {"mass_x": [2.0, 1e-9, 2.0], "damping_x": [45.0, 1e6, 45.0]}
    found = closed_loops(arm, regulator, PATH, sets, trajectories, PUSHES)
    alone = closed_loops(arm, regulator, PATH, {"mass_x": [2.0]}, trajectories, PUSHES)
    assert np.array_equal(found[0], alone[0]) and np.array_equal(found[2], alone[0])
    assert not np.allclose(found[1], alone[0], equal_nan=True)


def test_wrong_sets_are_refused_all_at_once(load: Loaded) -> None:
    arm = load("paper", "native")
    regulator = law(arm, "admittance_cartesian")
    with pytest.raises(PlantError) as caught:
        closed_loops(arm, regulator, PATH, {"mass": [1.0], "mass_x": [1.0, -2.0], "period": [1e-3]}, trajectories)
    said = str(caught.value).splitlines()
    assert len(said) == 4 and "no gain named mass; there are" in said[0] and "no gain named period" in said[1]
    assert "arrays of one length" in said[2] and "mass_x leaves 1e-09 to 1e+06 kg" in said[3]
    with pytest.raises(PlantError, match="of another build"):
        closed_loops(load("paper", "portable"), regulator, PATH, {"mass_x": [1.0]}, trajectories)
    tables: list[dict[str, Any]] = [{}, {"mass_x": []}, {"mass_x": [[1.0]]}]
    for wrong in tables:
        with pytest.raises(PlantError, match="one or more sets"):
            closed_loops(arm, regulator, PATH, wrong, trajectories)
    with pytest.raises(PlantError, match=f"more than closed loops in lanes take, {MOST_DELAY_TICKS}"):
        closed_loops(
            arm,
            regulator,
            PATH,
            {"mass_x": [1.0]},
            trajectories,
            sensors=replace(Sensors(), delay=MOST_DELAY_TICKS + 1),
        )
