"""How large torques and friction of a joint are that its robot file does not state.

Legend: τ_c Coulomb friction, N m at the motor; g gravity.
Source: of the largest torque τ_c is 2 to 3 % in the double pendulum of DFKI's underactuated lab (its model 2.0), 6 %
in EMPS (Janot, Gautier, Brunot, Workshop on Nonlinear System Identification Benchmarks, 2019), 35 % in the paper's
Table I.
"""

from __future__ import annotations

import math

from gen.description import Robot
from gen.schema import keys

POSITION, VELOCITY = 3.0, 10.0  # rad or m, and a second, of a joint, that a model is meant for
CURRENT = 10.0  # A, where the file states no largest one
LOSSES = 10.0  # times τ_c, that an input reaches at least where the file states no limit
NOTHING = 1.0  # N m, where there is nothing to move
SWIFTLY = 2.0  # rad/s² or m/s², that it reaches with the arm stretched against gravity
FRICTION = 0.05  # of the largest torque, that τ_c is where the file has none


def largest_input(robot: Robot, j: int) -> float:
    """Of joint j's input, A, or N m at the motor, up to which the model is meant to be used."""
    d, limit = robot.joints[j - 1].drive, robot.joints[j - 1].limits.torque
    if d.torque_constant is not None:
        return d.max_current or CURRENT
    if limit:
        return limit / d.ratio.nominal
    return _round(max(LOSSES * d.coulomb_friction.nominal, lifting(robot, j)) or NOTHING)


def usual(robot: Robot, j: int, key: str) -> float:
    """Size of a key of joint j's drive: its nominal; where that is 0 what is usual of friction, of others the key's
    width; "largest_input": `largest_input`."""
    drive = robot.joints[j - 1].drive
    value = getattr(drive, key, None)
    if key == "largest_input":
        return largest_input(robot, j)
    if value is not None and value.nominal:
        return float(abs(value.nominal))
    if key == "coulomb_friction":
        constant = drive.torque_constant.nominal if drive.torque_constant is not None else 1.0
        return FRICTION * abs(constant) * largest_input(robot, j)
    if key == "viscous_friction":  # at the largest speed as large as dry friction
        return usual(robot, j, "coulomb_friction") / (VELOCITY * drive.ratio.nominal)
    return keys("joint.drive")[key].width


def _round(size: float) -> float:
    """The nearest of …, 1, 2, 5, 10, …: a file whose masses were estimated anew means the same motions."""
    tens = 10.0 ** math.floor(math.log10(size))
    return min((tens * step for step in (1.0, 2.0, 5.0, 10.0)), key=lambda one: abs(math.log(one / size)))


def lifting(robot: Robot, j: int) -> float:
    """N m at the motor of joint j, that lift the arm, stretched and level, and accelerate it so."""
    g = math.hypot(*(part.nominal for part in robot.gravity))
    slides, drive = robot.joints[j - 1].kind == "prismatic", robot.joints[j - 1].drive
    weight, inertia, reach = 0.0, drive.ratio.nominal**2 * drive.motor_inertia.nominal, 0.0
    for joint in robot.joints[j - 1 :]:
        arm = 1.0 if slides else reach + abs(joint.center_of_mass.nominal)
        weight += joint.mass.nominal * g * arm
        inertia += joint.mass.nominal * arm**2 + (0.0 if slides else max(joint.inertia.nominal, 0.0))
        reach += joint.length.nominal
    return (weight + SWIFTLY * inertia) / drive.ratio.nominal
