"""The positions and velocities of a log as readings of an arm's state."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_rated_torsion
from hdagen.log.channel_statistics import compute_channel_statistics
from hdagen.log.measured_log import Log
from hdagen.log.timestamps import compute_timing_noise
from hdagen.prediction.prediction_settings import PREDICTION

Rows = NDArray[np.intp]
_LEAST_POSITION_NOISE = 1e-9  # rad or m of noise at least: a channel that has not moved yet shows none


def compute_encoder_noise(sensor: Mapping[str, float], side: str) -> float:
    """Compute the noise of an encoder: its own and that of counting.

    Args:
        sensor: The joint's sensor table of the robot file.
        side: "motor" or "joint".

    Returns:
        Standard deviation of a reading, rad (m where prismatic); 0 where the robot file states none.

    """
    return math.hypot(sensor[f"{side}_encoder_resolution"] / math.sqrt(12), sensor[f"{side}_encoder_noise"])


def read_joint_angles(arm: Arm, log: Log) -> Array:
    """Read the joints' angles, from the motor's encoder where a joint has none of its own.

    Args:
        arm: The arm.
        log: The log, with a position for each joint.

    Returns:
        (T, n), rad (m where prismatic).

    """
    angles = []
    for j in range(1, arm.n + 1):
        if f"joint_position_{j}" in log:
            angles.append(log[f"joint_position_{j}"])
        else:
            angles.append(log[f"motor_position_{j}"] / arm.parameters[f"ratio_{j}"])
    return np.stack(angles, 1)


@dataclass(frozen=True, eq=False)
class Readings:
    """The M measured channels of an arm's state, joint after joint, motor before joint.

    Attributes:
        names: The channels' names.
        outputs: The output of the arm that each channel shows, by name and joint.
        places: The index of the state that each channel reads.
        factors: (M), the factor from state to channel.
        noise: (M), standard deviation of the noise as the robot file states it; 0 where it states none.
        measured: (T, M), the samples.
        time: (T,), the instants of the rows, s.
        uncertainty: Standard deviation of an instant, s.

    """

    names: tuple[str, ...]
    outputs: tuple[tuple[str, int], ...]
    state_indices: tuple[int, ...]
    factors: Array
    stated_noise: Array
    measured: Array
    time: Array
    time_uncertainty: float

    @classmethod
    def from_log(cls, arm: Arm, log: Log) -> Readings:
        """Collect the channels of a log that an arm has.

        Args:
            arm: The arm.
            log: The log, with at least one position a joint.

        Returns:
            The channels.

        """
        found = []
        sides = (("motor", "position"), ("motor", "velocity"), ("joint", "position"), ("joint", "velocity"))
        for j, (side, quantity) in product(range(1, arm.n + 1), sides):
            name = f"{side}_{quantity}_{j}"
            if name not in log:
                continue
            state, factor, noise = name, 1.0, 0.0
            if name not in arm.state_names:  # the motor of a rigid drive
                state, factor = f"joint_{quantity}_{j}", arm.parameters[f"ratio_{j}"]
            if quantity == "position":
                noise = compute_encoder_noise(arm.robot["joints"][j - 1]["sensor"], side)
            found.append((name, (f"{side}_{quantity}", j), arm.index(state), factor, noise, log[name]))
        names, outputs, places, factors, noise, measured = zip(*found, strict=True)
        read = np.stack(measured, 1)
        return cls(names, outputs, places, np.array(factors), np.array(noise), read, log.time, log.time_uncertainty)

    def noise_before(self, row: int) -> Array:
        """Estimate the noise of each channel from the rows up to one of them.

        Args:
            row: The last row that is read.

        Returns:
            (M), standard deviations: as the robot file states, with the noise of uncertain instants at the speeds of
            these rows; where it states none, as these rows show.

        """
        rows = slice(max(0, row + 1 - PREDICTION.recent_rows), row + 1)
        recent, found = self.measured[rows], self.stated_noise.copy()
        for k, (name, stated) in enumerate(zip(self.names, self.stated_noise, strict=True)):
            if not stated:
                found[k] = compute_channel_statistics(name, recent[:, k]).noise
                continue
            clock = compute_timing_noise(self.time[rows], recent[:, k], self.time_uncertainty)
            found[k] = math.hypot(stated, np.sqrt(np.mean(clock**2)))
        return np.maximum(found, _LEAST_POSITION_NOISE * np.abs(self.factors))

    def measures_full_state(self, arm: Arm) -> bool:
        """Tell whether the channels read every position and velocity of the state.

        Args:
            arm: The arm.

        Returns:
            Whether no such state is left to be estimated.

        """
        return set(self.state_indices) == set(range(count_mechanical_states(arm)))

    def joints_with_encoder(self) -> list[int]:
        """The numbers of the joints whose own encoder is read."""
        return [j for name, j in self.outputs if name == "joint_position"]

    def state_at(self, arm: Arm, row: int) -> Array:
        """Read the state from one row.

        Where motor and joint encoder differ by more than `compute_rated_torsion`, without the model's own angles
        between them, the joint's encoder is not believed.

        Args:
            arm: The arm.
            row: The row.

        Returns:
            (nx), the state; velocities that are not logged and the effects' own states are 0.

        """
        x = np.zeros((1, arm.nx))
        for k, place in enumerate(self.state_indices):  # where two read one state the joint's encoder counts
            x[:, place] = self.measured[row, k] / self.factors[k]
        undo_sensor_effects(arm, x, self.joints_with_encoder())
        known, most = set(self.state_indices), compute_rated_torsion(arm)
        twist = np.abs(arm.outputs(x[0], np.zeros(arm.nu))["torsion"])
        for j in arm.manifest["flexible"]:
            motor, joint = arm.index(f"motor_position_{j}"), arm.index(f"joint_position_{j}")
            if {motor, joint} <= known and twist[j - 1] > most[j - 1]:
                known.discard(joint)
        return complete_state(arm, x, known)[0]


def count_mechanical_states(arm: Arm) -> int:
    """Count the states that are positions and velocities.

    Args:
        arm: The arm.

    Returns:
        Their number, m; the effects' own states come after them in x.

    """
    return 2 * (arm.n + len(arm.manifest["flexible"]))


def find_memory_amplitudes(arm: Arm) -> list[int]:
    """Find the amplitudes of the effects that have states of their own.

    Args:
        arm: The arm.

    Returns:
        Their indices in p. Where all these amplitudes are 0, the model has no memory beside positions and velocities.

    """
    return find_parameter_indices(arm, (effect for effect in arm.manifest["effects"] if effect["states"]), "amplitudes")


def find_parameter_indices(arm: Arm, effects: Iterable[Mapping[str, Any]], *roles: str) -> list[int]:
    """Find the parameters of effects.

    Args:
        arm: The arm.
        effects: Effects, as the manifest describes them.
        roles: "amplitudes", "shapes" or both.

    Returns:
        The parameters' indices in p, increasing.

    """
    names = set()
    for effect, role in product(effects, roles):
        for key, j in product(effect[role], effect["joints"]):
            names.add(f"{key}_{j}".removesuffix("_0"))  # 0: a parameter of the whole arm
    return [k for k, name in enumerate(arm.parameters.described) if name in names]


def get_state_limits(arm: Arm) -> Array:
    """List the largest magnitude of each state.

    Args:
        arm: The arm.

    Returns:
        (nx): a hundred times the speed that the model is made for; for states that are not velocities any finite
        value.

    """
    most = np.full(arm.nx, np.finfo(float).max)
    for k, name in enumerate(arm.state_names):
        if "velocity" in name:
            most[k] = PREDICTION.state_bound_factor * arm.manifest["state"][k]["bound"]
    return most


def are_within_limits(arm: Arm, x: Array) -> NDArray[np.bool_]:
    """Tell which states are finite and within `get_state_limits`.

    Args:
        arm: The arm.
        x: (…, nx), the states.

    Returns:
        (…), whether each state is.

    """
    return np.asarray((np.abs(x) <= get_state_limits(arm)).all(-1))


def has_sensor_effects(arm: Arm) -> bool:
    """Tell whether the model has effects at the joints' sensors.

    Args:
        arm: The arm.

    Returns:
        Whether one of its effects acts on a sensor.

    """
    return any(effect["place"] == "sensor" for effect in arm.manifest["effects"])


def undo_sensor_effects(arm: Arm, x: Array, joints: Iterable[int]) -> Array:
    """Undo the sensor effects in states that were read by the joints' encoders, in place.

    The share of the effects that depends on acceleration is left out.

    Args:
        arm: The arm.
        x: (W, nx), states whose positions and velocities of ``joints`` are readings.
        joints: The numbers of the joints whose encoders were read.

    Returns:
        ``x``, with the true positions and velocities.

    """
    chosen = [j - 1 for j in joints]
    if not chosen or not has_sensor_effects(arm):
        return x
    position = [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]
    velocity = [arm.index(f"joint_velocity_{j}") for j in range(1, arm.n + 1)]
    read, rate = x[:, position], x[:, velocity]
    q, v = read.copy(), rate.copy()
    for _ in range(2):  # the errors are small and change slowly
        seen = arm.evaluate("encoders", q=q, v=v, a=np.zeros(arm.n))
        q[:, chosen] += (read - seen["joint_position"])[:, chosen]
        v[:, chosen] += (rate - seen["joint_velocity"])[:, chosen]
    x[:, position], x[:, velocity] = q, v
    return x


def complete_state(arm: Arm, x: Array, known: set[int]) -> Array:
    """Complete one side of each flexible gear from the other side, in place, with the torsion at rest under gravity.

    Args:
        arm: The arm.
        x: (W, nx), states.
        known: The indices of the states that are known.

    Returns:
        ``x``, completed.

    """
    sides = {j: (arm.index(f"motor_position_{j}"), arm.index(f"joint_position_{j}")) for j in arm.manifest["flexible"]}
    for j, (motor, joint) in sides.items():
        if joint not in known:
            x[:, joint] = x[:, motor] / arm.parameters[f"ratio_{j}"]
    q = x[:, [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]]
    twist = arm.evaluate("torsion", joint_torque=arm.evaluate("gravity_torque", q=q)["g"])["torsion"]
    for j, (motor, joint) in sides.items():
        ratio = arm.parameters[f"ratio_{j}"]
        fast, slow = arm.index(f"motor_velocity_{j}"), arm.index(f"joint_velocity_{j}")
        if motor not in known:
            x[:, motor] = (x[:, joint] + twist[:, j - 1]) * ratio
        elif joint not in known:
            x[:, joint] -= twist[:, j - 1]
        if fast not in known:
            x[:, fast] = x[:, slow] * ratio
        elif slow not in known:
            x[:, slow] = x[:, fast] / ratio
    return x
