"""From commands to what acts: delay, limits and lag against their definitions, exact identities, rows one by one."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from arms import WHOLE
from compiled import Compiled, Floats
from numpy.typing import NDArray
from replayed import FLEXIBLE, RIGID, RIGID_SEVERAL

from gen.effects import ALL
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.input_stage import InputStage
from hdagen.diagnosis.initialization.initial_guess import split_input_effects

NAMES = tuple(effect.name for effect in ALL)
ROWS = 200
BEFORE = np.array([0.7, -0.3])


@pytest.fixture
def arm(build: Callable[..., Compiled]) -> Arm:
    """The flexible arm with every effect, all amplitudes 0."""
    return Arm(build(FLEXIBLE, effects=NAMES).folder)


def motion(seed: int = 0) -> tuple[Floats, Floats]:
    """Commands (ROWS, 2), A, and uneven times for which they are held, s."""
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, 3.0, (ROWS, 2)), rng.uniform(0.6e-3, 1.4e-3, ROWS)


def bits(values: Floats) -> NDArray[np.int64]:
    return np.ascontiguousarray(values).view(np.int64)


def fine(command: Floats, dt: Floats, delay: float, lag: float, parts: int = 2000) -> tuple[Floats, Floats]:
    """Mean over each row and value at its end of one joint's current after ``delay`` and ``lag``, in small steps."""
    start = np.concatenate([[0.0], np.cumsum(dt)])
    mean, end, y = np.empty(ROWS), np.empty(ROWS), BEFORE[0]
    for k in range(ROWS):
        t = start[k] + (np.arange(parts) + 0.5) * dt[k] / parts - delay
        held = np.searchsorted(start, t, side="right") - 1
        u = np.where(held >= 0, command[np.clip(held, 0, None)], BEFORE[0])
        left, total = np.exp(-dt[k] / parts / lag) if lag else 0.0, 0.0
        for value in u if lag else ():
            after = value + (y - value) * left
            total += value + (y - value) * (1 - left) * lag / (dt[k] / parts)
            y = after
        mean[k], end[k] = (total / parts, y) if lag else (u.mean(), u[-1])
    return mean, end


# -- identities -------------------------------------------------------------------------------------------------------


def test_without_amplitudes_the_command_acts_to_the_bit(arm: Arm) -> None:
    command, dt = motion()
    command[0], command[1] = [0.0, -0.0], [5e-324, -1e300]
    mean, at = arm.apply_input_stage(command, dt, BEFORE)
    assert np.array_equal(bits(mean), bits(command))
    assert np.array_equal(bits(at), bits(np.vstack([BEFORE, command[:-1]])))


def test_a_model_without_input_effects_has_the_same_stage(build: Callable[..., Compiled], arm: Arm) -> None:
    plain = Arm(build(FLEXIBLE).folder)
    assert arm.has_input_stage and not plain.has_input_stage
    command, dt = motion()
    for ours, theirs in zip(
        plain.apply_input_stage(command, dt, BEFORE), arm.apply_input_stage(command, dt, BEFORE), strict=True
    ):
        assert np.array_equal(bits(ours), bits(theirs))


@pytest.mark.parametrize(
    "built", [(FLEXIBLE, "portable", NAMES), ("paper", "native", WHOLE)], ids=["portable", "native"]
)
def test_a_row_at_a_time_is_the_whole_log(
    build: Callable[..., Compiled], built: tuple[str, str, tuple[str, ...]]
) -> None:
    arm = Arm(build(*built).folder)
    arm.parameters.update({"command_delay_1": 2.3e-3, "current_lag_2": 1e-3, "saturation_inverse_2": 0.4})
    command, dt = motion()
    mean, at = arm.apply_input_stage(command, dt, BEFORE)
    stage = InputStage(arm, BEFORE)
    for k in range(ROWS):
        assert np.array_equal(stage.end, at[k])
        assert np.array_equal(stage.step(command[k], dt[k]), mean[k])


