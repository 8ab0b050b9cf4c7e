"""A robot as a MuJoCo model (MJCF), written from its numbers.

A flexible joint is two joints in series: ``NAME`` turns the rotor, at the scale of the joint, and ``NAME_torsion`` the
link against it, with the spring. Source: MuJoCo 4.0, XML Reference: body/joint (armature, damping, stiffness,
frictionloss), tendon/fixed (springlength with a dead band, armature), actuator/general (delay, dyntype, ctrlrange).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from xml.sax.saxutils import quoteattr

from hdagen.model_export.joint_numbers import JointNumbers, RobotNumbers, Transmission
from hdagen.model_export.link_numbers import NO_TURN, Frame, LinkBody

FRICTION_IMPEDANCE = "0.9999 0.9999 0.001 0.5 2"  # MuJoCo's hardest, so that dry friction holds and hardly creeps
FRICTION_DECAY = 1.5  # share of a creeping speed that friction takes off in a step: stable up to 2, of RK4 up to 2.8
LEAST_MASS, LEAST_INERTIA = 1e-9, 1e-12  # kg and kg m² of a body that the model needs and the robot does not have
_FAR = 1e6  # rad or m, beyond any joint position


def write_number(value: float) -> str:
    """Write a number so that it is read back exactly.

    Args:
        value: The number.

    Returns:
        The shortest such text.

    """
    return repr(float(value) + 0.0).removesuffix(".0")


def write_numbers(values: Iterable[float]) -> str:
    """Write numbers with blanks between.

    Args:
        values: The numbers.

    Returns:
        Their text.

    """
    return " ".join(map(write_number, values))


def write_document(name: str, numbers: RobotNumbers, step: float) -> str:
    """Write a robot as a MuJoCo model.

    Args:
        name: The model's name.
        numbers: The robot's numbers.
        step: The integration step, s.

    Returns:
        The text of the file.

    """
    joints, gravity = numbers.joints, write_numbers(numbers.gravity)
    lines = [
        f"<mujoco model={quoteattr(name)}>",
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option timestep="{write_number(step)}" integrator="RK4" gravity="{gravity}"/>',
        "  <default>",
        f"    <!-- the second number belongs to this timestep: -{FRICTION_DECAY:g} / timestep -->",
        f'    <joint solreffriction="-1 {write_number(-FRICTION_DECAY / step)}"'
        f' solimpfriction="{FRICTION_IMPEDANCE}"/>',
        '    <geom contype="0" conaffinity="0" group="1"/>',
        "  </default>",
        "  <worldbody>",
        *_write_bodies(numbers, 0, "    "),
        "  </worldbody>",
    ]
    for section, entries in (
        ("tendon", [line for j in range(len(joints)) for line in _write_tendons(joints, j, numbers.in_space)]),
        ("actuator", [_write_actuator(joint, step) for joint in joints]),
        ("sensor", [line for joint in joints for line in _write_sensors(joint, step)]),
    ):
        if entries:
            lines += [f"  <{section}>", *(f"    {entry}" for entry in entries), f"  </{section}>"]
    return "\n".join([*lines, "</mujoco>", ""])


def write_delay_attributes(delay: float, step: float, has_stages: bool = True) -> str:
    """Write the attributes of a delayed actuator or sensor.

    A control between two samples is their weighted mean, which is the mean over a step of what arrives late. An
    integrator with stages reads all over the step, half of it later on average.

    Args:
        delay: The delay, s.
        step: The integration step, s. MuJoCo delays by a step at least.
        has_stages: Whether the integrator has stages within a step (RK4).

    Returns:
        The attributes, with a blank before; empty for a delay that is nearer to none than to a step.

    """
    if delay < 0.5 * step:
        return ""
    late = max(delay, step) + 0.5 * step * has_stages
    return f' delay="{write_number(late)}" nsample="{math.ceil(late / step - 1e-6) + 1}" interp="linear"'


def _write_bodies(numbers: RobotNumbers, j: int, indent: str) -> list[str]:
    """Link ``j`` (from 0) and all that it carries."""
    if j == len(numbers.joints):
        return _write_tip(numbers, indent)
    joint, ahead = numbers.joints[j], (*numbers.joints[j + 1 :], None)[0]
    name, kind = joint.name, _write_kind(joint)
    inner = [
        write_inertial(joint.body),
        *_draw_link(joint, ahead.frame if ahead else numbers.tip),
        *_write_bodies(numbers, j + 1, ""),
    ]
    if joint.transmission is None:
        stiffness = ""
        if joint.cable_stiffness:
            rest = write_number(joint.cable_rest)
            stiffness = f' stiffness="{write_number(joint.cable_stiffness)}" springref="{rest}"'
        body = [_write_driven_joint(joint, kind, stiffness), *inner]
    else:
        least = f'mass="{LEAST_MASS:g}" diaginertia="{LEAST_INERTIA:g} {LEAST_INERTIA:g} {LEAST_INERTIA:g}"'
        body = [
            _write_driven_joint(joint, kind, ""),
            f'<inertial pos="0 0 0" {least}/>',
            f"<body name={quoteattr(f'{name}_link')}>",
            *(f"  {line}" for line in (_write_torsion_joint(joint, kind, joint.transmission), *inner)),
            "</body>",
        ]
    outer = f"{name}_rotor" if joint.transmission else f"{name}_link"
    lines = [f"<body name={quoteattr(outer)}{_write_frame(joint.frame)}>", *(f"  {line}" for line in body), "</body>"]
    return [f"{indent}{line}" for line in lines]


def write_inertial(body: LinkBody) -> str:
    """Write a body's element with its mass.

    Args:
        body: The body.

    Returns:
        The element.

    """
    moments, products = body.inertia[:3], body.inertia[3:]
    inertia = f'diaginertia="{write_numbers(max(moment, LEAST_INERTIA) for moment in moments)}"'
    if any(products):
        inertia = f'fullinertia="{write_numbers(body.inertia)}"'
    mass = write_number(max(body.mass, LEAST_MASS))
    return f'<inertial pos="{write_numbers(body.center)}" mass="{mass}" {inertia}/>'


def _write_frame(frame: Frame) -> str:
    """The attributes of a body's or site's place."""
    turn = "" if frame.rotation == NO_TURN else f' quat="{write_numbers(frame.rotation)}"'
    return f' pos="{write_numbers(frame.origin)}"{turn}'


def _write_kind(joint: JointNumbers) -> str:
    """Type and axis of a joint."""
    return f'type="{"slide" if joint.is_prismatic else "hinge"}" axis="{write_numbers(joint.axis)}"'


def _write_driven_joint(joint: JointNumbers, kind: str, more: str) -> str:
    """The joint that the motor drives."""
    armature = 0.0 if joint.rotor_coupling else joint.armature  # else in a tendon
    parts = [f"<joint name={quoteattr(joint.name)} {kind}"]
    if armature:
        parts.append(f'armature="{write_number(armature)}"')
    if joint.damping or joint.quadratic_damping:
        further = f" {write_number(joint.quadratic_damping)}" if joint.quadratic_damping else ""
        parts.append(f'damping="{write_number(joint.damping)}{further}"')
    if joint.frictionloss > 0:
        parts.append(f'frictionloss="{write_number(joint.frictionloss)}"')
    if joint.position_limits:
        parts.append(f'range="{write_numbers(joint.position_limits)}"')
    if joint.transmission is None and joint.torque_limit:
        parts.append(f'actuatorfrcrange="{write_numbers((-joint.torque_limit, joint.torque_limit))}"')
    return " ".join(parts) + f"{more}/>"


def _write_torsion_joint(joint: JointNumbers, kind: str, spring: Transmission) -> str:
    """The joint of the link against the rotor; a play's spring is a tendon."""
    parts = [f"<joint name={quoteattr(f'{joint.name}_torsion')} {kind}"]
    if not spring.play:
        parts.append(f'stiffness="{_write_stiffness(spring)}"')
    if spring.damping:
        parts.append(f'damping="{write_number(spring.damping)}"')
    return " ".join(parts) + "/>"


