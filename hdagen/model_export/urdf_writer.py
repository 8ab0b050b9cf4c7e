"""URDF: the chain of a robot with its inertias, limits, damping and friction; a format of rigid joints and no motors.

Source: the URDF XML specification of ROS: link/inertial, joint/dynamics (damping, friction), joint/limit. URDF has no
reflected inertia, no spring, no delay and no gravity; these numbers are said.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.sax.saxutils import quoteattr

from hdagen.arm.build_loader import PlantError
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import Exported
from hdagen.model_export.joint_numbers import JointNumbers, RobotNumbers, read_robot_numbers
from hdagen.model_export.mjcf_document import LEAST_INERTIA, LEAST_MASS, write_number
from hdagen.model_export.number_changes import describe_left_out, list_number_changes
from hdagen.support.atomic_write import write_atomically

_HELD_NUMBERS = ("mass", "center_of_mass", "inertia", "damping", "frictionloss")
_FAR = 1e6  # rad, m, rad/s or N m, where the robot file states no limit and URDF needs one


def write(robot: CorrectedRobot, out: Path) -> Exported:
    """Write a robot as URDF.

    Args:
        robot: The robot.
        out: The file.

    Returns:
        The result.

    Raises:
        PlantError: The file cannot be written.

    """
    names = robot.joint_names
    before, after = read_robot_numbers(robot.file, names), read_robot_numbers(robot.corrected, names)
    left_out = describe_left_out(robot, None, "URDF")
    changes = []
    for change in list_number_changes(before, after):
        if change.where == "payload" or change.where.rpartition(".")[2] in _HELD_NUMBERS:
            changes.append(change)
        else:
            left_out[change.where] = "it has no place in URDF; export mjcf or json."
    try:
        write_atomically(out, _write_document(robot.file.robot["name"], after).encode())
    except OSError as error:
        raise PlantError(f"{out}: cannot be written ({error.strerror}); make room or name another place.") from None
    notes = [*robot.notes, *_list_lost_numbers(after)]
    return Exported((out,), tuple(changes), left_out, tuple(notes))


def _list_lost_numbers(numbers: RobotNumbers) -> list[str]:
    """Sentences on the numbers of the robot that URDF does not hold."""
    gravity = " ".join(map(write_number, numbers.gravity))
    notes = [f"URDF states no gravity: set ({gravity}, 0) m/s² in the simulator; x is to the right, y up."]
    rotors = [f"{joint.name} {joint.armature:.6g}" for joint in numbers.joints if joint.armature]
    if rotors:
        notes.append(f"URDF has no reflected inertia of rotors (kg m²): {', '.join(rotors)}; set it in the simulator.")
    soft = [joint.name for joint in numbers.joints if joint.transmission]
    if soft:
        notes.append(f"URDF has no springs in joints: {', '.join(soft)} is rigid in it.")
    return notes


def _write_document(name: str, numbers: RobotNumbers) -> str:
    """The text of the file."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={quoteattr(name)}>", '  <link name="base"/>']
    parent, place = "base", 0.0
    for joint in numbers.joints:
        lines += _write_joint(joint, parent, place)
        lines += _write_link(f"{joint.name}_link", joint.mass, joint.center_of_mass, joint.inertia, joint.length)
        parent, place = f"{joint.name}_link", 0.0 if joint.is_prismatic else joint.length
    lines += _write_fixed_link("tip", parent, place)
    if numbers.payload:
        lines += _write_fixed_link("payload", parent, place, numbers.payload)
    return "\n".join([*lines, "</robot>", ""])


def _write_joint(joint: JointNumbers, parent: str, place: float) -> list[str]:
    kind, axis = ("prismatic", "1 0 0") if joint.is_prismatic else ("revolute", "0 0 1")
    low, high = joint.position_limits or (-_FAR, _FAR)
    effort = joint.torque_limit
    if effort is None:
        effort = joint.gain * joint.input_limit if math.isfinite(joint.input_limit) else _FAR
    if not joint.is_prismatic and joint.position_limits is None:
        kind = "continuous"
    ends = "" if kind == "continuous" else f'lower="{write_number(low)}" upper="{write_number(high)}" '
    return [
        f'  <joint name={quoteattr(joint.name)} type="{kind}">',
        f'    <origin xyz="{write_number(place)} 0 0"/>',
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(f'{joint.name}_link')}/>",
        f'    <axis xyz="{axis}"/>',
        f'    <limit {ends}effort="{write_number(effort)}" velocity="{write_number(joint.speed_limit or _FAR)}"/>',
        f'    <dynamics damping="{write_number(joint.damping)}" friction="{write_number(joint.frictionloss)}"/>',
        "  </joint>",
    ]


def _write_link(name: str, mass: float, center: float, inertia: float, length: float) -> list[str]:
    own = write_number(max(inertia, LEAST_INERTIA))
    lines = [
        f"  <link name={quoteattr(name)}>",
        "    <inertial>",
        f'      <origin xyz="{write_number(center)} 0 0"/>',
        f'      <mass value="{write_number(max(mass, LEAST_MASS))}"/>',
        f'      <inertia ixx="{own}" iyy="{own}" izz="{own}" ixy="0" ixz="0" iyz="0"/>',
        "    </inertial>",
    ]
    if length > 0:
        half, width = write_number(0.5 * length), write_number(0.1 * length)
        lines += [
            "    <visual>",
            f'      <origin xyz="{half} 0 0"/>',
            f'      <geometry><box size="{write_number(length)} {width} {width}"/></geometry>',
            "    </visual>",
        ]
    return [*lines, "  </link>"]


def _write_fixed_link(name: str, parent: str, place: float, mass: float = 0.0) -> list[str]:
    """A frame, or a point mass, that is fixed to a link."""
    link = _write_link(name, mass, 0.0, 0.0, 0.0) if mass else [f'  <link name="{name}"/>']
    return [
        f'  <joint name="{name}_joint" type="fixed">',
        f'    <origin xyz="{write_number(place)} 0 0"/>',
        f"    <parent link={quoteattr(parent)}/>",
        f'    <child link="{name}"/>',
        "  </joint>",
        *link,
    ]
