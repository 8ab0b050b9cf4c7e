"""The errors of simulated sensors: counting, noise and delay, from the robot file where nothing else is stated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm


@dataclass(frozen=True)
class Sensors:
    """The errors of the sensors; None: from the robot file. ``delay``: ticks from a sample to its use."""

    motor_resolution: tuple[float, ...] | None = None  # rad
    joint_resolution: tuple[float, ...] | None = None  # rad
    current_noise: tuple[float, ...] | None = None  # A, standard deviation
    force_noise: float | None = None  # N, standard deviation
    delay: int = 0
    motor_noise: tuple[float, ...] | None = None  # rad, standard deviation, before counting
    joint_noise: tuple[float, ...] | None = None  # rad

    @classmethod
    def exact(cls, n: int) -> Sensors:
        """Make sensors without error.

        Args:
            n: The number of joints.

        Returns:
            The sensors.

        """
        none = (0.0,) * n
        return cls(none, none, none, 0.0, 0, none, none)


@dataclass(frozen=True)
class SensorErrors:
    """The errors of all sensors.

    Attributes:
        resolution: (2n), of the motors' encoders, then of the joints', rad (m where prismatic).
        noise: (2n), standard deviations of the same before counting.
        current_noise: (n), standard deviations, A (N m where the input is a torque).
        force_noise: Standard deviation, N.
        delay: Ticks from a sample to its use.

    """

    resolution: Array
    noise: Array
    current_noise: Array
    force_noise: float
    delay: int

    def draw_encoder_noise(self, rows: int, seed: int) -> Array:
        """Draw the noise of the encoders before they count.

        Its random numbers are its own: one seed gives the same noise of current and force with and without it.

        Args:
            rows: The number of rows, T.
            seed: The seed.

        Returns:
            (T, 2n), of the motors' encoders, then of the joints'.

        """
        if not self.noise.any():
            return np.zeros((rows, len(self.noise)))
        return np.random.default_rng([seed, 1]).normal(size=(rows, len(self.noise))) * self.noise

    def count_angles(self, angles: Array) -> Array:
        """Count angles as the encoders do.

        Args:
            angles: (…, 2n), with their noise.

        Returns:
            (…, 2n), the readings.

        """
        counted: Array = np.rint(angles / self._step) * self._step
        if self._all_are_counting:
            return counted
        return np.where(self._is_counting, counted, angles)

    @cached_property
    def _is_counting(self) -> NDArray[np.bool_]:
        return self.resolution > 0

    @cached_property
    def _all_are_counting(self) -> bool:
        return bool(self._is_counting.all())

    @cached_property
    def _step(self) -> Array:
        return np.where(self._is_counting, self.resolution, 1.0)


def resolve_sensor_errors(arm: Arm, sensors: Sensors) -> SensorErrors:
    """Complete the errors of sensors by the robot file.

    Args:
        arm: The arm, with its robot file.
        sensors: The errors that are stated.

    Returns:
        All errors.

    Raises:
        PlantError: A number is negative or not finite, or there are not as many as joints.

    """
    joints = arm.robot["joints"]
    chosen = []
    for given, key in (
        (sensors.motor_resolution, "motor_encoder_resolution"),
        (sensors.joint_resolution, "joint_encoder_resolution"),
        (sensors.motor_noise, "motor_encoder_noise"),
        (sensors.joint_noise, "joint_encoder_noise"),
        (sensors.current_noise, "current_noise"),
    ):
        stated = given
        if stated is None:
            stated = tuple(joint["sensor"][key] for joint in joints)
        values = np.array(stated, float)
        if values.shape != (arm.n,) or not (np.isfinite(values).all() and (values >= 0).all()):
            raise PlantError(f"{key} takes {arm.n} values, finite and not negative.")
        chosen.append(values)
    if not isinstance(sensors.delay, int) or sensors.delay < 0:
        raise PlantError(f"delay is a whole number of ticks from 0, not {sensors.delay}.")
    force_noise = sensors.force_noise
    if force_noise is None:
        force_noise = arm.robot["force_noise"]
    if not 0 <= force_noise < np.inf:
        raise PlantError(f"force_noise must be finite and not negative, N, not {force_noise}.")
    angles = np.concatenate(chosen[:2]), np.concatenate(chosen[2:4])
    return SensorErrors(*angles, chosen[4], float(force_noise), int(sensors.delay))
