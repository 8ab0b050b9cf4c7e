"""A drive that the robot file calls rigid, made flexible for the effect `missing_compliance`: one linear spring.

The wave generator's spring is made a million times stiffer than the flexspline's, and neither stiffens. The effect then
scales the spring's level, so that its compliance is free between the drive as built and any other.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from gen.effects.effect import Parameter
from gen.effects.missing_compliance import EFFECT
from gen.robot.consistency_checks import LEAST_ROTOR_INERTIA
from gen.robot.description import Drive, Joint, Robot, StatedEffect, Value
from gen.robot.gear_catalogue import LEAST_STIFFENING
from gen.robot.mass_matrix import joint_mobility
from gen.robot.smoothing_width import SMOOTHING_MARGIN

LAW_TORSION = 0.1  # rad (or m) of torsion to which the law goes
LARGEST_MODE_STEP = 2.0  # of the fastest oscillation and decay, a step: RK4 is stable to 2.78
LARGEST_VISCOUS_STEP = 0.5  # of the decay that viscous friction makes
SOFTNESS_PARAMETER, DAMPING_PARAMETER = EFFECT.parameters


def split_spring_effects(extra: tuple[str, ...], n: int) -> tuple[frozenset[int], tuple[str, ...]]:
    """Find the joints whose rigid drives get a spring.

    Args:
        extra: Names of effects to add; ``missing_compliance@2`` names joint 2 alone, ``missing_compliance`` all.
        n: Number of joints.

    Returns:
        The joints from 1 that get a spring, and the names of the effects without a joint.

    """
    everywhere = frozenset(range(1, n + 1))
    of = {f"{EFFECT.name}@{j}": frozenset({j}) for j in everywhere} | {EFFECT.name: everywhere}
    sprung, names = frozenset[int](), []
    for name in extra:
        if name in of:
            sprung |= of[name]
            names.append(EFFECT.name)
        else:
            names.append(name)
    return sprung, tuple(names)


def add_springs(robot: Robot, given: Collection[int]) -> Robot:
    """Put springs into the rigid drives that state the effect, and into those of the joints given.

    A drive that does not state the effect gets a spring so soft, and so little damped, that the robot's step carries
    it. It gets none where that spring would be softer than a spring may be, where there is no rotor to turn, or where
    the step does not carry the rotor alone.

    Args:
        robot: The robot description.
        given: Joints from 1 whose rigid drives are to get a spring.

    Returns:
        The robot with springs, and with the effects that were assumed for them.

    """
    stated = {effect.joint: effect.parameters for effect in robot.effects if effect.name == EFFECT.name}
    joints = list(robot.joints)
    for j, joint in enumerate(joints, 1):
        if joint.drive.rigid and (j in stated or (j in given and _has_free_rotor(joint.drive, robot.step))):
            joints[j - 1] = _make_flexible(joint, _nominal_value(stated.get(j, {}), SOFTNESS_PARAMETER), robot.step)
    assumed = []
    for j, values in _carried_values(tuple(joints), robot.step).items():
        if j in stated or robot.joints[j - 1] is joints[j - 1]:
            continue
        softness = values[SOFTNESS_PARAMETER.name].nominal
        if softness > SOFTNESS_PARAMETER.high:
            joints[j - 1] = robot.joints[j - 1]
        elif values != {p.name: Value(p.nominal, 0.0) for p in EFFECT.parameters}:
            joints[j - 1] = _make_flexible(robot.joints[j - 1], softness, robot.step)
            assumed.append(StatedEffect(EFFECT.name, j, values, assumed=True))
    return replace(robot, joints=tuple(joints), effects=(*robot.effects, *assumed))


def _has_free_rotor(drive: Drive, step: float) -> bool:
    """Whether there is a rotor to turn by itself, so heavy that a ``step``, s, carries its viscous friction."""
    inertia = drive.motor_inertia.nominal
    return inertia >= LEAST_ROTOR_INERTIA and drive.viscous_friction.nominal * step <= LARGEST_VISCOUS_STEP * inertia


def _nominal_value(stated: dict[str, Value], parameter: Parameter) -> float:
    if parameter.name in stated:
        return stated[parameter.name].nominal
    return parameter.nominal


def _carried_values(joints: tuple[Joint, ...], step: float) -> dict[int, dict[str, Value]]:
    """The effect's values at each flexible joint: nominal, or softer and less damped where a ``step``, s, needs it.

    With M and J the inertia of link and rotor, 1/M + 1/(N² J) times the stiffness is the square of an oscillation, and
    times the damping a decay. Each joint gets an equal share of the fastest that the step carries, as at most the
    motions of all joints add.
    """
    flexible = [j for j, joint in enumerate(joints, 1) if not joint.drive.rigid]
    found: dict[int, dict[str, Value]] = {}
    if not flexible:
        return found
    ease = joint_mobility(joints)
    for j in flexible:
        drive = joints[j - 1].drive
        rotor = drive.ratio.nominal**2 * drive.motor_inertia.nominal
        share = len(flexible) * (float(ease[j - 1]) + 1.0 / rotor)
        softness, damping = share * (step / LARGEST_MODE_STEP) ** 2, LARGEST_MODE_STEP / (share * step)
        values = max(SOFTNESS_PARAMETER.nominal, softness), min(DAMPING_PARAMETER.nominal, damping)
        found[j] = {p.name: Value(value, 0.0) for p, value in zip(EFFECT.parameters, values, strict=True)}
    return found


def _make_flexible(joint: Joint, compliance: float, step: float) -> Joint:
    drive, stiffness = joint.drive, 1.0 / compliance
    width = (
        SMOOTHING_MARGIN * drive.coulomb_friction.nominal * step / drive.motor_inertia.nominal
    )  # the rotor is alone now
    made: Drive = replace(
        drive,
        rigid=False,
        compliant=True,
        friction_smoothing=Value(max(width, drive.friction_smoothing.nominal), 0.0),
        flexspline_stiffness=Value(stiffness, 0.0),
        flexspline_stiffening=Value(LEAST_STIFFENING, 0.0),
        wave_generator_stiffness=Value(1e6 * stiffness / drive.ratio.nominal**2, 0.0),
        wave_generator_stiffening=Value(1e-3, 0.0),
        torsional_damping=Value(0.0, 0.0),
        law_torque=Value(LAW_TORSION * stiffness, 0.0),
    )
    return replace(joint, drive=made)
