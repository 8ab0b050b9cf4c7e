"""The parameters of the model that a robot description gives, by name, with unit and bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from gen.robot.description import Joint, PlanarLink, Robot, SpatialLink, Value
from gen.robot.schema import Key, keys_of, unit_at

LINK_KEYS = ("length", "mass", "center_of_mass", "inertia")
AXES = ("x", "y", "z")
SPACE_ENTRIES = {"center_of_mass": AXES, "inertia": ("xx", "yy", "zz", "xy", "xz", "yz")}  # of a link in space
DRIVE_KEYS = (
    "ratio",
    "motor_inertia",
    "torque_constant",
    "viscous_friction",
    "coulomb_friction",
    "friction_smoothing",
    "flexspline_stiffness",
    "flexspline_stiffening",
    "wave_generator_stiffness",
    "wave_generator_stiffening",
    "torsional_damping",
    "law_torque",
)
DISSIPATION_KEYS = ("viscous_friction", "coulomb_friction", "torsional_damping")
INERTIAL_KEYS = ("mass", "inertia", "motor_inertia")
LARGEST_FACTOR = 3.0  # times the nominal that a parameter may be, and its inverse
LARGEST_INERTIAL_FACTOR = 10.0  # the same of masses and inertias: an armature is often a guess
LARGEST_DAMPING_FACTOR = 20.0  # times the nominal damping that a spring may have when it is cold or worn


@dataclass(frozen=True)
class ParameterValue:
    """A parameter of the model; ``joint`` 0 is the whole arm. low ≤ nominal ≤ high. Its standard deviation is
    ``tolerance`` times ``reference_size``. With ``offset`` it is the number that the file states: of a lumped inertia
    mass·center_of_mass²."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    tolerance: float
    reference_size: float
    meaning: str
    joint: int
    offset: float = 0.0


def list_parameters(robot: Robot) -> tuple[ParameterValue, ...]:
    """List the parameters of the model with their bounds.

    A drive without springs, or without a torque constant, has no such parameters. Bounds lie within the physical range:

    - from a third of the nominal to three times it, of a mass or an inertia from a tenth to ten times;
    - as far from 0 as the key's ``zero_width`` where it is 0;
    - a motor's friction from nothing up, as a file may state a guess, or a gear's friction for a whole joint's;
    - damping of a spring from nothing to LOSSES times the nominal, or up to its physical range where that is 0;
    - a lumped inertia may be negative, and a prismatic joint's length is 0.

    Args:
        robot: The robot description.

    Returns:
        Gravity, then joint after joint the link's and the drive's parameters in the order of `LINK_KEYS` and
        `DRIVE_KEYS`. A link in space has ten: mass, and the entries of `SPACE_ENTRIES`.

    """
    gravity = keys_of("")["gravity"]
    values = [
        _make_parameter(f"gravity_{axis}", gravity, "revolute", v, 0)
        for axis, v in zip(AXES, robot.gravity, strict=False)
    ]
    for number, joint in enumerate(robot.joints, 1):
        if isinstance(joint.link, SpatialLink):
            values += _space_parameters(joint, joint.link, number)
        else:
            known = {**vars(joint.link), "mass": joint.mass}
            stated = _stated_parameters("joint", LINK_KEYS, known, joint.kind, number)
            values += [_lump_inertia(joint.link, joint.mass, one) for one in stated]
        values += _stated_parameters("joint.drive", DRIVE_KEYS, vars(joint.drive), joint.kind, number)
    return tuple(values)


def _lump_inertia(link: PlanarLink, mass: Value, stated: ParameterValue) -> ParameterValue:
    """A parameter of a link; of its inertia, where the file lumps it, with the bounds of the one about the joint."""
    if not link.is_lumped or stated.name != f"inertia_{stated.joint}":
        return stated
    offset = mass.nominal * link.center_of_mass.nominal**2
    lumped = stated.nominal + offset
    low, high = lumped / LARGEST_INERTIAL_FACTOR - offset, lumped * LARGEST_INERTIAL_FACTOR - offset
    return replace(stated, low=low, high=high, offset=offset)


def _stated_parameters(
    table: str, names: tuple[str, ...], values: Mapping[str, Value | None], kind: str, number: int
) -> list[ParameterValue]:
    stated = ((keys_of(table)[name], values[name]) for name in names)
    return [_make_parameter(f"{key.name}_{number}", key, kind, v, number) for key, v in stated if v is not None]


def _space_parameters(joint: Joint, link: SpatialLink, number: int) -> list[ParameterValue]:
    """Mass, centre of mass and inertia of a link in space, whose entries may be of either sign or 0."""
    keys = keys_of("joint in space")
    found = [_make_parameter(f"mass_{number}", keys["mass"], joint.kind, joint.mass, number)]
    largest = max(value.nominal for value in link.inertia)
    for name, entries in SPACE_ENTRIES.items():
        key, values = keys[name], getattr(link, name)
        for entry, value in zip(entries, values, strict=True):
            if name == "inertia" and entry[0] == entry[1]:
                low, high = value.nominal / 3, value.nominal * 3
            else:
                width = max(2 * abs(value.nominal), largest if name == "inertia" else key.zero_width)
                low, high = value.nominal - width, value.nominal + width
            meaning = f"{key.meaning.partition(':')[0]}, {entry}"
            size = _measure_reference_size(name, entry, values)
            own = (key.unit, value.nominal, low, high, value.tolerance, size, meaning, number)
            found.append(ParameterValue(f"{name}_{entry}_{number}", *own))
    return found


def _measure_reference_size(name: str, entry: str, values: Sequence[Value]) -> float:
    """Measure what the tolerance of an entry is a share of: of a centre of mass its distance from the joint's frame, of
    a product of inertia the geometric mean of its two moments, so that an entry of 0 is known no better than others."""
    stated = dict(zip(SPACE_ENTRIES[name], (abs(value.nominal) for value in values), strict=True))
    if name == "center_of_mass":
        return math.hypot(*stated.values())
    return math.sqrt(stated[entry[0] * 2] * stated[entry[1] * 2])


def _make_parameter(name: str, key: Key, kind: str, value: Value, joint: int) -> ParameterValue:
    low, high = _parameter_bounds(key, kind, value.nominal)
    own = (value.nominal, low, high, value.tolerance, abs(value.nominal))
    return ParameterValue(name, unit_at(key, kind), *own, key.meaning, joint)


def _parameter_bounds(key: Key, kind: str, nominal: float) -> tuple[float, float]:
    if key.name == "length" and kind == "prismatic":
        return 0.0, 0.0
    if key.name == "torsional_damping" and nominal:
        return 0.0, min(LARGEST_DAMPING_FACTOR * nominal, key.range.high)
    if key.name in DISSIPATION_KEYS:
        return 0.0, key.range.high
    least = key.range.low
    if key.name == "inertia" and nominal < 0:
        least = -key.range.high
    low, high = -key.zero_width, key.zero_width
    factor = LARGEST_FACTOR
    if key.name in INERTIAL_KEYS:
        factor = LARGEST_INERTIAL_FACTOR
    if nominal:
        low, high = sorted((nominal / factor, nominal * factor))
    return max(low, least), min(high, key.range.high)
