"""The states in which windows begin, as the measurements tell them.

An encoder tells a position and, by a parabola through the rows about a window's begin, a velocity. A flexible joint
with an encoder on one side of its gear hides the other side. The torsion between the two and its rate are then
estimated by extended Kalman filters (`hdagen.prediction.kalman_filter`) over the rows before the window. The torsion
at rest under gravity would be wrong by as much as the motion's own torques twist the spring.

Legend: T rows, W windows, K selected windows, F flexible joints with a hidden side, m positions and velocities.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_rated_torsion
from hdagen.data_quality.log_repair import split_at_long_gaps
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.prediction.driving_inputs import compute_effective_inputs
from hdagen.prediction.kalman_filter import estimate_states
from hdagen.prediction.measurement_model import Readings, Rows, count_mechanical_states, undo_sensor_effects
from hdagen.prediction.prediction_settings import PREDICTION


@dataclass(frozen=True, eq=False)
class InitialStates:
    """The measured states in which the windows of a record begin.

    Attributes:
        arm: the model, with the robot file's parameters.
        record: the log in windows.
        load: torques (n, N m) that the motion may ask of the joints.

    """

    arm: Arm
    record: WindowedRecord
    load: Array

    def read(self, arm: Arm) -> Array:
        """Read the states from the sensors; a hidden torsion is that of the robot file's parameters.

        Args:
            arm: the model with the parameters of the sensors.

        Returns:
            Positions and velocities (W, m).

        """
        return self._place_hidden_sides(arm, self._nominal_torsions)

    def filter(self, arm: Arm, windows: Rows) -> Array:
        """Read the states from the sensors; a hidden torsion is filtered with the model's parameters in some windows.

        Args:
            arm: the model with the parameters of sensors and filters.
            windows: places of these windows; the others keep the robot file's torsions.

        Returns:
            Positions and velocities (W, m).

        """
        torsions = self._nominal_torsions.copy()
        torsions[windows] = self._filter_torsions(arm, windows)
        return self._place_hidden_sides(arm, torsions)

    @cached_property
    def _half_seen_joints(self) -> list[int]:
        """The flexible joints (F) with a reading of one side alone."""
        read = self._readings.outputs
        return [
            j
            for j in self.arm.manifest["flexible"]
            if (("motor_position", j) in read) != (("joint_position", j) in read)
        ]

    @cached_property
    def _readings(self) -> Readings:
        return Readings.from_log(self.arm, self.record.log)

    @cached_property
    def _nominal_torsions(self) -> Array:
        """Hidden torsions and their rates (W, F, 2) with the robot file's parameters."""
        return self._filter_torsions(self.arm, np.arange(len(self.record.starts)))

    @cached_property
    def _stretch_begins(self) -> Rows:
        """For each window the first row (W) of the stretch that it lies in: no gap is in it, and nothing held out where
        the window itself is fitted."""
        visible = self.record.visible_rows
        begins = np.flatnonzero(np.diff(visible, prepend=not visible[0]))
        begins = np.union1d(begins, [first for first, _ in split_at_long_gaps(self.record.time)])
        return np.asarray(begins[np.searchsorted(begins, self.record.starts, side="right") - 1])

    def _filter_torsions(self, arm: Arm, windows: Rows) -> Array:
        """Hidden torsions and their rates (…, F, 2) in some windows. One that no filter reaches, or in which none stays
        finite, has the torsion at rest under gravity."""
        log, record, m = self.record.log, self.record, count_mechanical_states(self.arm)
        x = record.initial_states[windows].copy()
        rows, earliest = record.starts[windows], self._stretch_begins[windows]
        reached = np.flatnonzero(rows - earliest >= PREDICTION.least_horizon_rows)
        if self._half_seen_joints and len(reached):
            acting, _ = compute_effective_inputs(arm, log, record.command, "command")
            still = np.zeros((len(log), arm.nx - m))
            found = estimate_states(arm, log, self._readings, acting, rows[reached], still, earliest[reached])
            finite = np.isfinite(found).all(1)
            x[reached[finite]] = found[finite]
        torsions = np.empty((len(windows), len(self._half_seen_joints), 2))
        for k, j in enumerate(self._half_seen_joints):
            ratio = arm.parameters[f"ratio_{j}"]
            for column, quantity in enumerate(("position", "velocity")):
                motor, joint = _find_sides(arm, quantity, j)
                torsions[:, k, column] = x[:, motor] / ratio - x[:, joint]
        return torsions

    def _place_hidden_sides(self, arm: Arm, torsions: Array) -> Array:
        """States (W, m) with the sensor effects undone and the hidden sides at some torsions and rates (W, F, 2). No
        spring begins with more torsion than it bears."""
        x = undo_sensor_effects(arm, self.record.initial_states.copy(), range(1, arm.n + 1))
        for k, j in enumerate(self._half_seen_joints):
            ratio, is_motor_seen = arm.parameters[f"ratio_{j}"], ("motor_position", j) in self._readings.outputs
            for column, quantity in enumerate(("position", "velocity")):
                motor, joint = _find_sides(arm, quantity, j)
                if is_motor_seen:
                    x[:, joint] = x[:, motor] / ratio - torsions[:, k, column]
                else:
                    x[:, motor] = (x[:, joint] + torsions[:, k, column]) * ratio
        most = np.maximum(
            LIKELIHOOD.initial_torsion_limit * compute_rated_torsion(arm),
            np.abs(arm.evaluate("torsion", joint_torque=self.load)["torsion"]),
        )
        for j in arm.manifest["flexible"]:
            motor, joint = _find_sides(arm, "position", j)
            base = x[:, motor] / arm.parameters[f"ratio_{j}"]
            x[:, joint] = base - np.clip(base - x[:, joint], -most[j - 1], most[j - 1])
        return np.asarray(x[:, : count_mechanical_states(arm)])


def _find_sides(arm: Arm, quantity: str, j: int) -> tuple[int, int]:
    """The indices in x of a quantity before and behind the gear of a flexible joint."""
    return arm.index(f"motor_{quantity}_{j}"), arm.index(f"joint_{quantity}_{j}")
