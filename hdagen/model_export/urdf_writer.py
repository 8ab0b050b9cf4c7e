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
from hdagen.model_export.link_numbers import INERTIA_ENTRIES, NO_TURN, Frame, LinkBody
from hdagen.model_export.mjcf_document import LEAST_INERTIA, LEAST_MASS, write_number, write_numbers
from hdagen.model_export.mjcf_patch import is_link_number
from hdagen.model_export.model_files import open_model_files
from hdagen.model_export.number_changes import describe_left_out, list_number_changes
from hdagen.model_export.urdf_patch import NO_PLACE, patch_urdf
from hdagen.model_import.compiled_tree import compile_tree
from hdagen.model_import.model_file import ModelError, read_model_file
from hdagen.support.messages import join_names, show_path

_HELD_NUMBERS = ("damping", "frictionloss")
_FAR = 1e6  # rad, m, rad/s or N m, where the robot file states no limit and URDF needs one


def write(robot: CorrectedRobot, out: Path, into: Path | None = None) -> Exported:
    """Write a robot as URDF.

    Args:
        robot: The robot.
        out: The file.
        into: A URDF that the user has, whose numbers are corrected; None: a whole one is written.

    Returns:
        The result.

    Raises:
        PlantError: The user's URDF does not fit the robot, or the file cannot be written.

    """
    names = robot.joint_names
    before, after = read_robot_numbers(robot.file, names), read_robot_numbers(robot.corrected, names)
    left_out = describe_left_out(robot, None, "URDF")
    if into is not None:
        patched = patch_urdf(into, out, before, after)
        with open_model_files(out, patched.files) as written:
            _check_urdf_reads(written, into)
        return Exported((out,), patched.changes, left_out | patched.left_out, tuple(robot.notes))
    changes = []
    for change in list_number_changes(before, after):
        is_of_body = is_link_number(change.where) and not change.where.startswith("gravity_")
        if is_of_body or change.where.rpartition(".")[2] in _HELD_NUMBERS:
            changes.append(change)
        else:
            left_out[change.where] = NO_PLACE
    with open_model_files(out, {out: _write_document(robot.file.robot["name"], after).encode()}):
        pass
    notes = [*robot.notes, *_list_lost_numbers(after)]
    return Exported((out,), tuple(changes), left_out, tuple(notes))


def _check_urdf_reads(path: Path, into: Path) -> None:
    """Refuse a corrected URDF that MuJoCo does not read, or whose bodies have impossible inertias that those of the
    user's file ``into`` have not."""
    try:
        spoiled = compile_tree(read_model_file(path)).impossible - compile_tree(read_model_file(into)).impossible
    except ModelError as error:
        raise PlantError(f"the corrected {error}") from None
    if spoiled:
        raise PlantError(
            f"the corrected {show_path(into)}: no body has the inertia that link {join_names(sorted(spoiled))} would"
            " have; write a whole URDF, without --into."
        )


def _list_lost_numbers(numbers: RobotNumbers) -> list[str]:
    """Sentences on the numbers of the robot that URDF does not hold."""
    gravity, frame = write_numbers(numbers.gravity), "in the frame of the link base"
    if not numbers.in_space:
        frame = "x is to the right, y up"
    notes = [f"URDF states no gravity: set ({gravity}) m/s² in the simulator; {frame}."]
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
    parent = "base"
    ends = [*(joint.frame for joint in numbers.joints[1:]), numbers.tip]
    for joint, end in zip(numbers.joints, ends, strict=True):
        lines += _write_joint(joint, parent)
        parent = f"{joint.name}_link"
        lines += _write_link(parent, joint.body, _draw_link(end))
    lines += _write_fixed_link("tip", parent, numbers.tip)
    if numbers.payload.mass:
        lines += _write_fixed_link("payload", parent, numbers.tip, numbers.payload)
    return "\n".join([*lines, "</robot>", ""])


