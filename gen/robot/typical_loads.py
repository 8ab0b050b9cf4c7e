"""Sizes of torques and friction that a robot file does not state.

Legend: τ_c Coulomb friction, N m at the motor; g gravity.
Source: of the largest torque τ_c is 2 to 3 % in the double pendulum of DFKI's underactuated lab (its model 2.0), 6 %
in EMPS (Janot, Gautier, Brunot, Workshop on Nonlinear System Identification Benchmarks, 2019), 35 % in the paper's
Table I.
"""

from __future__ import annotations

import math

from gen.robot.description import Robot
from gen.robot.schema import keys

POSITION, VELOCITY = 3.0, 10.0  # rad or m, and the same a second: motion of a joint for which a model is meant
CURRENT = 10.0  # A, where the file states no largest one
LOSSES = 10.0  # times τ_c: least of the largest input where the file states no limit
NOTHING = 1.0  # N m, where there is nothing to move
SWIFTLY = 2.0  # rad/s² or m/s²: acceleration of the stretched arm, beside gravity, that the largest input reaches
FRICTION = 0.05  # τ_c where the file has none, as a share of the largest torque


def largest_input(robot: Robot, j: int) -> float:
    """Find the largest input of a joint for which the model is meant.

    Args:
        robot: The robot description.
        j: The joint's number from 1.

    Returns:
        Current, A, or torque at the motor, N m, where the input is torque.

    """
    d, limit = robot.joints[j - 1].drive, robot.joints[j - 1].limits.torque
    if d.torque_constant is not None:
        return d.max_current or CURRENT
    if limit:
        return limit / d.ratio.nominal
    return _round(max(LOSSES * d.coulomb_friction.nominal, lifting(robot, j)) or NOTHING)


def usual(robot: Robot, j: int, key: str) -> float:
    """Find the usual size of a key of a joint's drive.

    Args:
        robot: The robot description.
        j: The joint's number from 1.
        key: The key, or "largest_input" for `largest_input`.

    Returns:
        The size of the nominal value, in its unit. Where that is 0, usual friction, or the key's width.

    """
    drive = robot.joints[j - 1].drive
    value = getattr(drive, key, None)
    if key == "largest_input":
        return largest_input(robot, j)
    if value is not None and value.nominal:
        return float(abs(value.nominal))
    if key == "coulomb_friction":
        constant = 1.0
        if drive.torque_constant is not None:
            constant = drive.torque_constant.nominal
        return FRICTION * abs(constant) * largest_input(robot, j)
    if key == "viscous_friction":  # at the largest speed as large as dry friction
        return usual(robot, j, "coulomb_friction") / (VELOCITY * drive.ratio.nominal)
    return keys("joint.drive")[key].width


def _round(size: float) -> float:
    """The nearest of …, 1, 2, 5, 10, …: new estimates of a file's masses leave the meant motions as they are."""
    tens = 10.0 ** math.floor(math.log10(size))
    return min((tens * step for step in (1.0, 2.0, 5.0, 10.0)), key=lambda one: abs(math.log(one / size)))


def lifting(robot: Robot, j: int) -> float:
    """Find the torque that lifts the stretched, level arm and accelerates it by SWIFTLY.

    Args:
        robot: The robot description.
        j: The joint's number from 1.

    Returns:
        The torque, N m at the motor of the joint.

    """
    g = math.hypot(*(part.nominal for part in robot.gravity))
    slides, drive = robot.joints[j - 1].kind == "prismatic", robot.joints[j - 1].drive
    weight, inertia, reach = 0.0, drive.ratio.nominal**2 * drive.motor_inertia.nominal, 0.0
    for joint in robot.joints[j - 1 :]:
        arm, own_inertia = reach + abs(joint.center_of_mass.nominal), max(joint.inertia.nominal, 0.0)
        if slides:
            arm, own_inertia = 1.0, 0.0
        weight += joint.mass.nominal * g * arm
        inertia += joint.mass.nominal * arm**2 + own_inertia
        reach += joint.length.nominal
    return (weight + SWIFTLY * inertia) / drive.ratio.nominal
