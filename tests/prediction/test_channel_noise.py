"""The noise that a channel shows: above 0 even where a joint stands, since errors are counted in it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from replayed import FLEXIBLE, SENSORS, simulated

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.log.channel_statistics import compute_channel_statistics
from hdagen.log.measured_log import Log
from hdagen.prediction.channel_noise import measure_shown_noise
from hdagen.prediction.prediction_settings import PREDICTION

STEP = 5e-5  # rad, of an encoder
TIME = np.arange(2000) * 1e-3
RNG = np.random.default_rng(3)
SWING = np.round((0.5 * np.sin(3 * TIME) + 1e-4 * RNG.standard_normal(2000)) / STEP) * STEP


def make_log(**columns: np.ndarray) -> Log:
    return Log(TIME, {"motor_torque_1": np.sin(TIME), "motor_torque_2": np.cos(TIME), **columns}, 2, "log.csv")


@pytest.mark.parametrize(
    "still",
    [np.zeros(2000), np.full(2000, -1.8), np.where(RNG.random(2000) < 0.03, STEP, 0.0), np.where(TIME < 1.9, 0.0, 0.1)],
    ids=["at zero", "at an angle", "on two steps of the encoder", "moved once"],
)
def test_a_joint_that_stands_has_the_noise_of_one_that_moves(still: np.ndarray) -> None:
    log = make_log(joint_position_1=SWING, joint_position_2=still)
    assert compute_channel_statistics("joint_position_2", still).noise < 1e-6 * np.abs(still).max(initial=1.0)
    moving = compute_channel_statistics("joint_position_1", SWING).noise
    assert measure_shown_noise(log, "joint_position_1") == moving
    assert measure_shown_noise(log, "joint_position_2") == moving


def test_where_nothing_moves_the_rounding_of_single_precision_counts() -> None:
    log = make_log(joint_position_1=np.full(2000, 2.0), joint_position_2=np.zeros(2000))
    assert measure_shown_noise(log, "joint_position_1") == pytest.approx(2.0 * 2**-23)
    assert measure_shown_noise(log, "joint_position_2") == PREDICTION.least_noise


def test_only_the_asked_rows_count() -> None:
    held = np.where(TIME < 1.0, 0.3, SWING)
    log = make_log(joint_position_1=held, joint_position_2=SWING)
    later = compute_channel_statistics("joint_position_1", held[TIME >= 1.0]).noise
    assert measure_shown_noise(log, "joint_position_1", TIME >= 1.0) == later > 0
    assert measure_shown_noise(log, "joint_position_1", TIME < 1.0) > 0


def test_a_fit_counts_the_errors_of_a_joint_that_stands_in_a_noise_above_0(build: Callable) -> None:
    arm = Arm(build(FLEXIBLE.replace(SENSORS, "")).folder)
    log = simulated(arm)
    still = {name: np.zeros(len(log)) for name in log.columns if name.endswith("_2")}
    windows = [
        cut_windows(arm, LogPortion.all_rows(Log(log.time, {**log.columns, **more}, 2, "made")), 0.05)
        for more in ({}, still)
    ]
    moving, standing = (dict(zip(one.names, one.noise, strict=True)) for one in windows)
    assert all(standing[name] > 0 for name in standing)
    assert {name: standing[name] for name in standing if name.endswith("_1")} == {
        name: moving[name] for name in moving if name.endswith("_1")
    }