def _write_stiffness(spring: Transmission) -> str:
    if spring.cubic:
        return f"{write_number(spring.linear)} 0 {write_number(spring.cubic)}"
    return write_number(spring.linear)


def _draw_link(joint: JointNumbers, ahead: Frame) -> list[str]:
    """A shape without mass and contacts, to be looked at: to the frame ahead, or through the centre of mass."""
    end = ahead.origin if any(ahead.origin) else tuple(2 * place for place in joint.body.center)
    length = math.hypot(*end)
    if joint.is_prismatic:
        return ['<geom type="box" size="0.05 0.03 0.03" mass="0"/>']
    if length < 1e-6:
        return []
    width = write_number(min(0.03, 0.1 * length))
    return [f'<geom type="capsule" fromto="0 0 0 {write_numbers(end)}" size="{width}" mass="0"/>']


def _write_tip(numbers: RobotNumbers, indent: str) -> list[str]:
    """The tip, with the mass on it."""
    place = _write_frame(numbers.tip)
    lines = [f'{indent}<site name="tip"{place}/>']
    if numbers.payload.mass:
        lines += [
            f'{indent}<body name="payload"{place}>',
            f"{indent}  {write_inertial(numbers.payload)}",
            f"{indent}</body>",
        ]
    return lines


def _write_tendons(joints: tuple[JointNumbers, ...], j: int, in_space: bool) -> list[str]:
    """The tendons of joint ``j``: position, cable, play, obstacles, and a rotor that turns with the link before it."""
    joint, lines = joints[j], list[str]()
    position = _write_wraps((joint.name, 1.0))
    if joint.transmission:
        position = _write_wraps((joint.name, 1.0), (f"{joint.name}_torsion", 1.0))
        cable = ""
        if joint.cable_stiffness:
            rest = write_number(joint.cable_rest)
            cable = f' stiffness="{write_number(joint.cable_stiffness)}" springlength="{rest} {rest}"'
        lines.append(_write_tendon(f"{joint.name}_position", cable, position))
        if joint.transmission.play:
            half = write_number(0.5 * joint.transmission.play)
            spring = f' stiffness="{_write_stiffness(joint.transmission)}" springlength="-{half} {half}"'
            lines.append(_write_tendon(f"{joint.name}_play", spring, _write_wraps((f"{joint.name}_torsion", 1.0))))
    for stop in joint.soft_stops:
        free = f"{write_number(-_FAR)} {write_number(stop.angle)}"
        if stop.side < 0:
            free = f"{write_number(stop.angle)} {write_number(_FAR)}"
        spring = f' stiffness="{write_number(stop.stiffness)}" springlength="{free}"'
        lines.append(_write_tendon(f"{joint.name}_{'above' if stop.side > 0 else 'below'}", spring, position))
    if joint.rotor_coupling and j and not in_space:
        rotor = f' armature="{write_number(joint.rotor_inertia)}"'
        carrier = [(joints[j - 1].name, joint.rotor_coupling)]
        if joints[j - 1].transmission:
            carrier.append((f"{joints[j - 1].name}_torsion", joint.rotor_coupling))
        lines.append(_write_tendon(f"{joint.name}_rotor", rotor, _write_wraps(*carrier, (joint.name, joint.ratio))))
    return lines