# -- definitions ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rows", [1, 3, 50])
def test_a_delay_of_whole_rows_shifts_them(arm: Arm, rows: int) -> None:
    """The rows are powers of two long, so that no rounding splits them."""
    command, _ = motion()
    dt = 2.0**-10
    arm.parameters["command_delay_1"] = rows * dt
    mean, at = arm.apply_input_stage(command, dt, BEFORE)
    shifted = np.concatenate([np.full(rows, BEFORE[0]), command[:-rows, 0]])
    assert np.array_equal(mean[:, 0], shifted)
    assert np.array_equal(at[:, 0], np.append(BEFORE[0], shifted[:-1]))
    assert np.array_equal(mean[:, 1], command[:, 1])


@pytest.mark.parametrize(("delay", "lag"), [(0.37e-3, 0.0), (4.9e-3, 0.0), (0.0, 0.4e-3), (0.0, 7e-3)])
def test_delay_and_lag_are_exact(arm: Arm, delay: float, lag: float) -> None:
    """Against the definition in steps of half a microsecond, over uneven rows."""
    command, dt = motion()
    arm.parameters.update({"command_delay_1": delay, "current_lag_1": lag})
    mean, at = arm.apply_input_stage(command, dt, BEFORE)
    expected, end = fine(command[:, 0], dt, delay, lag)
    assert np.abs(mean[:, 0] - expected).max() < (1e-9 if lag else 4e-3), "a sum of 2000 parts is as fine as that"
    assert np.abs(at[1:, 0] - end[:-1]).max() < 1e-9


@pytest.mark.parametrize(("delay", "lag"), [(0.37e-3, 0.4e-3), (2.4e-3, 3e-3), (4.9e-3, 0.05e-3)])
def test_a_delayed_command_is_lagged_exactly_too(arm: Arm, delay: float, lag: float) -> None:
    """To what a sum of small steps is exact: a jump of the command within one of them is misplaced by as much."""
    command, dt = motion()
    arm.parameters.update({"command_delay_1": delay, "current_lag_1": lag})
    mean, at = arm.apply_input_stage(command, dt, BEFORE)
    expected, end = fine(command[:, 0], dt, delay, lag, 8000)
    worst = np.abs(np.diff(command[:, 0])).max() * dt.max() / 8000 / min(lag, 1e-3)
    assert np.abs(mean[:, 0] - expected).max() < worst
    assert np.abs(at[1:, 0] - end[:-1]).max() < worst


@pytest.mark.parametrize("delay", [0.0, 0.12e-3, 1.7e-3])
def test_a_lag_that_vanishes_leaves_the_delay_alone(arm: Arm, delay: float) -> None:
    """A search moves both: where they part by a step, no fit gets from one to the other."""
    command, dt = motion()
    arm.parameters["command_delay_1"] = delay
    without = np.stack(arm.apply_input_stage(command, dt, BEFORE))
    for lag in (1e-12, 1e-9, 1e-7):
        arm.parameters["current_lag_1"] = lag
        assert (
            np.abs(np.stack(arm.apply_input_stage(command, dt, BEFORE)) - without).max() < 20.0 * lag / dt.min() + 1e-12
        )


def test_limits_and_sag_are_what_their_equations_say(arm: Arm) -> None:
    command, dt = motion()
    arm.parameters.update({"saturation_inverse_1": 0.5, "voltage_sag_2": 0.1})
    mean, _ = arm.apply_input_stage(3 * command, dt, BEFORE)
    assert np.allclose(mean[:, 0], np.clip(3 * command[:, 0], -2.0, 2.0), rtol=1e-15)
    size = np.minimum(np.abs(3 * command[:, 1]), 5.0)  # the most that comes through is at 1/(2 a)
    assert np.allclose(mean[:, 1], np.sign(command[:, 1]) * size * (1 - 0.1 * size), rtol=1e-14)
    assert (np.abs(3 * command[:, 1]) > 5.0).any()


