"""Force error of the inverse dynamics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from replayed import FLEXIBLE, RIGID, simulated, smooth

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.driving_inputs import read_driving_inputs
from hdagen.prediction.inverse_dynamics import compute_force_error


@pytest.fixture(scope="module")
def made(build: Callable) -> Callable[..., Arm]:
    """made(text, effects=()) -> a fresh Arm."""
    return lambda robot, effects=(): Arm(build(robot, "portable", effects).folder)


def test_the_force_error_of_a_true_model_is_small_and_grows_with_what_is_wrong(made: Callable) -> None:
    arm = made(RIGID)
    log = smooth(arm)
    inputs, _ = read_driving_inputs(arm, log, "command")
    true = compute_force_error(arm, log, inputs)
    assert true.relative.max() < 0.02
    assert true.measured.shape == true.modelled.shape == (len(true.time), 2)
    assert np.interp(true.time, log.time, inputs[:, 0]) == pytest.approx(true.measured[:, 0], abs=0.01)
    arm.parameters.update(coulomb_friction_1=0.06)
    wrong = compute_force_error(arm, log, inputs).relative
    assert wrong[0] > 5 * true.relative[0] and wrong[1] == pytest.approx(true.relative[1], rel=0.2)


def test_the_force_error_refuses_springs_and_slow_logs(made: Callable) -> None:
    with pytest.raises(PlantError, match="needs rigid drives"):
        compute_force_error(
            flexible := made(FLEXIBLE),
            log := simulated(flexible, 0.3),
            read_driving_inputs(flexible, log, "command")[0],
        )
    rigid = made(RIGID)
    log = smooth(rigid)
    slow = Log(log.time[::5], {n: v[::5] for n, v in log.columns.items()}, 2, "slow")
    with pytest.raises(LogError, match="at 200 Hz are too few"):
        compute_force_error(rigid, slow, read_driving_inputs(rigid, slow, "command")[0])
