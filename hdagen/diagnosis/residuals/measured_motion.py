"""The motion that a log shows: its states on an even grid, smoothed without lag and differentiated.

Legend: K instants of the grid, n joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.residuals.explanation_settings import EXPLANATION
from hdagen.log.channel_statistics import UniformGrid, make_uniform_grid
from hdagen.log.column_map import name_command_channel
from hdagen.log.measured_log import Log
from hdagen.prediction.measurement_model import Readings, complete_state, count_mechanical_states
from hdagen.prediction.window_replay import Replay


@dataclass(eq=False)
class MeasuredMotion:
    """A log on a model ``arm``; ``replays``: none, or that of the robot file and that of the verdict."""

    arm: Arm
    log: Log
    replays: tuple[Replay, ...]

    @cached_property
    def grid(self) -> UniformGrid:
        """Even instants over the log."""
        at = make_uniform_grid(self.log.time)
        return UniformGrid(at.time, at.time)

    @property
    def time(self) -> Array:
        """The instants (K,), s."""
        return self.grid.time

    def has_measured_input(self, joint: int) -> bool:
        """Tell whether a joint's input is logged both as commanded and as measured.

        Args:
            joint: the joint.

        """
        name = self.arm.input_names[joint - 1]
        return name in self.log and name_command_channel(name) in self.log

    def input_word(self, joint: int) -> str:
        """Name the input of a joint: current or torque.

        Args:
            joint: the joint.

        """
        if self.arm.input_names[joint - 1].startswith("motor_current"):
            return "current"
        return "torque"

    def input_unit(self, joint: int) -> str:
        """Return the unit of a joint's input.

        Args:
            joint: the joint.

        """
        return {"current": "A", "torque": "N m"}[self.input_word(joint)]

    @cached_property
    def valid(self) -> np.ndarray:
        """Mask (K) of the valid instants. The filter knows too little at the log's ends and about its gaps."""
        reach = 2 * self.grid.window_rows + 2
        good = np.ones(len(self.time), bool)
        good[:reach] = good[-reach:] = False
        for row in np.flatnonzero(np.diff(self.log.time) > EXPLANATION.neighbour_gap * self.grid.period):
            a, b = np.searchsorted(self.time, self.log.time[row : row + 2])
            good[max(a - reach, 0) : b + reach] = False
        return good

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.arm.n

    def on_grid(self, values: Array) -> Array:
        """Return logged samples, interpolated at the instants (K).

        Args:
            values: samples (T).

        """
        return np.asarray(np.interp(self.time, self.log.time, values))

    @cached_property
    def has_both_sides(self) -> bool:
        """Whether both sides of every gear are measured."""
        return all(
            j in self.arm.manifest["flexible"]
            and f"motor_position_{j}" in self.log
            and f"joint_position_{j}" in self.log
            for j in range(1, self.n + 1)
        )

    @cached_property
    def ratio(self) -> Array:
        """Ratios of the gears (n)."""
        return np.array([self.arm.parameters.described[f"ratio_{j}"].nominal for j in range(1, self.n + 1)])

    @cached_property
    def sensed_states(self) -> Array:
        """States (K, nx) as the sensors read them: positions unfiltered, velocities smoothed a little."""
        arm, readings = self.arm, Readings.from_log(self.arm, self.log)
        x = np.zeros((len(self.time), arm.nx))
        known: set[int] = set()
        width = max(3, round(EXPLANATION.velocity_filter_width / self.grid.period)) | 1
        for k, place in enumerate(readings.state_indices):
            name = arm.state_names[place]
            if "position" not in name:
                continue
            rate = arm.index(name.replace("position", "velocity"))
            x[:, place] = self.on_grid(readings.measured[:, k] / readings.factors[k])
            padded = np.pad(x[:, place], width // 2, mode="reflect", reflect_type="odd")
            x[:, rate] = self.grid.differentiate(np.convolve(padded, np.full(width, 1.0 / width), "valid"))
            known |= {place, rate}
        m = count_mechanical_states(arm)
        x[:, :m] = complete_state(arm, x, known)[:, :m]
        if self.replays:
            for k in range(m, arm.nx):
                x[:, k] = self.on_grid(self.replays[1].states[:, k])
        return x

    def read_state(self, quantity: str, j: int) -> Array:
        """Return a state as the sensors read it (K).

        Args:
            quantity: its name without the joint, such as motor_position.
            j: the joint.

        """
        name = f"{quantity}_{j}"
        if name in self.arm.state_names:
            return self.sensed_states[:, self.arm.index(name)]
        other = name.replace("motor", "joint")  # the motor of a rigid drive
        return self.sensed_states[:, self.arm.index(other)] * self.ratio[j - 1]

    def smooth(self, values: Array) -> Array:
        """Pass columns through the filter that every part of a torque balance passes.

        Args:
            values: columns (K, k).

        Returns:
            The filtered columns (K, k).

        """
        return np.stack([self.grid.smooth(column) for column in values.T], 1)

    @cached_property
    def acceleration(self) -> tuple[Array, Array]:
        """Measured accelerations of motors and joints (K, n each), rad/s²."""
        found = []
        for side in ("motor", "joint"):
            angle = np.stack([self.read_state(f"{side}_position", j) for j in range(1, self.n + 1)], 1)
            smooth = self.smooth(angle)
            found.append(np.stack([self.grid.differentiate(self.grid.differentiate(column)) for column in smooth.T], 1))
        return found[0], found[1]

    @cached_property
    def direction(self) -> Array:
        """Direction of each motor (K, n): −1, 1, or 0 at standstill."""
        speed = np.stack([self.read_state("motor_velocity", j) for j in range(1, self.n + 1)], 1)
        noise = np.array([_speed_noise(self.read_state("motor_position", j), self.grid) for j in range(1, self.n + 1)])
        return np.where(np.abs(speed) > 3.0 * noise, np.sign(speed), 0.0)

    def is_sliding(self, joint: int) -> np.ndarray:
        """Find the instants (K) in which a motor moves in one direction through most of the filter. About a reversal,
        friction of both signs mixes.

        Args:
            joint: the joint.

        Returns:
            True where the motor slides (K).

        """
        direction = self.direction[:, joint - 1]
        good = direction != 0
        for step in range(1, max(round(EXPLANATION.reversal_reach * self.grid.window_rows), 1) + 1):
            good[step:] &= direction[step:] == direction[:-step]
            good[:-step] &= direction[:-step] == direction[step:]
        return good


def _speed_noise(angle: Array, grid: UniformGrid) -> float:
    """Return the standard deviation of the speed that an angle's noise causes."""
    width = max(3, round(EXPLANATION.velocity_filter_width / grid.period)) | 1
    steps = np.diff(angle, 3)
    if not len(steps):
        return 0.0
    noise = float(np.median(np.abs(steps))) * 1.4826 / np.sqrt(20.0)
    return noise * np.sqrt(2.0) / (width * grid.period)
