"""Where a robot's joints stand and what their links weigh, in space, whichever form the robot file has.

In the short form a revolute joint turns about z and a prismatic joint slides along x; each link lies along x, and its
one inertia counts about every axis.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm

SPATIAL_AXES = "xyz"
INERTIA_ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")
NO_TURN = (1.0, 0.0, 0.0, 0.0)
_COMPARED_POSES = 40  # at which the weight of a tilted arm is compared
_SEED = 0

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Frame:
    """A frame in the one before: ``origin``, m, and ``rotation``, a unit quaternion w, x, y, z."""

    origin: Vector
    rotation: tuple[float, float, float, float] = NO_TURN


@dataclass(frozen=True)
class LinkBody:
    """A rigid body: ``mass`` (kg), ``center`` of mass (m), and ``inertia`` about it (xx, yy, zz, xy, xz, yz; kg m²)."""

    mass: float
    center: Vector = (0.0, 0.0, 0.0)
    inertia: tuple[float, ...] = (0.0,) * 6

    def list_numbers(self, in_space: bool) -> Iterator[tuple[str, float, str]]:
        """List the body's numbers as a robot file names them.

        Args:
            in_space: Whether the robot file has the long form.

        Yields:
            Name, value and unit of each.

        """
        yield "mass", self.mass, "kg"
        if not in_space:
            yield "center_of_mass", self.center[0], "m"
            yield "inertia", self.inertia[2], "kg m²"
            return
        for axis, place in zip(SPATIAL_AXES, self.center, strict=True):
            yield f"center_of_mass_{axis}", place, "m"
        for entry, moment in zip(INERTIA_ENTRIES, self.inertia, strict=True):
            yield f"inertia_{entry}", moment, "kg m²"


def read_joint_frame(arm: Arm, j: int) -> tuple[Frame, Vector]:
    """Read where a joint stands.

    Args:
        arm: The arm.
        j: The joint's number.

    Returns:
        Its frame in that of the joint before, and its axis.

    """
    stated = arm.robot["joints"][j - 1]
    if arm.moves_in_space:
        return Frame(_make_vector(stated["origin"]), _make_quaternion(stated["rotation"])), _make_vector(stated["axis"])
    before = arm.parameters[f"length_{j - 1}"] if j > 1 else 0.0
    axis = (1.0, 0.0, 0.0) if stated["kind"] == "prismatic" else (0.0, 0.0, 1.0)
    return Frame((before, 0.0, 0.0)), axis


def read_link_body(arm: Arm, j: int) -> LinkBody:
    """Read the body of a link at the present parameters.

    Args:
        arm: The arm.
        j: Its joint's number.

    Returns:
        The body, in the joint's frame.

    """
    p = arm.parameters
    if arm.moves_in_space:
        center = _make_vector(p[f"center_of_mass_{axis}_{j}"] for axis in SPATIAL_AXES)
        return LinkBody(p[f"mass_{j}"], center, tuple(p[f"inertia_{entry}_{j}"] for entry in INERTIA_ENTRIES))
    inertia = p[f"inertia_{j}"]
    return LinkBody(p[f"mass_{j}"], (p[f"center_of_mass_{j}"], 0.0, 0.0), (inertia,) * 3 + (0.0,) * 3)


def read_tip(arm: Arm) -> tuple[Frame, LinkBody]:
    """Read the tip and what hangs on it.

    Args:
        arm: The arm.

    Returns:
        The tip's frame in the last joint's, and the payload in the tip's frame.

    """
    p = arm.parameters
    center = _make_vector(p.get(f"payload_{axis}_{arm.n}", 0.0) for axis in SPATIAL_AXES)
    payload = LinkBody(p.get(f"payload_mass_{arm.n}", 0.0), center)
    if arm.moves_in_space:
        tip = arm.robot["tip"]
        return Frame(_make_vector(tip["origin"]), _make_quaternion(tip["rotation"])), payload
    return Frame((p[f"length_{arm.n}"], 0.0, 0.0)), payload


def read_gravity(arm: Arm) -> Vector:
    """Read gravity in the frame of the base, a tilt of which counts.

    Args:
        arm: The arm.

    Returns:
        Its components, m/s². Of a base in space that tilts, the nearest to the file's that makes the same torques.

    """
    p = arm.parameters
    if not arm.moves_in_space:
        return (p["gravity_x"] + p.get("tilt_x", 0.0), p["gravity_y"] + p.get("tilt_y", 0.0), 0.0)
    gravity = np.array([p[f"gravity_{axis}"] for axis in SPATIAL_AXES])
    tilts = [name for name in p if name.startswith("tilt_") and p[name]]
    if tilts:
        gravity = gravity + _find_tilt(arm, tilts)
    return _make_vector(gravity)


def _find_tilt(arm: Arm, tilts: list[str]) -> Array:
    """What tilts add to gravity (3), by the torques that it makes, in which gravity is linear."""
    q = np.random.default_rng(_SEED).uniform(-np.pi, np.pi, (_COMPARED_POSES, arm.n))
    names = list(arm.parameters)

    def compute_weight(changes: dict[str, float]) -> Array:
        values = arm.p.copy()
        for name, value in changes.items():
            values[names.index(name)] = value
        return arm.with_parameters(values).evaluate("gravity_torque", q=q)["g"].ravel()

    level = dict.fromkeys(tilts, 0.0)
    units = [
        compute_weight(level | {f"gravity_{other}": float(other == axis) for other in SPATIAL_AXES})
        for axis in SPATIAL_AXES
    ]
    added = compute_weight({}) - compute_weight(level)
    return np.asarray(np.linalg.lstsq(np.stack(units, axis=1), added)[0])


def _make_vector(values: Iterable[float]) -> Vector:
    x, y, z = map(float, values)
    return x, y, z


def _make_quaternion(values: Iterable[float]) -> tuple[float, float, float, float]:
    w, x, y, z = map(float, values)
    return w, x, y, z
