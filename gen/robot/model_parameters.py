"""The parameters of the model that a robot description gives, by name, with unit and bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gen.robot.description import Drive, Joint, Robot, Value
from gen.robot.schema import Key, keys_of, unit_at

LINK_KEYS = ("length", "mass", "center_of_mass", "inertia")
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
    """A parameter of the model; ``joint`` 0 is the whole arm. low ≤ nominal ≤ high. With ``offset`` it is the number
    that the file states: of a lumped inertia mass·center_of_mass²."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    tolerance: float
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
        `DRIVE_KEYS`.

    """
    gravity = keys_of("")["gravity"]
    values = [
        _make_parameter(f"gravity_{axis}", gravity, "revolute", v, 0)
        for axis, v in zip("xy", robot.gravity, strict=True)
    ]
    for number, joint in enumerate(robot.joints, 1):
        for table, names, part in (("joint", LINK_KEYS, joint), ("joint.drive", DRIVE_KEYS, joint.drive)):
            values += _stated_parameters(table, names, part, joint.kind, number)
        if joint.is_lumped:
            values = [_lump_inertia(joint, one) if one.name == f"inertia_{number}" else one for one in values]
    return tuple(values)


def _lump_inertia(joint: Joint, inertia: ParameterValue) -> ParameterValue:
    """The inertia about the centre of mass, with the bounds of the one about the joint, which the file states."""
    offset = joint.mass.nominal * joint.center_of_mass.nominal**2
    stated = inertia.nominal + offset
    low, high = stated / LARGEST_INERTIAL_FACTOR - offset, stated * LARGEST_INERTIAL_FACTOR - offset
    return replace(inertia, low=low, high=high, offset=offset)


def _stated_parameters(
    table: str, names: tuple[str, ...], part: Joint | Drive, kind: str, number: int
) -> list[ParameterValue]:
    stated = ((keys_of(table)[name], getattr(part, name)) for name in names)
    return [_make_parameter(f"{key.name}_{number}", key, kind, v, number) for key, v in stated if v is not None]


def _make_parameter(name: str, key: Key, kind: str, value: Value, joint: int) -> ParameterValue:
    low, high = _parameter_bounds(key, kind, value.nominal)
    return ParameterValue(name, unit_at(key, kind), value.nominal, low, high, value.tolerance, key.meaning, joint)


def _parameter_bounds(key: Key, kind: str, nominal: float) -> tuple[float, float]:
    if key.name == "length" and kind == "prismatic":
        return 0.0, 0.0
    if key.name == "torsional_damping" and nominal:
        return 0.0, min(LARGEST_DAMPING_FACTOR * nominal, key.range.high)
    if key.name in DISSIPATION_KEYS:
        return 0.0, key.range.high
    least = key.range.low
    if key.name == "inertia" and nominal < 0:  # lumped
        least = -key.range.high
    low, high = -key.zero_width, key.zero_width
    factor = LARGEST_FACTOR
    if key.name in INERTIAL_KEYS:
        factor = LARGEST_INERTIAL_FACTOR
    if nominal:
        low, high = sorted((nominal / factor, nominal * factor))
    return max(low, least), min(high, key.range.high)
