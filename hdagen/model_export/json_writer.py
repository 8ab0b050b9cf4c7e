"""JSON: the joints' numbers by joint name, at the joint, with the conventions of the simulators that take them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import Exported
from hdagen.model_export.joint_numbers import JointNumbers, RobotNumbers, read_robot_numbers
from hdagen.model_export.number_changes import describe_left_out, list_number_changes
from hdagen.model_export.posterior_draws import MOST_DRAWS, draw_robots
from hdagen.support.atomic_write import write_atomically

JSON_SCHEMA = 1
CONVENTIONS = {
    "here": "SI units at the joint (N and m for N m and rad where it slides). Friction torque: frictionloss · sign(v) "
    "+ damping · v + quadratic_damping · v · |v|. armature is the rotor's inertia times ratio². A delay is the age of "
    "a command when it acts. torque = gain · input + bias, the input limited to input_limit before.",
    "mujoco": "armature, damping and frictionloss of <joint> are these numbers; damping='DAMPING QUADRATIC' holds "
    "both. Dry friction creeps with the time constant of solreffriction. A delay stands in <general delay=… nsample=… "
    "interp='linear'>.",
    "isaac_lab": "armature of an ActuatorCfg is this armature. From Isaac Sim 5.0 on, friction (static) and "
    "dynamic_friction are both frictionloss in N m, and viscous_friction is damping; earlier versions take friction as "
    "a coefficient without a unit, which frictionloss is not: leave it 0 there. damping of an ActuatorCfg is the gain "
    "of a servo, not this number. DelayedPDActuatorCfg counts delays in steps of the simulation: delay / dt.",
    "genesis": "set_dofs_armature, set_dofs_damping and set_dofs_frictionloss take these numbers.",
    "pybullet": "changeDynamics(jointDamping=damping). PyBullet has no dry friction of joints: setJointMotorControl2 "
    "with VELOCITY_CONTROL, targetVelocity=0 and force=frictionloss stands for it. It has no armature either.",
}


def write(robot: CorrectedRobot, out: Path, samples: int | None = None) -> Exported:
    """Write the joints' numbers.

    Args:
        robot: The robot.
        out: The file.
        samples: How many draws of the numbers from what the diagnosis leaves open; None: none.

    Returns:
        The result.

    Raises:
        PlantError: There are too many draws or no diagnosis to draw from, or the file cannot be written.

    """
    if samples is not None and not 1 <= samples <= MOST_DRAWS:
        raise PlantError(f"--samples {samples}: possible are 1 to {MOST_DRAWS} draws.")
    names = robot.joint_names
    before, after = read_robot_numbers(robot.file, names), read_robot_numbers(robot.corrected, names)
    left_out = describe_left_out(robot, None, "a rigid-body simulator")
    content: dict[str, Any] = {"schema": JSON_SCHEMA, "robot": robot.file.robot["name"], **_describe_robot(after)}
    content |= {"left_out": left_out, "conventions": CONVENTIONS}
    notes = list(robot.notes)
    if samples is not None:
        drawn = draw_robots(robot, samples)
        content["samples"] = [_describe_robot(read_robot_numbers(arm, names)) for arm in drawn.arms]
        notes.append(drawn.note)
    try:
        write_atomically(out, (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode())
    except OSError as error:
        raise PlantError(f"{out}: cannot be written ({error.strerror}); make room or name another place.") from None
    return Exported((out,), list_number_changes(before, after), left_out, tuple(notes))


def _describe_robot(numbers: RobotNumbers) -> dict[str, Any]:
    """The robot's numbers as JSON has them."""
    joints = {joint.name: _describe_joint(joint, numbers.in_space) for joint in numbers.joints}
    gravity, payload = list(numbers.gravity), numbers.payload
    if not numbers.in_space:
        return {"gravity": gravity[:2], "payload": payload.mass, "joints": joints}
    tip = {"origin": list(numbers.tip.origin), "rotation": list(numbers.tip.rotation)}
    return {
        "gravity": gravity,
        "payload": payload.mass,
        "payload_center": list(payload.center),
        "tip": tip,
        "joints": joints,
    }


def _describe_joint(joint: JointNumbers, in_space: bool) -> dict[str, Any]:
    """A joint's numbers: null where there is no limit."""
    described: dict[str, Any] = {
        "type": "prismatic" if joint.is_prismatic else "revolute",
        "armature": joint.armature,
        "damping": joint.damping,
        "quadratic_damping": joint.quadratic_damping,
        "frictionloss": joint.frictionloss,
        "ratio": joint.ratio,
        "input": "current" if joint.has_current_input else "torque",
        "gain": joint.gain,
        "bias": joint.bias,
        "delay": joint.delay,
        "lag": joint.lag,
        "input_limit": None if math.isinf(joint.input_limit) else joint.input_limit,
        "torque_limit": joint.torque_limit,
        "speed_limit": joint.speed_limit,
        "position_limits": joint.position_limits,
        "encoder_delay": joint.sensor_delay,
        "encoder_noise": joint.encoder_noise,
        "mass": joint.body.mass,
        "center_of_mass": list(joint.body.center) if in_space else joint.body.center[0],
        "inertia": list(joint.body.inertia) if in_space else joint.body.inertia[2],
        "cable_stiffness": joint.cable_stiffness,
        "cable_rest": joint.cable_rest,
    }
    if in_space:
        described |= {"origin": list(joint.frame.origin), "rotation": list(joint.frame.rotation)}
        described["axis"] = list(joint.axis)
    if spring := joint.transmission:
        described["torsion"] = {
            "stiffness": spring.linear,
            "cubic_stiffness": spring.cubic,
            "damping": spring.damping,
            "play": spring.play,
        }
    return described
