"""Sizes of torques and friction that a robot file does not state.

Legend: τ_c Coulomb friction, N m at the motor; g gravity; α angle by which a base is tilted.
Source of a free rotor's acceleration: 1200 rad/s² at the joint in the paper's Table I, 4400 rad/s² in DFKI's pendulum
(its model 2.0).
Source of friction: of the largest torque τ_c is 2 to 3 % in the double pendulum of DFKI's underactuated lab (its
model 2.0), 6 % in EMPS (Janot, Gautier, Brunot, Workshop on Nonlinear System Identification Benchmarks, 2019), 35 %
in the paper's Table I.
"""

from __future__ import annotations

import math

import numpy as np

from gen.robot.description import Robot
from gen.robot.link_geometry import list_link_geometry
from gen.robot.schema import keys_of

MEANT_POSITION, MEANT_VELOCITY = (
    3.0,
    10.0,
)  # rad or m, and the same a second: motion of a joint for which a model is meant
DEFAULT_CURRENT = 10.0  # A, where the file states no largest one
LEAST_INPUT_OVER_FRICTION = 10.0  # times τ_c: least of the largest input where the file states no limit
LEAST_INPUT_TORQUE = 1.0  # N m, where there is nothing to move
SWIFT_ACCELERATION = (
    2.0  # rad/s² or m/s²: acceleration of the stretched arm, beside gravity, that the largest input reaches
)
ROTOR_ACCELERATION = 1000.0  # rad/s² or m/s² at the joint: that of a free rotor under the largest torque
EARTH_GRAVITY = 9.81  # m/s²
LARGE_TILT = 0.17  # rad, 10°: up to it gravity along itself is lost by half its square
USUAL_FRICTION_SHARE = 0.05  # τ_c where the file has none, as a share of the largest torque
GRAVITY_BY_TILT = ("gravity_x_by_tilt", "gravity_y_by_tilt")


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
        return d.max_current or DEFAULT_CURRENT
    if limit:
        return limit / d.ratio.nominal
    return _round_to_1_2_5(
        max(LEAST_INPUT_OVER_FRICTION * d.coulomb_friction.nominal, lifting_torque(robot, j)) or LEAST_INPUT_TORQUE
    )


def usual_size(robot: Robot, j: int, key: str) -> float:
    """Find the usual size of a key of a joint's drive.

    Args:
        robot: The robot description.
        j: The joint's number from 1.
        key: The key, "largest_input" for `largest_input`, "carried_inertia" for the inertia about the joint of all
            links from it on, stretched, kg m², or "gravity_x_by_tilt" for `gravity_by_tilt`, which has no joint.

    Returns:
        The size of the nominal value, in its unit. Where that is 0, usual friction, a usual rotor, or the key's width.

    """
    if key in GRAVITY_BY_TILT:
        return gravity_by_tilt(robot, GRAVITY_BY_TILT.index(key))
    drive = robot.joints[j - 1].drive
    value = getattr(drive, key, None)
    if key == "largest_input":
        return largest_input(robot, j)
    if key == "carried_inertia":
        return _stretch_arm(robot, j)[1]
    if value is not None and value.nominal:
        return float(abs(value.nominal))
    constant = 1.0
    if drive.torque_constant is not None:
        constant = abs(drive.torque_constant.nominal)
    if key == "coulomb_friction":
        return USUAL_FRICTION_SHARE * constant * largest_input(robot, j)
    if key == "motor_inertia":
        return constant * largest_input(robot, j) / (ROTOR_ACCELERATION * drive.ratio.nominal)
    if key == "viscous_friction":  # at the largest speed as large as dry friction
        return usual_size(robot, j, "coulomb_friction") / (MEANT_VELOCITY * drive.ratio.nominal)
    return keys_of("joint.drive")[key].zero_width


def gravity_by_tilt(robot: Robot, axis: int) -> float:
    """Find the gravity that comes along an axis of the plane by a tilt of the base.

    A tilt turns gravity without making it longer or shorter: across an axis it comes in by sin α, and what points
    along the axis is lost by 1 − cos α only. Of gravity that the robot file does not state in the plane, the rest
    points out of it.

    Args:
        robot: The robot description, of an arm in the plane.
        axis: 0 for x, 1 for y.

    Returns:
        The gravity for a radian of small tilt, m/s².

    """
    x, y = (part.nominal for part in robot.gravity)
    out_of_plane = math.sqrt(max(EARTH_GRAVITY**2 - x**2 - y**2, 0.0))
    along, beside = ((x, y), (y, x))[axis]
    return math.hypot(beside, out_of_plane, 0.5 * LARGE_TILT * along)


def _round_to_1_2_5(size: float) -> float:
    """The nearest of …, 1, 2, 5, 10, …: new estimates of a file's masses leave the meant motions as they are."""
    tens = 10.0 ** math.floor(math.log10(size))
    return min((tens * step for step in (1.0, 2.0, 5.0, 10.0)), key=lambda one: abs(math.log(one / size)))


def lifting_torque(robot: Robot, j: int) -> float:
    """Find the torque that lifts the stretched, level arm and accelerates it by SWIFT_ACCELERATION.

    Args:
        robot: The robot description.
        j: The joint's number from 1.

    Returns:
        The torque, N m at the motor of the joint.

    """
    g = math.hypot(*(part.nominal for part in robot.gravity))
    drive = robot.joints[j - 1].drive
    moment, links_inertia = _stretch_arm(robot, j)
    inertia = drive.ratio.nominal**2 * drive.motor_inertia.nominal + links_inertia
    return (moment * g + SWIFT_ACCELERATION * inertia) / drive.ratio.nominal


def _stretch_arm(robot: Robot, j: int) -> tuple[float, float]:
    """First moment, kg m, and inertia, kg m², about a joint of all links from it on, stretched; kg where it slides."""
    moment, inertia, reach = 0.0, 0.0, 0.0
    links = list_link_geometry(robot.joints)
    for k, link in enumerate(links[j - 1 :]):
        if k:
            reach += math.hypot(*link.origin)
        arm, own_inertia = reach + math.hypot(*link.center_of_mass), max(float(np.max(link.inertia)), 0.0)
        if robot.joints[j - 1].kind == "prismatic":
            arm, own_inertia = 1.0, 0.0
        moment += link.mass * arm
        inertia += link.mass * arm**2 + own_inertia
    return moment, inertia