def _write_joint(joint: JointNumbers, parent: str) -> list[str]:
    kind = "prismatic" if joint.is_prismatic else "revolute"
    low, high = joint.position_limits or (-_FAR, _FAR)
    effort = joint.torque_limit
    if effort is None:
        effort = joint.gain * joint.input_limit if math.isfinite(joint.input_limit) else _FAR
    if not joint.is_prismatic and joint.position_limits is None:
        kind = "continuous"
    ends = "" if kind == "continuous" else f'lower="{write_number(low)}" upper="{write_number(high)}" '
    return [
        f'  <joint name={quoteattr(joint.name)} type="{kind}">',
        f"    {_write_frame(joint.frame)}",
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(f'{joint.name}_link')}/>",
        f'    <axis xyz="{write_numbers(joint.axis)}"/>',
        f'    <limit {ends}effort="{write_number(effort)}" velocity="{write_number(joint.speed_limit or _FAR)}"/>',
        f'    <dynamics damping="{write_number(joint.damping)}" friction="{write_number(joint.frictionloss)}"/>',
        "  </joint>",
    ]


def _write_link(name: str, body: LinkBody | None, visual: list[str]) -> list[str]:
    """A link; one without a body is a frame."""
    if body is None:
        return [f"  <link name={quoteattr(name)}/>"]
    moments = (*(max(moment, LEAST_INERTIA) for moment in body.inertia[:3]), *body.inertia[3:])
    entries = zip(INERTIA_ENTRIES, moments, strict=True)
    inertia = " ".join(f'i{entry}="{write_number(moment)}"' for entry, moment in entries)
    return [
        f"  <link name={quoteattr(name)}>",
        "    <inertial>",
        f'      <origin xyz="{write_numbers(body.center)}"/>',
        f'      <mass value="{write_number(max(body.mass, LEAST_MASS))}"/>',
        f"      <inertia {inertia}/>",
        "    </inertial>",
        *visual,
        "  </link>",
    ]


def _draw_link(end: Frame) -> list[str]:
    """A box from the joint's frame to the next one."""
    length = math.hypot(*end.origin)
    if not length:
        return []
    x, y, z = (entry / length for entry in end.origin)
    middle = write_numbers(0.5 * entry for entry in end.origin)
    turned = write_numbers((0.0, math.atan2(-z, math.hypot(x, y)), math.atan2(y, x)))
    return [
        "    <visual>",
        f'      <origin xyz="{middle}" rpy="{turned}"/>',
        f'      <geometry><box size="{write_numbers((length, 0.1 * length, 0.1 * length))}"/></geometry>',
        "    </visual>",
    ]


def _write_fixed_link(name: str, parent: str, frame: Frame, body: LinkBody | None = None) -> list[str]:
    """A frame, or a body, that is fixed to a link."""
    return [
        f'  <joint name="{name}_joint" type="fixed">',
        f"    {_write_frame(frame)}",
        f"    <parent link={quoteattr(parent)}/>",
        f'    <child link="{name}"/>',
        "  </joint>",
        *_write_link(name, body, []),
    ]


def _write_frame(frame: Frame) -> str:
    turn = "" if frame.rotation == NO_TURN else f' rpy="{write_numbers(find_roll_pitch_yaw(frame.rotation))}"'
    return f'<origin xyz="{write_numbers(frame.origin)}"{turn}/>'


def find_roll_pitch_yaw(quaternion: tuple[float, ...]) -> tuple[float, float, float]:
    """Find the angles of a rotation as URDF states it: about x, then y, then z of the frame before.

    Roll and pitch are taken from what is left of the rotation without its yaw. So the three make the rotation to the
    last digit even at a pitch of a right angle, where yaw and roll alone are uncertain.

    Args:
        quaternion: Unit quaternion w, x, y, z.

    Returns:
        Roll, pitch and yaw, rad.

    """
    w, x, y, z = (entry / math.hypot(*quaternion) for entry in quaternion)
    R = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    yaw = math.atan2(R[1][0], R[0][0])
    c, s = math.cos(yaw), math.sin(yaw)
    roll = math.atan2(s * R[0][2] - c * R[1][2], c * R[1][1] - s * R[0][1])
    pitch = math.atan2(-R[2][0], c * R[0][0] + s * R[1][0])
    return roll, pitch, yaw
