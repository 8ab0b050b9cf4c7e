"""A MuJoCo model as the machine of a log: its joints, motors and encoders by the robot's joint names, row by row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.support.messages import join_nearest_names, show_path

MUJOCO_MISSING = "MuJoCo is not installed, and --prove replays in it; `pip install 'hdagen[mujoco]'` brings it."


@dataclass(frozen=True)
class _JointPlaces:
    """Where a joint stands in a compiled model: addresses of its position and speed, and of its torsion's (None: it
    has none), the actuator that drives it (None: none), and its encoder with a delay (None: none)."""

    position: int
    speed: int
    torsion: tuple[int, int] | None
    actuator: int | None
    late_encoder: int | None


def import_mujoco() -> Any:
    """Import MuJoCo.

    Returns:
        The module.

    Raises:
        PlantError: It is not installed.

    """
    try:
        import mujoco
    except ImportError:
        raise PlantError(MUJOCO_MISSING) from None
    return mujoco


class MujocoMachine:
    """A MuJoCo model that is driven by the inputs of a log.

    ``names`` are the robot's joints, base first; ``ratios`` their motors' angles by the joints'; ``gains`` the joints'
    torques by the robot's inputs in the model before any correction; ``tip`` is the tip in the last joint's frame, of
    an arm in space. Raises PlantError where the file is no model of the robot.
    """

    def __init__(
        self,
        path: Path,
        names: Sequence[str],
        ratios: Sequence[float],
        period: float,
        controls: Array | None = None,
        tip: Sequence[float] | None = None,
    ) -> None:
        self.mujoco = import_mujoco()
        self.path, self.names, self.ratios = path, tuple(names), np.asarray(ratios, float)
        self.model, self.notes = self._compile_model(period)
        self.data = self.mujoco.MjData(self.model)
        self.places = [self._find_places(name) for name in names]
        self.steps_of_period, self.period = max(1, round(period / self.model.opt.timestep)), period
        self.controls = np.ones(len(self.names)) if controls is None else controls
        self.tip = self._find_tip(tip)
        self.is_late = any(place.late_encoder is not None for place in self.places)

    def _compile_model(self, period: float) -> tuple[Any, list[str]]:
        """The model, with a step that a row of the log holds a whole number of; and notes."""
        mujoco, notes = self.mujoco, list[str]()
        try:
            spec = mujoco.MjSpec.from_file(str(self.path))
            model = spec.compile()
        except (ValueError, OSError, RuntimeError) as error:
            why = " ".join(str(error).split())[:300]
            raise PlantError(f"{show_path(self.path)}: MuJoCo cannot load it ({why}); mend the model.") from None
        step = model.opt.timestep
        whole = period / max(1, math.ceil(period / step - 1e-6))
        if abs(whole - step) > 1e-6 * step:
            notes.append(
                f"{self.path.name}: its step of {step:g} s does not divide the log's period of {period:g} s; the proof "
                f"steps by {whole:g} s."
            )
            spec.option.timestep = whole
            for entry in (*spec.actuators, *spec.sensors):
                if entry.nsample:
                    entry.nsample = max(entry.nsample, math.ceil(entry.delay / whole) + 1)
            model = spec.compile()
        return model, notes

    def _find_places(self, name: str) -> _JointPlaces:
        """The places of a joint. Raises PlantError."""
        mujoco, model = self.mujoco, self.model
        kinds = mujoco.mjtObj
        joint = mujoco.mj_name2id(model, kinds.mjOBJ_JOINT, name)
        if joint < 0:
            known = [model.joint(k).name for k in range(model.njnt)]
            raise PlantError(
                f"{show_path(self.path)}: there is no joint {name!r:.60}; it has {join_nearest_names([name], known)}."
            )
        if model.jnt_type[joint] not in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)):
            raise PlantError(f"{show_path(self.path)}: joint {name!r:.60} is no hinge and no slide; name another.")
        torsion = mujoco.mj_name2id(model, kinds.mjOBJ_JOINT, f"{name}_torsion")
        wound = None
        if torsion >= 0:
            wound = int(model.jnt_qposadr[torsion]), int(model.jnt_dofadr[torsion])
        on_joint = (model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)) & (model.actuator_trnid[:, 0] == joint)
        motors = np.flatnonzero(on_joint)
        encoder = None
        for k in range(model.nsensor):
            of_joint = model.sensor_type[k] == int(mujoco.mjtSensor.mjSENS_JOINTPOS) and model.sensor_objid[k] == joint
            own = model.sensor(k).name == f"{name}_encoder"
            if (of_joint or own) and model.sensor_delay[k] > 0:
                encoder = k
        return _JointPlaces(
            int(model.jnt_qposadr[joint]),
            int(model.jnt_dofadr[joint]),
            wound,
            int(motors[0]) if len(motors) else None,
            encoder,
        )

    def _find_tip(self, tip: Sequence[float] | None) -> tuple[int, Array] | None:
        """The body that the tip belongs to, and the tip in its frame; None where the model does not say."""
        mujoco, model = self.mujoco, self.model
        if tip is not None:
            joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{self.names[-1]}_torsion")
            if joint < 0:
                joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, self.names[-1])
            return int(model.jnt_bodyid[joint]), model.jnt_pos[joint] + np.asarray(tip, float)
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tip")
        return (int(model.site_bodyid[site]), model.site_pos[site].copy()) if site >= 0 else None

    def check_motors(self) -> None:
        """Refuse a model that no torque of a log can drive.

        Raises:
            PlantError: A joint has no actuator, or one whose force depends on the joint's position or speed.

        """
        for name, place in zip(self.names, self.places, strict=True):
            if place.actuator is None:
                raise PlantError(
                    f"{show_path(self.path)}: joint {name!r:.60} has no actuator to replay a log with; add a <motor>."
                )
            model, k = self.model, place.actuator
            servo = model.actuator_biasprm[k, 1:3].any() or model.actuator_gaintype[k] != 0
            if servo:
                raise PlantError(
                    f"{show_path(self.path)}: the actuator of joint {name!r:.60} is a servo, which takes no torque "
                    "of a log; add a <motor> in its place."
                )

    def measure_gains(self) -> Array:
        """Measure the torque at each joint by a unit of its actuator's control, with what the file states.

        Returns:
            (n), N m (N where prismatic) by unit.

        """
        model = self.model
        motors = [place.actuator for place in self.places]
        return np.array([model.actuator_gear[k, 0] * model.actuator_gainprm[k, 0] for k in motors])

    def hold_inputs(self, inputs: Array) -> None:
        """Fill the histories and filters of the motors, as if inputs had been held for ever.

        Args:
            inputs: (n), the robot's inputs, A or N m at the motor.

        """
        mujoco, model, data = self.mujoco, self.model, self.data
        for place, value, factor in zip(self.places, inputs, self.controls, strict=True):
            k = place.actuator
            control = float(value * factor)
            data.ctrl[k] = control
            if count := int(model.actuator_history[k, 0]):
                mujoco.mj_initCtrlHistory(model, data, k, None, np.full((count, 1), control))
            address = int(model.actuator_actadr[k])
            if address >= 0:
                if model.actuator_ctrllimited[k]:
                    control = min(max(control, model.actuator_ctrlrange[k, 0]), model.actuator_ctrlrange[k, 1])
                data.act[address] = control

    def place_joints(self, motor: Array, motor_speed: Array, joint: Array, joint_speed: Array) -> None:
        """Set positions and speeds; what the motors have in store stays.

        Args:
            motor: (n), angles of the motors over their ratios.
            motor_speed: (n), their speeds.
            joint: (n), positions of the joints.
            joint_speed: (n), their speeds.

        """
        mujoco, model, data = self.mujoco, self.model, self.data
        for j, place in enumerate(self.places):
            if place.torsion is None:
                data.qpos[place.position], data.qvel[place.speed] = joint[j], joint_speed[j]
            else:
                data.qpos[place.position], data.qvel[place.speed] = motor[j], motor_speed[j]
                data.qpos[place.torsion[0]] = joint[j] - motor[j]
                data.qvel[place.torsion[1]] = joint_speed[j] - motor_speed[j]
            if place.late_encoder is not None:
                k = place.late_encoder
                count = int(model.sensor_history[k, 0])
                times = data.time - model.opt.timestep * np.arange(count, 0, -1.0)
                past = joint[j] + joint_speed[j] * (times - data.time)
                mujoco.mj_initSensorHistory(model, data, k, times[:, None], past[:, None], 0.0)

    def read_positions(self) -> tuple[Array, Array]:
        """Read the encoders.

        Returns:
            (n) the motors' angles, rad at the motor, and (n) the joints' positions, as late as the file says.

        """
        motor, joint = np.empty(len(self.places)), np.empty(len(self.places))
        if self.is_late:
            self.mujoco.mj_forward(self.model, self.data)
        for j, place in enumerate(self.places):
            rotor = turned = float(self.data.qpos[place.position])
            if place.torsion is not None:
                turned += float(self.data.qpos[place.torsion[0]])
            motor[j], joint[j] = self.ratios[j] * rotor, turned
            if place.late_encoder is not None:
                joint[j] = self.data.sensordata[self.model.sensor_adr[place.late_encoder]]
        return motor, joint

    def read_inputs(self) -> Array:
        """Read the inputs that acted last, behind delay, limit and lag.

        Returns:
            (n), in the robot's unit.

        """
        model, data, acted = self.model, self.data, np.empty(len(self.places))
        for j, place in enumerate(self.places):
            k = place.actuator
            address = int(model.actuator_actadr[k])
            control = (data.actuator_force[k] - model.actuator_biasprm[k, 0]) / model.actuator_gainprm[k, 0]
            if address >= 0:
                control = data.act[address]
            acted[j] = control / self.controls[j]
        return acted

    def advance_row(self, inputs: Array, push: Array, seconds: float) -> None:
        """Simulate the time from one row to the next.

        Args:
            inputs: (n), the robot's inputs over it.
            push: (2), force on the tip in the base frame, N; in space (6), below it the moment about the tip, N m.
            seconds: The time, s.

        """
        mujoco, model, data = self.mujoco, self.model, self.data
        for place, value, factor in zip(self.places, inputs, self.controls, strict=True):
            data.ctrl[place.actuator] = value * factor
        if self.tip is not None:
            data.qfrc_applied[:] = 0.0
            if push.any():
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                wrench, (body, offset) = np.zeros(6), self.tip
                wrench[: push.size] = push
                point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ offset
                mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], point, body, data.qfrc_applied)
        mujoco.mj_step(model, data, nstep=max(1, round(seconds / model.opt.timestep)))
