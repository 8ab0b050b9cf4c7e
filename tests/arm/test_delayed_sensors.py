"""Encoders that are read late, against the angle that a ringing joint had then; across windows and gaps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from arms import arm as text
from compiled import Compiled
from scipy.interpolate import CubicHermiteSpline

from hdagen.arm import delayed_sensors
from hdagen.arm.compiled_arm import Arm

Builder = Callable[..., Compiled]
HERTZ, PERIOD = 120.0, 1e-3
ROBOT = text("RR", rigid="rf")  # a rigid drive and one with springs
EFFECTS = ("sensor_delay", "encoder_bias", "encoder_eccentricity")


@pytest.fixture
def arm(build: Builder) -> Arm:
    return Arm(build(ROBOT, effects=EFFECTS).folder)


def ringing(arm: Arm, time: np.ndarray) -> np.ndarray:
    """States with both joints ringing."""
    x = np.zeros((len(time), arm.nx))
    w = 2 * np.pi * HERTZ
    for j in (1, 2):
        x[:, arm.index(f"joint_position_{j}")] = 1e-3 * np.sin(w * time) + 0.3 * time
        x[:, arm.index(f"joint_velocity_{j}")] = 1e-3 * w * np.cos(w * time) + 0.3
    return x


@pytest.mark.parametrize("delay", [3e-3, 4e-4, -2e-3])
def test_a_late_reading_is_the_angle_of_then(arm: Arm, delay: float) -> None:
    time = PERIOD * np.arange(200.0)
    x, u = ringing(arm, time), np.zeros((200, arm.nu))
    arm.parameters["sensor_delay_2"] = delay
    seen = delayed_sensors.read_sensors(arm, time, x, u)["joint_position"]
    assert arm.parameters["sensor_delay_2"] == delay
    then = ringing(arm, time - delay)
    inner = slice(5, -5)
    truth = then[inner, arm.index("joint_position_2")]
    assert np.abs(seen[inner, 1] - truth).max() < 2e-6  # of 1e-3; the series of the model errs by more than half
    assert np.abs(arm.outputs(x, u)["joint_position"][inner, 1] - truth).max() > 50 * 2e-6
    assert np.array_equal(seen[:, 0], x[:, arm.index("joint_position_1")])


def test_a_path_knows_nothing_of_the_one_before_and_gaps_are_not_crossed(arm: Arm) -> None:
    time = PERIOD * np.arange(100.0)
    x, u = ringing(arm, time), np.zeros((100, arm.nu))
    place = arm.index("joint_position_1")
    x[50:, place] += 1.0  # another path
    arm.parameters["sensor_delay_1"] = 2e-3
    seen = delayed_sensors.read_sensors(arm, time, x, u, np.array([0, 50]))["joint_position"][:, 0]
    assert np.abs(seen[50:] - x[50:, place]).max() < 0.01 and np.abs(seen[:50] - x[:50, place]).max() < 0.01
    gap = np.concatenate([time[:50], time[50:] + 1.0])
    far = delayed_sensors.read_sensors(arm, gap, x, u)["joint_position"][:, 0]
    assert np.abs(far[50:] - x[50:, place]).max() < 0.01


def test_without_a_delay_nothing_changes(arm: Arm) -> None:
    time = PERIOD * np.arange(20.0)
    x, u = ringing(arm, time), np.zeros((20, arm.nu))
    for name, values in arm.outputs(x, u).items():
        assert np.array_equal(delayed_sensors.read_sensors(arm, time, x, u)[name], values)


@pytest.mark.parametrize("delays", [(0.0, 0.0), (2e-3, 0.0), (-1e-3, 4e-4)])
def test_positions_alone_are_read_as_with_everything_else(arm: Arm, delays: tuple[float, float]) -> None:
    """Through every effect of an encoder, and where the drive is rigid."""
    time = np.concatenate([PERIOD * np.arange(60), 1.0 + PERIOD * np.arange(40)])
    x, u, begins = ringing(arm, time), np.zeros((100, arm.nu)), np.array([0, 30, 60])
    x[:, arm.index("motor_position_2")] = 100.0 * np.cos(3 * time)
    for j, delay in enumerate(delays, 1):
        arm.parameters.update(
            {f"sensor_delay_{j}": delay, f"encoder_bias_{j}": 0.1 * j, f"eccentricity_sine_{j}": 0.02}
        )
    seen, all_of_it = (
        delayed_sensors.read_positions(arm, delayed_sensors.SampledPath(time, begins), x),
        delayed_sensors.read_sensors(arm, time, x, u, begins),
    )
    assert set(seen) == {"motor_position", "joint_position"}
    for name, values in seen.items():
        np.testing.assert_allclose(values, all_of_it[name], rtol=0, atol=1e-14 * np.abs(values).max())
    truth = x[:, [arm.index(f"joint_position_{j}") for j in (1, 2)]]
    assert (np.abs(seen["joint_position"] - truth) > 0.05).all()


@pytest.mark.parametrize(("robot", "profile", "effects"), [(ROBOT, "portable", EFFECTS), ("paper", "native", ())])
def test_between_rows_it_is_the_cubic_of_angle_and_speed(
    build: Builder, robot: str, profile: str, effects: tuple[str, ...]
) -> None:
    """Against SciPy's, on rows at uneven times, for ages of less than a row and of many."""
    arm = Arm(build(robot, profile, effects).folder)
    time = np.cumsum(np.random.default_rng(1).uniform(0.5e-3, 1.4e-3, 200))
    x = ringing(arm, time)
    for age in (1e-4, 1.7e-3, 1.9e-2, -3e-3):
        seen, then = np.zeros((200, 2)), time - age
        arm.module.late(x, time, np.zeros(200, np.int32), 1.0, np.array([age, 0.0]), seen)
        q, rate = (x[:, arm.index(f"joint_{what}_1")] for what in ("position", "velocity"))
        within = (then > time[0]) & (then < time[-1])
        truth = CubicHermiteSpline(time, q, rate)(then[within]) - q[within]
        assert np.abs(seen[within, 0] - truth).max() < 1e-12 and within.sum() > 170
        assert not seen[:, 1].any()


def test_a_row_alone_has_no_past_but_its_speed(arm: Arm) -> None:
    x = ringing(arm, np.array([0.1]))
    arm.parameters["sensor_delay_1"] = 2e-3
    seen = delayed_sensors.read_sensors(arm, np.array([0.1]), x, np.zeros((1, arm.nu)))["joint_position"]
    q, rate = (x[0, arm.index(f"joint_{what}_1")] for what in ("position", "velocity"))
    assert seen[0, 0] == pytest.approx(q - 2e-3 * rate, abs=1e-15)
