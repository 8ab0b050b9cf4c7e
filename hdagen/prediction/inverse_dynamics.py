"""Force error of the inverse dynamics: the input that the model requires for the measured motion, against the command.

The motion is low-passed without lag (Butterworth of order 4, forwards and backwards, at 5 times the bandwidth) and
differentiated by central differences; measured and modelled input are then low-passed alike and thinned out, to 2 times
the bandwidth.

Source: Janot, Gautier, Brunot, Data set and reference models of EMPS (2019), 3.1, 3.2 and (11); Gautier, Proc. IEEE
ICRA (1997) 1801.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.log.channel_statistics import make_uniform_grid
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.measurement_model import Readings
from hdagen.prediction.prediction_settings import PREDICTION

LOOP_BANDWIDTH = PREDICTION.loop_bandwidth  # Hz


@dataclass(frozen=True, eq=False)
class ForceError:
    """The force error of a log.

    Attributes:
        relative: (n), the norm of modelled less measured input, as a share of the measured one's.
        time: (K,), s.
        measured: (K, n), the filtered measured input, A (or N m and N).
        modelled: (K, n), the filtered input that the model requires, in the same unit.

    """

    relative: Array
    time: Array
    measured: Array
    modelled: Array


def compute_force_error(arm: Arm, log: Log, inputs: Array, bandwidth: float = LOOP_BANDWIDTH) -> ForceError:
    """Compute the force error of a rigid arm on a log.

    Args:
        arm: The arm.
        log: The log.
        inputs: (T, nu), the inputs that act in the log, A or N m, and N.
        bandwidth: The closed loop's bandwidth, Hz.

    Returns:
        The force error, and the filtered inputs that it compares.

    Raises:
        PlantError: A drive has springs.
        LogError: The log is too slow or too short.

    """
    from scipy.signal import butter, decimate, filtfilt

    if arm.manifest["flexible"]:
        raise PlantError(
            f"{arm.robot['name']}: the force error needs rigid drives, joints {arm.manifest['flexible']} have springs."
        )
    grid = make_uniform_grid(log.time)
    rate = 1.0 / grid.period
    least = 10 * bandwidth / PREDICTION.passed_nyquist_share
    factor = round(PREDICTION.passed_nyquist_share * rate / 2 / (2 * bandwidth))
    if rate < least or len(grid.time) < 40 * factor:
        raise LogError(
            [
                f"{log.source}: {len(log)} rows at {rate:.4g} Hz are too few for the force error of a loop of "
                f"{bandwidth:g} Hz; it needs {least:g} Hz or more, and {40 * max(factor, 2)} rows."
            ]
        )
    b, a = butter(PREDICTION.butterworth_order, 5 * bandwidth / (rate / 2))
    q = filtfilt(b, a, _interpolate_columns(grid.time, log.time, _read_joint_positions(arm, log)), axis=0)
    v = np.gradient(q, grid.period, axis=0)
    acceleration = np.gradient(v, grid.period, axis=0)
    held = inputs[np.clip(np.searchsorted(log.time, grid.time + 1e-6 * grid.period, side="right") - 1, 0, None)]
    found = arm.evaluate("inverse_dynamics", q=q, v=v, a=acceleration, tip_force=held[:, arm.n :])
    modelled = found["motor_torque"] / compute_torque_per_input(arm)
    thinned = [decimate(part, factor, axis=0)[10:-10] for part in (grid.time, held[:, : arm.n], modelled)]
    size = np.linalg.norm(thinned[1], axis=0)
    difference = np.linalg.norm(thinned[2] - thinned[1], axis=0)
    relative = np.divide(difference, size, out=np.full(arm.n, np.nan), where=size > 0)
    return ForceError(relative, grid.time[::factor][10 : 10 + len(thinned[0])], thinned[1], thinned[2])


def _read_joint_positions(arm: Arm, log: Log) -> Array:
    """The joint positions (T, n) of a rigid arm."""
    readings = Readings.from_log(arm, log)
    q = np.empty((len(log), arm.n))
    for (name, j), channel, factor in zip(readings.outputs, readings.measured.T, readings.factors, strict=True):
        if name.endswith("position"):  # where both are logged the joint's encoder counts
            q[:, j - 1] = channel / factor
    return q


def _interpolate_columns(time: Array, logged: Array, values: Array) -> Array:
    return np.stack([np.interp(time, logged, column) for column in values.T], 1)