def _write_wraps(*joints: tuple[str, float]) -> str:
    return "".join(f'<joint joint={quoteattr(name)} coef="{write_number(factor)}"/>' for name, factor in joints)


def _write_tendon(name: str, attributes: str, wraps: str) -> str:
    return f"<fixed name={quoteattr(name)}{attributes}>{wraps}</fixed>"


def _write_actuator(joint: JointNumbers, step: float) -> str:
    """The motor; its control is the robot's input (A, or N m at the motor), its length the motor's angle."""
    ratio = joint.ratio
    text = (
        f'<general name={quoteattr(joint.name)} joint={quoteattr(joint.name)} gear="{write_number(ratio)}"'
        f' gainprm="{write_number(joint.gain / ratio)}"'
    )
    if joint.bias:
        text += f' biastype="affine" biasprm="{write_number(joint.bias / ratio)} 0 0"'
    if math.isfinite(joint.input_limit):
        most = write_number(joint.input_limit)
        text += f' ctrlrange="-{most} {most}"'
    if joint.lag:
        text += f' dyntype="filterexact" dynprm="{write_number(joint.lag)}"'
    return text + write_delay_attributes(joint.delay, step) + "/>"


def _write_sensors(joint: JointNumbers, step: float) -> list[str]:
    """The encoders of the joint and of the motor, the joint's as late as it is read."""
    noise = f' noise="{write_number(joint.encoder_noise)}"' if joint.encoder_noise else ""
    source = f"<jointpos name={quoteattr(f'{joint.name}_encoder')} joint={quoteattr(joint.name)}"
    if joint.transmission:
        tendon = quoteattr(f"{joint.name}_position")
        source = f"<tendonpos name={quoteattr(f'{joint.name}_encoder')} tendon={tendon}"
    motor = f' noise="{write_number(joint.motor_encoder_noise)}"' if joint.motor_encoder_noise else ""
    return [
        f"{source}{noise}{write_delay_attributes(joint.sensor_delay, step, False)}/>",
        f"<actuatorpos name={quoteattr(f'{joint.name}_motor_encoder')} actuator={quoteattr(joint.name)}{motor}/>",
    ]