def test_the_order_is_delay_limit_lag(arm: Arm) -> None:
    """A step of 8 A that is limited to 2 A and then lags comes from 0 to 2 A; lagged first it would jump there."""
    arm.parameters.update({"command_delay_1": 2e-3, "saturation_inverse_1": 0.5, "current_lag_1": 5e-3})
    _, at = arm.apply_input_stage(np.full((40, 2), 8.0), 1e-3, np.zeros(2))
    t = np.arange(40) * 1e-3 - 2e-3
    assert at[:, 0] == pytest.approx(np.where(t > 0, 2.0 * (1 - np.exp(-t / 5e-3)), 0.0), abs=1e-12)


# -- what a search asks for -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["command_delay_1", "current_lag_1", "saturation_inverse_1", "voltage_sag_1"])
def test_what_moves_is_continuous_in_the_parameters(arm: Arm, name: str) -> None:
    """Small changes of a parameter are small changes of the current, from 0 on and across whole rows; what a sensor
    reads at an instant jumps where a late command arrives there."""
    command, dt = motion()
    top = {"command_delay_1": 4e-3, "current_lag_1": 4e-3, "saturation_inverse_1": 1.0, "voltage_sag_1": 0.2}[name]
    found = []
    for value in np.linspace(0.0, top, 401):
        arm.parameters[name] = value
        found.append(np.stack(arm.apply_input_stage(command, dt, BEFORE)[: 1 if name == "command_delay_1" else 2]))
    steps = np.abs(np.diff(found, axis=0)).max(axis=(1, 2, 3))
    assert 0.0 < steps.max() < 0.15 * np.abs(command).max()
    assert np.abs(found[-1] - found[0]).max() > 0.5


def test_what_one_effect_stands_in_for_is_parted_by_the_currents(arm: Arm) -> None:
    """A delay and a lag, of which a fit has only the delay, as long as both."""
    command, _ = motion()
    dt, shown = np.full(ROWS, 1e-3), np.ones(ROWS, bool)
    arm.parameters.update({"command_delay_1": 3.4e-3, "current_lag_1": 2e-3})
    _, at = arm.apply_input_stage(command, dt, BEFORE)
    record: Any = SimpleNamespace(
        log={"motor_current_1": at[:, 0]}, command=command, time_steps=dt, initial_input=BEFORE, visible_rows=shown
    )
    p = np.array([q.nominal for q in arm.parameters.described.values()])
    p[list(arm.parameters.described).index("command_delay_1")] = 5.4e-3
    own = arm.p.copy()
    delay, lag = split_input_effects(arm, record, p, "command_delay_1", "current_lag_1", 1)
    assert np.array_equal(arm.p, own)  # the arm is as it was
    assert delay == pytest.approx(3.4e-3, abs=0.5e-3)
    assert lag == pytest.approx(2e-3, rel=0.5)


def test_a_delay_beyond_the_memory_finds_the_oldest_row(arm: Arm) -> None:
    """512 rows of 10 µs reach 5 ms back: nothing is read that is not there."""
    command = np.random.default_rng(3).normal(size=(2000, 2))
    arm.parameters["command_delay_1"] = 0.02
    mean, _ = arm.apply_input_stage(command, 1e-5, BEFORE)
    assert np.array_equal(mean[600:, 0], command[600 - 511 : 2000 - 511, 0])


def test_torque_driven_robots_are_delayed_and_limited_alike(build: Callable[..., Compiled]) -> None:
    arm = Arm(build(RIGID, effects=RIGID_SEVERAL).folder)
    assert arm.parameters.described["saturation_inverse_1"].unit == "1/(N m)"
    arm.parameters["saturation_inverse_1"] = 4.0
    assert arm.apply_input_stage([[1.0, 1.0]], 1e-3, [0.0, 0.0])[0] == pytest.approx(np.array([[0.25, 1.0]]))


def test_misuse_is_refused(arm: Arm) -> None:
    for command, before, said in (
        (np.zeros((3, 1)), BEFORE, r"command must be \(T, 2\)"),
        (np.zeros((0, 2)), BEFORE, "a row or more"),
        (np.zeros((3, 2)), [0.0], "before must have 2 entries"),
        (np.full((3, 2), np.nan), BEFORE, "command holds NaN"),
    ):
        with pytest.raises(PlantError, match=said):
            arm.apply_input_stage(command, 1e-3, before)
