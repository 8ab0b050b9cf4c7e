"""Residual torque along the measured motion: torque at the motors and the links that the model does not explain.

The measured positions are smoothed without lag and differentiated. In these states the model's own torques give an
acceleration; the measured acceleration less that, times inertia, is the residual torque. Model and measurement pass the
same filter. Where only one side of a flexible gear is measured, or the drive is rigid, the balance is that of the whole
joint, at the motor.

Legend: K instants of an even grid, n joints, m positions and velocities of the state; θ motor angle, q joint angle, φ
torsion.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.diagnosis.residuals.explanation_settings import EXPLANATION
from hdagen.diagnosis.residuals.measured_motion import MeasuredMotion
from hdagen.prediction.driving_inputs import compute_effective_inputs, read_driving_inputs
from hdagen.prediction.measurement_model import Readings, find_parameter_indices, undo_sensor_effects


@dataclass(frozen=True, eq=False)
class TorqueResidual:
    """Torque at the motors (K, n) and at the links (K, n), N m, positive where it would accelerate the joint; ``link``
    is None where the log does not separate the two sides."""

    motor: Array
    link: Array | None


@dataclass(frozen=True, eq=False)
class TorqueBalance:
    """The torques of a model along a measured ``motion``, under any of its parameters."""

    motion: MeasuredMotion
    input_cache: dict[bytes, Array] = field(init=False, repr=False, default_factory=dict)

    def states(self, p: Array) -> Array:
        """Convert the readings into states.

        Args:
            p: parameters (np) of the sensors.

        Returns:
            States (K, nx).

        """
        return undo_sensor_effects(
            self.motion.arm.with_parameters(p),
            self.motion.sensed_states.copy(),
            Readings.from_log(self.motion.arm, self.motion.log).joints_with_encoder(),
        )

    def inputs(self, p: Array) -> Array:
        """Return the effective inputs about each instant: measured where they are logged, otherwise simulated from the
        commands.

        Args:
            p: parameters (np).

        Returns:
            Inputs (K, nu). They are kept for other parameters that change no effect on inputs.

        """
        key = p[self._input_parameters].tobytes()
        found = self.input_cache.get(key)  # threads share it
        if found is None:
            arm, n = self.motion.arm.with_parameters(p), self.motion.n
            acting = compute_effective_inputs(arm, self.motion.log, self._driving_inputs, "measured")[0].copy()
            acting[1:, :n] = (acting[1:, :n] + acting[:-1, :n]) / 2
            found = np.stack([self.motion.on_grid(column) for column in acting.T], 1)
            if len(self.input_cache) >= EXPLANATION.most_cached_inputs:
                self.input_cache.clear()
            self.input_cache[key] = found
        return found

    @cached_property
    def _driving_inputs(self) -> Array:
        """The measured inputs (T, nu), whatever the parameters."""
        return read_driving_inputs(self.motion.arm, self.motion.log, "measured")[0]

    @cached_property
    def _input_parameters(self) -> list[int]:
        """The parameters of effects on inputs."""
        effects = (one for one in self.motion.arm.manifest["effects"] if one["place"] == "input")
        return find_parameter_indices(self.motion.arm, effects, "amplitudes", "shapes")

    @cached_property
    def _smoothing_widths(self) -> list[int]:
        """The parameters that are widths of smooth friction."""
        names = self.motion.arm.parameters.described
        return [k for k, name in enumerate(names) if name.startswith("friction_smoothing_")]

    def simulate_inputs(self, p: Array) -> tuple[Array, Array]:
        """Simulate the inputs from the commands, row by row.

        Args:
            p: parameters (np).

        Returns:
            Effective inputs, and the readings of them (T, nu each).

        """
        arm = self.motion.arm.with_parameters(p)
        return compute_effective_inputs(
            arm, self.motion.log, read_driving_inputs(arm, self.motion.log, "command")[0], "command"
        )

    def sensed_torque(self, p: Array) -> Array:
        """Simulate the readings of the joints' torque sensors.

        Args:
            p: parameters (np).

        Returns:
            Readings (K, n), N m, smoothed.

        """
        return self.motion.smooth(
            self.motion.arm.with_parameters(p).outputs(self.states(p), self.inputs(p))["joint_torque"]
        )

    def model_accelerations(self, p: Array, x: Array) -> tuple[Array, Array]:
        """Compute the model's accelerations, unfiltered.

        Args:
            p: parameters (np).
            x: states (K, nx).

        Returns:
            Of motors (0 in rigid drives) and of joints (K, n each), rad/s².

        """
        rate = self.motion.arm.with_parameters(p).evaluate(
            "rhs_exact", x=x, u=self.inputs(p), sliding=self.motion.direction
        )["rate"]
        motor, joint = np.zeros((len(x), self.motion.n)), np.zeros((len(x), self.motion.n))
        for j in range(1, self.motion.n + 1):
            joint[:, j - 1] = rate[:, self.motion.arm.index(f"joint_velocity_{j}")]
            if j in self.motion.arm.manifest["flexible"]:
                motor[:, j - 1] = rate[:, self.motion.arm.index(f"motor_velocity_{j}")]
        return motor, joint

    def residual(self, p: Array) -> TorqueResidual:
        """Compute the residual torque of a model.

        Args:
            p: parameters (np).

        Returns:
            Torque at motors and links.

        """
        if self.motion.has_both_sides:
            return self._two_sided_residual(p)
        return TorqueResidual(self._whole_joint_residual(p), None)

    def _two_sided_residual(self, p: Array) -> TorqueResidual:
        """Compute the residual torque of both sides of the gears."""
        x = self.states(p)
        motor, joint = self.model_accelerations(p, x)
        motor, joint = (
            self.motion.acceleration[0] - self.motion.smooth(motor),
            self.motion.acceleration[1] - self.motion.smooth(joint),
        )
        return TorqueResidual(motor * self.motor_inertia(p), self.link_torque_of(p, x, joint))

    def _whole_joint_residual(self, p: Array) -> Array:
        """Compute the residual torque of whole joints, at the motor."""
        inputs = self.inputs(p)
        given = inputs[:, : self.motion.n] * compute_torque_per_input(self.motion.arm.with_parameters(p))
        found = self.motion.smooth(self._inverse_dynamics(p, inputs)["motor_torque"] - given)
        return np.where(self.motion.direction == 0, 0.0, found)  # friction that holds a joint at rest is unknown

    def _inverse_dynamics(self, p: Array, inputs: Array) -> dict[str, Array]:
        """Compute the inverse dynamics of the measured motion under parameters ``p`` and inputs (K, nu), unfiltered.

        Friction has its whole level at any speed: the smooth sign of a model is as wide as its step asks for, and at a
        rigid joint that is as wide as a slow motion.
        """
        q, v = self._joint_motion(self.states(p))
        force = inputs[:, self.motion.n :]
        sharp = p.copy()
        sharp[self._smoothing_widths] = EXPLANATION.sharp_friction_width
        return self.motion.arm.with_parameters(sharp).evaluate(
            "inverse_dynamics", q=q, v=v, a=self.motion.acceleration[1], tip_force=force
        )

    def _joint_motion(self, x: Array) -> tuple[Array, Array]:
        """Return positions and velocities of the joints (K, n each) in states ``x`` (K, nx)."""
        joints = range(1, self.motion.n + 1)
        angles = [self.motion.arm.index(f"joint_position_{j}") for j in joints]
        speeds = [self.motion.arm.index(f"joint_velocity_{j}") for j in joints]
        return x[:, angles], x[:, speeds]

    def motor_inertia(self, p: Array) -> Array:
        """Return the inertias of the motors (n), kg m².

        Args:
            p: parameters (np).

        """
        names = list(self.motion.arm.parameters.described)
        return np.array([p[names.index(f"motor_inertia_{j}")] for j in range(1, self.motion.n + 1)])

    def link_torque_of(self, p: Array, x: Array, acceleration: Array) -> Array:
        """Compute the torque that accelerates the links.

        Args:
            p: parameters (np).
            x: states (K, nx).
            acceleration: of the joints (K, n), rad/s².

        Returns:
            Torque at the links (K, n), N m.

        """
        mass = (
            self.motion.arm.with_parameters(p)
            .evaluate("mass_matrix", q=self._joint_motion(x)[0])["M"]
            .reshape(len(x), self.motion.n, self.motion.n)
        )
        return np.asarray(np.einsum("kij,kj->ki", mass, acceleration))

    def effect_torque(self, p: Array, less: Array) -> TorqueResidual:
        """Compute the torque that a change of parameters adds in the states of ``p``, filtered as the residual.

        Args:
            p: parameters (np).
            less: parameters (np) to subtract.

        Returns:
            Torque at motors and links.

        """
        x = self.states(p)
        (motor, joint), (motor_less, joint_less) = self.model_accelerations(p, x), self.model_accelerations(less, x)
        at_motor = self.motion.smooth(motor - motor_less) * self.motor_inertia(p)
        at_link = self.link_torque_of(p, x, self.motion.smooth(joint - joint_less))
        if self.motion.has_both_sides:
            return TorqueResidual(at_motor, at_link)
        return TorqueResidual(at_motor + at_link / self.motion.ratio, None)

    def link_torque(self, p: Array) -> Array:
        """Compute the torque that the measured motion of the links requires of the transmission.

        Args:
            p: parameters (np).

        Returns:
            Torque (K, n), N m, smoothed.

        """
        return self.motion.smooth(self._inverse_dynamics(p, self.inputs(p))["joint_torque"])

    def spring_stiffness(self, p: Array) -> Array:
        """Compute the stiffness of the springs under that torque.

        Args:
            p: parameters (np).

        Returns:
            Stiffness (K, n), N m/rad.

        """
        torque = self.link_torque(p)
        h = EXPLANATION.torsion_step_share * max(float(np.abs(torque).max()), 1.0)
        arm = self.motion.arm.with_parameters(p)
        ends = [arm.evaluate("torsion", joint_torque=torque + side * h)["torsion"] for side in (1.0, -1.0)]
        return np.asarray(2 * h / np.maximum(ends[0] - ends[1], 1e-12))

    def encoder_error(self, p: Array, less: Array) -> Array:
        """Compute the change of the joint encoders' readings by a change of parameters.

        Args:
            p: parameters (np).
            less: parameters (np) to subtract.

        Returns:
            Angles (K, n), rad, smoothed.

        """
        q, v = self._joint_motion(self.states(p))
        read = [
            self.motion.arm.with_parameters(one).evaluate("encoders", q=q, v=v, a=self.motion.acceleration[1])[
                "joint_position"
            ]
            for one in (p, less)
        ]
        return self.motion.smooth(read[0] - read[1])
