"""A robot's numbers at its joints, as simulators of rigid bodies state them, a motor's reflected by the ratio.

Legend: N ratio; q joint position; τ joint torque. An effect in `HELD_EFFECTS` is a number here; of any other one a
rigid-body simulator has no element.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.model_export.link_numbers import (
    Frame,
    LinkBody,
    Vector,
    read_gravity,
    read_joint_frame,
    read_link_body,
    read_tip,
)

HELD_EFFECTS = frozenset(
    {
        *("coulomb_friction", "viscous_friction", "quadratic_friction", "asymmetric_friction", "torque_constant"),
        *("current_bias", "current_saturation", "current_loop_lag", "command_delay", "backlash", "stiffness"),
        *(
            "joint_damping",
            "missing_compliance",
            "payload",
            "gravity_tilt",
            "cable_spring",
            "contact",
            "rotor_coupling",
        ),
        "sensor_delay",
    }
)
HELD_IN_THE_PLANE = frozenset({"rotor_coupling"})  # where the axes of rotor and carrier are parallel
_FIT_POINTS = 60
_COUNTING_VARIANCE = 12.0  # variance of counting: resolution² / 12


@dataclass(frozen=True)
class SoftStop:
    """An obstacle at a joint: a spring of ``stiffness`` (N m/rad or N/m) beyond ``angle``; ``side`` is 1 where it is
    met above it, −1 below."""

    angle: float
    stiffness: float
    side: int


@dataclass(frozen=True)
class Transmission:
    """The spring between rotor and link of a joint: torque ``linear`` φ + ``cubic`` φ³ at a torsion φ beyond half the
    ``play``, with ``damping`` beside it (N m/rad, N m/rad³, rad, N m s/rad)."""

    linear: float
    cubic: float
    damping: float
    play: float


@dataclass(frozen=True)
class JointNumbers:
    """The numbers of one joint in SI units, at the joint.

    Attributes:
        name: Its name.
        is_prismatic: Whether it slides along its axis.
        frame: Where it stands, in the frame of the joint before.
        axis: Unit vector in its frame.
        body: Its link, in its frame.
        ratio: Motor angle over joint position.
        armature: Reflected inertia of the rotor.
        rotor_inertia: Inertia of the rotor itself, kg m².
        rotor_coupling: Turns of the rotor by a turn of the link that carries it.
        damping: Viscous friction.
        quadratic_damping: Friction by the square of the speed.
        frictionloss: Level of dry friction.
        transmission: Its spring; None: it is rigid.
        gain: Torque by unit of its input (A, or N m at the motor).
        has_current_input: Whether its input is a current.
        bias: Constant torque.
        input_limit: Largest input that acts; inf: none.
        delay: Time from a command to its effect, s.
        lag: Time constant with which the input follows its command, s.
        cable_stiffness: Of a spring from the base to the link.
        cable_rest: Joint position at which that spring is slack.
        soft_stops: Obstacles.
        position_limits: (low, high), or None.
        speed_limit: Largest speed, or None.
        torque_limit: Largest torque, or None.
        sensor_delay: Age of the joint encoder's reading, s.
        encoder_noise: Standard deviation of the joint encoder, counting included.
        motor_encoder_noise: Standard deviation of the motor's encoder, rad at the motor.

    """

    name: str
    is_prismatic: bool
    frame: Frame
    axis: Vector
    body: LinkBody
    ratio: float
    armature: float
    rotor_inertia: float
    rotor_coupling: float
    damping: float
    quadratic_damping: float
    frictionloss: float
    transmission: Transmission | None
    gain: float
    has_current_input: bool
    bias: float
    input_limit: float
    delay: float
    lag: float
    cable_stiffness: float
    cable_rest: float
    soft_stops: tuple[SoftStop, ...]
    position_limits: tuple[float, float] | None
    speed_limit: float | None
    torque_limit: float | None
    sensor_delay: float
    encoder_noise: float
    motor_encoder_noise: float


@dataclass(frozen=True)
class RobotNumbers:
    """The numbers of a robot.

    Attributes:
        joints: Those of its joints, base first.
        gravity: In the base's frame, m/s².
        tip: The tip's frame in the last joint's.
        payload: What hangs on the tip, in the tip's frame.
        in_space: Whether its joints stand in space.

    """

    joints: tuple[JointNumbers, ...]
    gravity: Vector
    tip: Frame
    payload: LinkBody
    in_space: bool


def read_robot_numbers(arm: Arm, names: tuple[str, ...]) -> RobotNumbers:
    """Read the numbers of an arm at its present parameters.

    Args:
        arm: The arm.
        names: The joints' names, base first.

    Returns:
        The numbers.

    Raises:
        PlantError: A link has a lumped inertia that no body has.

    """
    joints = tuple(_read_joint_numbers(arm, j, name) for j, name in enumerate(names, 1))
    joints = (_move_lumped_inertia(joints[0]), *joints[1:])
    lumped = [joint.name for joint in joints if joint.body.inertia[2] < 0 or joint.armature < 0]
    if lumped:
        raise PlantError(
            f"{arm.robot['name']}: inertia_about_joint of {', '.join(lumped)} is less than mass · center_of_mass², "
            "which no body of a simulator has; state mass and center_of_mass that fit it."
        )
    tip, payload = read_tip(arm)
    return RobotNumbers(joints, read_gravity(arm), tip, payload, arm.moves_in_space)


def list_unheld_effects(arm: Arm) -> list[tuple[str, int]]:
    """List the effects that act in an arm and for which a rigid-body simulator has no element.

    Args:
        arm: The arm.

    Returns:
        Name and joint of each; 0 is the whole arm.

    """
    held = HELD_EFFECTS - HELD_IN_THE_PLANE if arm.moves_in_space else HELD_EFFECTS
    acting = {
        (q.effect, q.joint): None
        for q in arm.parameters.described.values()
        if q.effect and q.role == "amplitude" and q.effect not in held and arm.parameters[q.name]
    }
    return list(acting)


def _move_lumped_inertia(first: JointNumbers) -> JointNumbers:
    """The first joint with a negative inertia of its link in the armature, where it acts alike in a rigid drive."""
    lumped = first.body.inertia[2]
    if lumped >= 0 or first.transmission or first.rotor_coupling:
        return first
    return replace(first, body=replace(first.body, inertia=(0.0,) * 6), armature=first.armature + lumped)


def _read_joint_numbers(arm: Arm, j: int, name: str) -> JointNumbers:
    """The numbers of joint ``j``."""
    p, stated = arm.parameters, arm.robot["joints"][j - 1]
    limits, sensor, drive = stated["limits"], stated["sensor"], stated["drive"]

    def get(key: str, otherwise: float = 0.0) -> float:
        return p.get(f"{key}_{j}", otherwise)

    ratio, is_current = get("ratio"), arm.input_names[j - 1].startswith("motor_current")
    gain = ratio * get("torque_constant", get("torque_gain", 1.0))
    most = 1 / get("saturation_inverse") if get("saturation_inverse") else math.inf
    if is_current and drive["max_current"]:
        most = min(most, drive["max_current"])
    position = limits["position"]
    frame, axis = read_joint_frame(arm, j)
    return JointNumbers(
        name=name,
        is_prismatic=stated["kind"] == "prismatic",
        frame=frame,
        axis=axis,
        body=read_link_body(arm, j),
        ratio=ratio,
        armature=get("motor_inertia") * ratio**2,
        rotor_inertia=get("motor_inertia"),
        rotor_coupling=get("coupling"),
        damping=get("viscous_friction") * ratio**2,
        quadratic_damping=get("quadratic_friction") * ratio**3,
        frictionloss=get("coulomb_friction") * ratio,
        transmission=_read_transmission(arm, j),
        gain=gain,
        has_current_input=is_current,
        bias=(get("bias") - get("asymmetric_torque")) * ratio,
        input_limit=most,
        delay=get("command_delay"),
        lag=get("current_lag"),
        cable_stiffness=get("cable_stiffness"),
        cable_rest=get("cable_rest"),
        soft_stops=_read_soft_stops(get("contact_stiffness_above"), get("contact_stiffness_below"), get),
        position_limits=position and (position[0], position[1]),
        speed_limit=limits["speed"],
        torque_limit=limits["torque"],
        sensor_delay=max(get("sensor_delay"), 0.0),
        encoder_noise=_compute_reading_noise(sensor, "joint"),
        motor_encoder_noise=_compute_reading_noise(sensor, "motor"),
    )


def _read_soft_stops(above: float, below: float, get: Callable[[str], float]) -> tuple[SoftStop, ...]:
    """The obstacles above and below an angle."""
    stops = [SoftStop(get("contact_above"), above, 1), SoftStop(get("contact_below"), below, -1)]
    return tuple(stop for stop in stops if stop.stiffness)


def _read_transmission(arm: Arm, j: int) -> Transmission | None:
    """The spring of joint ``j`` as the odd cubic that is nearest to its law, up to where that law has twice the
    stiffness of rest."""
    p, drive = arm.parameters, arm.robot["joints"][j - 1]["drive"]
    if drive["rigid"] and not p.get(f"missing_compliance_{j}"):
        return None
    play = p.get(f"backlash_angle_{j}", 0.0)
    if compliance := p.get(f"missing_compliance_{j}"):
        return Transmission(1 / compliance, 0.0, p[f"missing_damping_{j}"], play)
    most = min(p[f"law_torque_{j}"], 1 / p[f"flexspline_stiffening_{j}"])
    if limit := arm.robot["joints"][j - 1]["limits"]["torque"]:
        most = min(most, limit)
    torques = np.linspace(0.0, most, _FIT_POINTS + 1)[1:]
    loads = np.zeros((len(torques), arm.n))
    loads[:, j - 1] = torques
    twist = arm.evaluate("torsion", joint_torque=loads)["torsion"][:, j - 1]
    cubic = np.stack([twist, twist**3], axis=1) / torques[:, None]
    (linear, third), *_ = np.linalg.lstsq(cubic, np.ones(len(torques)), rcond=None)
    if third < 0 or linear <= 0:
        linear, third = float(np.sum(torques * twist) / np.sum(twist**2)), 0.0
    level = p.get(f"stiffness_level_{j}", 1.0)
    return Transmission(level * float(linear), level * float(third), p[f"torsional_damping_{j}"], play)


def _compute_reading_noise(sensor: Mapping[str, float], side: str) -> float:
    """Standard deviation of an encoder's reading: its own and that of counting."""
    counting = sensor[f"{side}_encoder_resolution"] ** 2 / _COUNTING_VARIANCE
    return math.sqrt(sensor[f"{side}_encoder_noise"] ** 2 + counting)
