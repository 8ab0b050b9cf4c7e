"""A drive that the robot file calls rigid, made flexible for the effect `missing_compliance`: one linear spring.

The wave generator's spring is made a million times stiffer than the flexspline's, and neither stiffens. The effect then
scales the spring's level, so that its compliance is free between the drive as built and any other.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from gen.description import Drive, Joint, Robot, Value
from gen.effect import Parameter
from gen.effects.missing_compliance import EFFECT
from gen.rules import LEAST_ROTOR

LINEAR = 1e-6  # c_f, 1/(N m): as good as none
FAR = 0.1  # rad (or m) of torsion to which the law goes
ROOM = 2.0  # times the width of smooth friction that the step just carries


def springs(extra: tuple[str, ...], n: int) -> tuple[frozenset[int], tuple[str, ...]]:
    """Of effects to add to a robot of ``n`` joints: the joints whose rigid drives get a spring, of which
    ``missing_compliance@2`` says one and ``missing_compliance`` all; and the names without a joint."""
    everywhere = frozenset(range(1, n + 1))
    of = {f"{EFFECT.name}@{j}": frozenset({j}) for j in everywhere} | {EFFECT.name: everywhere}
    sprung = frozenset[int]().union(*(of[name] for name in extra if name in of))
    return sprung, tuple(EFFECT.name if name in of else name for name in extra)


def compliant(robot: Robot, given: Collection[int]) -> Robot:
    """``robot`` with springs in the rigid drives that state the effect, and in those of the joints ``given`` that have
    a rotor to turn."""
    stated = {effect.joint: effect.parameters for effect in robot.effects if effect.name == EFFECT.name}
    joints = list(robot.joints)
    for j, joint in enumerate(joints, 1):
        rotor = joint.drive.motor_inertia.nominal >= LEAST_ROTOR
        if joint.drive.rigid and rotor and (j in given or j in stated):
            joints[j - 1] = _flexible(joint, _compliance(stated.get(j, {})), robot.step)
    return replace(robot, joints=tuple(joints))


def _compliance(parameters: dict[str, Value]) -> float:
    own: Parameter = EFFECT.parameters[0]
    return parameters[own.name].nominal if own.name in parameters else own.nominal


def _flexible(joint: Joint, compliance: float, step: float) -> Joint:
    drive, stiffness = joint.drive, 1.0 / compliance
    width = ROOM * drive.coulomb_friction.nominal * step / drive.motor_inertia.nominal  # the rotor is alone now
    made: Drive = replace(
        drive,
        rigid=False,
        compliant=True,
        friction_smoothing=Value(max(width, drive.friction_smoothing.nominal), 0.0),
        flexspline_stiffness=Value(stiffness, 0.0),
        flexspline_stiffening=Value(LINEAR, 0.0),
        wave_generator_stiffness=Value(1e6 * stiffness / drive.ratio.nominal**2, 0.0),
        wave_generator_stiffening=Value(1e-3, 0.0),
        torsional_damping=Value(0.0, 0.0),
        law_torque=Value(FAR * stiffness, 0.0),
    )
    return replace(joint, drive=made)
