"""The noise of a log's channels, as the robot file states it or as they show it."""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import get_torque_constant
from hdagen.log.channel_statistics import compute_channel_statistics
from hdagen.log.measured_log import Log
from hdagen.log.timestamps import compute_timing_noise
from hdagen.prediction.measurement_model import compute_encoder_noise
from hdagen.prediction.prediction_settings import PREDICTION


def compute_channel_noise(arm: Arm, log: Log, name: str, rows: NDArray[np.bool_] | slice = slice(None)) -> float:
    """Compute the noise of a channel.

    Args:
        arm: The arm, with its robot file.
        log: The log.
        name: The channel.
        rows: The rows that count, a mask (T) or a slice.

    Returns:
        Standard deviation, in the channel's unit: as the robot file states, with the noise of uncertain instants at the
        speeds of the rows; where it states none, as the channel shows in the rows.

    """
    known = _get_stated_noise(arm, name)
    if not known:
        return measure_shown_noise(log, name, rows)
    instants = compute_channel_timing_noise(arm, log, name)[rows]
    return math.hypot(known, float(np.sqrt(np.mean(instants**2))))


def measure_shown_noise(log: Log, name: str, rows: NDArray[np.bool_] | slice = slice(None)) -> float:
    """Measure the noise that a channel shows.

    Args:
        log: The log.
        name: The channel.
        rows: The rows that count, a mask (T) or a slice.

    Returns:
        Standard deviation, in the channel's unit. A joint that stands may show none: then it is the largest of the same
        quantity of another joint, or at least the rounding of single precision. So it is above 0.

    """
    own = compute_channel_statistics(name, log[name][rows]).noise
    if own:
        return own
    quantity = name.rpartition("_")[0]
    others = [other for other in log.columns if other != name and re.fullmatch(rf"{re.escape(quantity)}_\d+", other)]
    like = max((compute_channel_statistics(other, log[other][rows]).noise for other in others), default=0.0)
    rounding = float(np.finfo(np.float32).eps * np.abs(log[name][rows]).max(initial=0.0))
    return max(like, rounding, PREDICTION.least_noise)


def compute_channel_timing_noise(arm: Arm, log: Log, name: str) -> Array:
    """Compute the noise of a channel that uncertain instants cause.

    Args:
        arm: The arm, with its robot file.
        log: The log.
        name: The channel.

    Returns:
        (T), standard deviations, in the channel's unit. It is 0 for channels that are no position, or whose sensor's
        noise the robot file does not state: the noise that these show contains it.

    """
    if not name.rpartition("_")[0].endswith("position") or not _get_stated_noise(arm, name):
        return np.zeros(len(log))
    return compute_timing_noise(log.time, log[name], log.time_uncertainty)


def _get_stated_noise(arm: Arm, name: str) -> float:
    """The standard deviation of a channel's noise as the robot file states it; 0 where it states none."""
    quantity, _, j = name.rpartition("_")
    sensor = arm.robot["joints"][int(j) - 1]["sensor"]
    if quantity.endswith("position"):
        return compute_encoder_noise(sensor, quantity.split("_")[0])
    if quantity != "motor_torque":
        return float(sensor["current_noise"])
    if name in arm.input_names:  # else it stands for a current, whose noise the robot file states
        return 0.0
    return float(sensor["current_noise"] * get_torque_constant(arm, int(j)))
