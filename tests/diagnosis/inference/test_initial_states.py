"""Windows begin where the sensors say; a side of a gear without encoder is estimated from the rows before."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, SEVERAL, simulated

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_rated_torque, compute_rated_torsion
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import WindowedRecord, cut_windows
from hdagen.diagnosis.inference.initial_states import InitialStates
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.log.measured_log import Log

Builder = Callable[..., Compiled]
SIDES = ("motor", "joint")


@pytest.fixture(scope="module")
def arm(build: Builder) -> Arm:
    return Arm(build(FLEXIBLE, "portable", SEVERAL).folder)


@pytest.fixture(scope="module")
def log(arm: Arm) -> Log:
    return simulated(arm)


def select_sides(log: Log, *sides: str) -> Log:
    """The log with the encoders of these sides alone."""
    dropped = [f"{side}_position" for side in SIDES if side not in sides]
    kept = {name: values for name, values in log.columns.items() if name.rpartition("_")[0] not in dropped}
    return Log(log.time, kept, log.n_joints, log.source)


def cut(arm: Arm, log: Log, hidden: slice = slice(0, 0)) -> WindowedRecord:
    shown = np.ones(len(log), bool)
    shown[hidden] = False
    return cut_windows(arm, LogPortion(log, shown), 0.05)


def read_torsions(arm: Arm, x: Array) -> Array:
    """Torsions (W, n) of states."""
    n = arm.n
    ratios = np.array([arm.parameters[f"ratio_{j}"] for j in range(1, n + 1)])
    sides = ([arm.index(f"{side}_position_{j}") for j in range(1, n + 1)] for side in SIDES)
    motor, joint = (x[:, side] for side in sides)
    return np.asarray(motor / ratios - joint)


@pytest.mark.parametrize("side", SIDES)
def test_a_torsion_that_no_encoder_tells_is_filtered(arm: Arm, log: Log, side: str) -> None:
    both, one = cut(arm, log), cut(arm, select_sides(log, side))
    load = np.zeros(arm.n)
    true = read_torsions(arm, InitialStates(arm, both, load).read(arm))  # both encoders, with their steps alone
    filtered = read_torsions(arm, InitialStates(arm, one, load).read(arm))
    at_rest = read_torsions(arm, one.initial_states)
    late = one.starts > 100
    errors = [np.sqrt(np.mean((found - true)[late] ** 2, axis=0)) for found in (filtered, at_rest)]
    assert (errors[0] < 0.5 * errors[1]).all()
    seen = [arm.index(f"{side}_position_{j}") for j in range(1, arm.n + 1)]
    other = [arm.index(f"{other}_position_{j}") for other in SIDES if other != side for j in range(1, arm.n + 1)]
    found = InitialStates(arm, one, load).read(arm)
    np.testing.assert_allclose(found[:, seen], one.initial_states[:, seen], rtol=0, atol=1e-12)
    assert (found[late][:, other] != one.initial_states[late][:, other]).any()


def test_a_softer_gear_is_filtered_with_its_own_torsion(arm: Arm, log: Log) -> None:
    states = InitialStates(arm, cut(arm, select_sides(log, "motor")), np.zeros(arm.n))
    p = arm.p.copy()
    p[arm.parameters.index("flexspline_stiffness_1")] *= 0.5
    soft = arm.with_parameters(p)
    np.testing.assert_array_equal(states.read(soft), states.read(arm))  # the sensors know nothing of stiffness
    selected = states.record.selected_windows
    late = selected[states.record.starts[selected] > 100]
    usual, twisted = (read_torsions(arm, states.filter(one, selected))[late, 0] for one in (arm, soft))
    assert np.std(twisted) > 1.2 * np.std(usual)


def test_two_encoders_leave_nothing_to_filter(arm: Arm, log: Log) -> None:
    states = InitialStates(arm, cut(arm, log), np.zeros(arm.n))
    p = arm.p.copy()
    p[arm.parameters.index("mass_1")] *= 2.0
    soft = arm.with_parameters(p)
    np.testing.assert_array_equal(states.filter(soft, states.record.selected_windows), states.read(arm))


def test_no_filter_looks_at_what_is_held_out(arm: Arm, log: Log) -> None:
    hidden, rng = slice(400, 600), np.random.default_rng(2)
    one = select_sides(log, "motor")
    deep = np.zeros(len(log))
    deep[420:580] = 1e-3
    other = {name: values + deep * rng.normal(size=len(log)) * ("position" in name)
             for name, values in one.columns.items()}  # fmt: skip
    records = [cut(arm, each, hidden) for each in (one, Log(one.time, other, one.n_joints, one.source))]
    kept = records[0].selected_windows
    assert (records[0].starts[kept] > 600).any()
    plain, changed = (InitialStates(arm, record, np.zeros(arm.n)).filter(arm, kept)[kept] for record in records)
    np.testing.assert_array_equal(changed, plain)


def test_a_spring_begins_with_what_the_motion_asks_of_it(arm: Arm, log: Log) -> None:
    """A robot file may state no rating, or one below the torque of the motion."""
    record = cut(arm, log)
    joint = arm.index("joint_position_1")
    record.initial_states[:, joint] -= 10.0  # far from its motor
    low, high = 0.1 * compute_rated_torque(arm), 3.0 * compute_rated_torque(arm)
    small, large = (InitialStates(arm, record, load).read(arm) for load in (low, high))
    rated = compute_rated_torsion(arm)[0]
    np.testing.assert_allclose(read_torsions(arm, small)[:, 0], LIKELIHOOD.initial_torsion_limit * rated, rtol=1e-9)
    wanted = arm.evaluate("torsion", joint_torque=high)["torsion"][0]
    np.testing.assert_allclose(read_torsions(arm, large)[:, 0], abs(wanted), rtol=1e-9)
