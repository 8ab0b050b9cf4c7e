"""The keys of robot.toml in one table, from which the checks (`gen.robot.value_reader`, `gen.robot.load_robot`) and
docs/reference/robot_toml.md are made.

`python -m gen.robot.schema_document` prints docs/reference/robot_toml.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

from gen.robot.gear_catalogue import CATALOGUE

MAX_JOINTS = 12
SUBTABLES = {
    "": ("joint", "effect", "tip"),
    "joint": ("drive", "limits", "sensor"),
    "joint in space": ("drive", "limits", "sensor"),
}
TITLES = {
    "": "top of the file",
    "joint": "[[joint]]",
    "joint in space": "[[joint]] in space",
    "tip": "[tip]",
    "joint.drive": "[joint.drive]",
    "joint.limits": "[joint.limits]",
    "joint.sensor": "[joint.sensor]",
    "effect": "[[effect]]",
}


class ValueKind(Enum):
    """How a value is written."""

    PARAMETER = "number, {value, tolerance} or {value, source}"
    PARAMETERS = "list of: number, {value, tolerance} or {value, source}"
    VECTOR = "list of numbers"
    NUMBER = "number"
    RANGE = "[low, high]"
    WHOLE = "whole number"
    TEXT = "text"
    FLAG = "true or false"


class KeyNeed(Enum):
    """When a key must or must not be there."""

    YES = "yes"
    NO = "no"
    REVOLUTE = "yes; at a prismatic joint no, it is 0"
    EITHER = "one of inertia and inertia_about_joint"
    GEARED = "yes, unless catalogue is given"
    SPRING_KEY = "yes; refused with catalogue, with a data sheet and with rigid = true"
    DATA_SHEET = "of a data sheet, with hysteresis_loss; refused with catalogue and with rigid = true"
    DATA_SHEET_ONLY = "no; of a data sheet alone"
    FLEXIBLE = "no; refused with rigid = true"


@dataclass(frozen=True)
class Range:
    """Physical range of a number; ``above``: low itself is outside."""

    low: float = -math.inf
    high: float = math.inf
    excludes_low: bool = False

    def __contains__(self, number: float) -> bool:
        return self.low <= number <= self.high and not (self.excludes_low and number == self.low)


@dataclass(frozen=True)
class Key:
    """One key: its table, how it is written, when it is needed, unit, range, meaning and default."""

    table: str
    name: str
    kind: ValueKind
    need: KeyNeed
    unit: str
    range: Range
    meaning: str
    default: Any = None
    default_text: str = ""  # the default in words, where it is worked out
    exact: bool = False  # a parameter with tolerance 0 unless the file states one
    zero_width: float = 0.0  # of a parameter whose nominal is 0: how far its bounds lie from 0
    prismatic_unit: str = ""  # the unit at a prismatic joint, where it differs
    choices: tuple[str, ...] = ()
    lengths: tuple[int, ...] = ()  # possible numbers of entries of a list
    advice: str = ""  # advice where no choice fits; then none of them is suggested


def range_above(low: float, high: float) -> Range:
    """A range without its low end."""
    return Range(low, high, excludes_low=True)


ANY = Range()
YES, NO, EITHER, SPRING, FLEXIBLE = KeyNeed.YES, KeyNeed.NO, KeyNeed.EITHER, KeyNeed.SPRING_KEY, KeyNeed.FLEXIBLE
SHEET = KeyNeed.DATA_SHEET
PARAMETER, NUMBER, TEXT = ValueKind.PARAMETER, ValueKind.NUMBER, ValueKind.TEXT
PARAMETERS, VECTOR = ValueKind.PARAMETERS, ValueKind.VECTOR
DRIVE, LIMITS, SENSOR, SPACE = "joint.drive", "joint.limits", "joint.sensor", "joint in space"
JOINT_NAME = "label of the joint: letters, digits and `_.-`, the first a letter; 64 characters at most"
GEAR = "the catalogue's"
LENGTH_WORDS = {2: "two", 3: "three", 4: "four", 6: "six"}
LAW_SHARPNESS = 12.0  # c_f · law_torque where nothing else is stated

# One row a key.
# fmt: off
TABLE: tuple[Key, ...] = (
    Key("", "name", TEXT, YES, "", ANY,
        "label: a letter, then letters, digits, spaces and `_.,()+-`; 80 characters at most, no word of C or Python"),
    Key("", "gravity", PARAMETERS, YES, "m/s²", Range(-100, 100),
        "gravity in the plane of motion; base frame: x right, y up, q = 0 along x; of joints in space three components",
        exact=True, zero_width=10.0, lengths=(2, 3)),
    Key("", "tolerance", NUMBER, NO, "1", Range(0, 10), "relative standard deviation of the parameters", 0.05),
    Key("", "step", NUMBER, NO, "s", Range(1e-7, 0.1), "integration step the model is meant for", 0.0005),
    Key("", "force_noise", NUMBER, NO, "N", Range(0, 1e5),
        "standard deviation of the force sensor at the tip, by axis", 0.2),

    Key("joint", "name", TEXT, NO, "", ANY, JOINT_NAME, default_text="none"),
    Key("joint", "type", TEXT, NO, "", ANY,
        "a prismatic joint slides along its own x", "revolute", choices=("revolute", "prismatic")),
    Key("joint", "length", PARAMETER, KeyNeed.REVOLUTE, "m", Range(0, 10),
        "distance to the next joint or the tip", 0.0, exact=True, zero_width=0.1),
    Key("joint", "mass", PARAMETER, YES, "kg", Range(0, 1e4), "mass of the link", zero_width=1.0),
    Key("joint", "center_of_mass", PARAMETER, YES, "m", Range(-10, 10),
        "centre of mass of the link, from the joint's axis along the link; negative behind the axis", zero_width=0.1),
    Key("joint", "inertia", PARAMETER, EITHER, "kg m²", Range(0, 1e4),
        "inertia of the link about its centre of mass", zero_width=0.1),
    Key("joint", "inertia_about_joint", PARAMETER, EITHER, "kg m²", Range(0, 1e4),
        "inertia of the link about its joint's axis, lumped: inertia, which is this less mass·center_of_mass², may "
        "then be negative and only the whole mass matrix must be positive definite; not at a prismatic joint"),

    Key(SPACE, "name", TEXT, NO, "", ANY, JOINT_NAME, default_text="none"),
    Key(SPACE, "type", TEXT, NO, "", ANY, "a prismatic joint slides along its axis", "revolute",
        choices=("revolute", "prismatic")),
    Key(SPACE, "origin", VECTOR, YES, "m", Range(-100, 100),
        "the joint's frame in that of the joint before, or in the base frame", lengths=(3,)),
    Key(SPACE, "rotation", VECTOR, NO, "1", Range(-1.000001, 1.000001),
        "the same as a unit quaternion w, x, y, z", (1.0, 0.0, 0.0, 0.0), lengths=(4,)),
    Key(SPACE, "axis", VECTOR, NO, "1", Range(-1.000001, 1.000001),
        "unit vector in the joint's frame, about which it turns or along which it slides", (0.0, 0.0, 1.0),
        lengths=(3,)),
    Key(SPACE, "mass", PARAMETER, YES, "kg", range_above(0, 1e4), "mass of the link", zero_width=1.0),
    Key(SPACE, "center_of_mass", PARAMETERS, YES, "m", Range(-100, 100),
        "centre of mass of the link in the joint's frame", zero_width=0.1, lengths=(3,)),
    Key(SPACE, "inertia", PARAMETERS, YES, "kg m²", Range(-1e4, 1e4),
        "inertia of the link about its centre of mass in the joint's frame: xx, yy, zz, xy, xz, yz", zero_width=0.1,
        lengths=(6,)),

    Key("tip", "origin", VECTOR, NO, "m", Range(-100, 100), "the tip in the last joint's frame", (0.0, 0.0, 0.0),
        lengths=(3,)),
    Key("tip", "rotation", VECTOR, NO, "1", Range(-1.000001, 1.000001), "the same as a unit quaternion w, x, y, z",
        (1.0, 0.0, 0.0, 0.0), lengths=(4,)),

    Key(DRIVE, "rigid", ValueKind.FLAG, NO, "", ANY, "no springs: motor angle = ratio · joint position", False),
    Key(DRIVE, "catalogue", TEXT, FLEXIBLE, "", ANY,
        "gear that gives ratio, the four spring values and hysteresis_loss", default_text="none",
        choices=tuple(CATALOGUE), advice="another gear has other springs, so leave catalogue out and write "
        "ratio, K1, K2, K3, T1, T2 and hysteresis_loss of its own data sheet"),
    Key(DRIVE, "ratio", PARAMETER, KeyNeed.GEARED, "1", Range(1e-3, 1e5),
        "motor angle over joint position; both counted positive alike", default_text=GEAR, exact=True,
        prismatic_unit="rad/m"),
    Key(DRIVE, "motor_inertia", PARAMETER, YES, "kg m²", Range(0, 10),
        "J_m: rotor and wave generator; from 1e-12 in a drive with springs", zero_width=1e-3),
    Key(DRIVE, "torque_constant", PARAMETER, NO, "N m/A", Range(1e-6, 100),
        "k_t; without it the input is motor torque", default_text="none"),
    Key(DRIVE, "max_current", NUMBER, NO, "A", range_above(0, 1e4),
        "largest current; counts where torque_constant is given", default_text="none"),
    Key(DRIVE, "viscous_friction", PARAMETER, YES, "N m s/rad", Range(0, 1e6),
        "viscous friction at the motor", zero_width=1.0),
    Key(DRIVE, "coulomb_friction", PARAMETER, YES, "N m", Range(0, 1e5),
        "level of Coulomb friction at the motor", zero_width=1.0),
    Key(DRIVE, "friction_smoothing", PARAMETER, NO, "rad/s", Range(1e-6, 1e4),
        "motor speed over which smooth friction changes its sign", exact=True,
        default_text="0.01 · ratio; where the step does not carry that, twice the width that it carries"),
    Key(DRIVE, "flexspline_stiffness", PARAMETER, SPRING, "N m/rad", Range(1e-3, 1e10),
        "K_f0, stiffness of the flexspline at zero torque", default_text=GEAR, prismatic_unit="N/m"),
    Key(DRIVE, "flexspline_stiffening", PARAMETER, SPRING, "1/(N m)", Range(1e-6, 100),
        "c_f, stiffening of the flexspline; 1e-6 is as good as linear", default_text=GEAR, prismatic_unit="1/N"),
    Key(DRIVE, "wave_generator_stiffness", PARAMETER, SPRING, "N m/rad", Range(1e-6, 1e10),
        "K_w0, stiffness of the wave generator at zero torque, at the motor", default_text=GEAR),
    Key(DRIVE, "wave_generator_stiffening", PARAMETER, SPRING, "1/(N m)", Range(1e-3, 1e5),
        "c_w, stiffening of the wave generator, at the motor", default_text=GEAR),
    Key(DRIVE, "K1", NUMBER, SHEET, "N m/rad", Range(1e-3, 1e10),
        "stiffness of the gear from no torque to T1, at the joint", prismatic_unit="N/m"),
    Key(DRIVE, "K2", NUMBER, SHEET, "N m/rad", Range(1e-3, 1e10),
        "the same from T1 to T2; with K1 it gives the flexspline's stiffness and stiffening", prismatic_unit="N/m"),
    Key(DRIVE, "K3", NUMBER, SHEET, "N m/rad", Range(1e-3, 1e10),
        "the same above T2, where the model follows a parabola through K1 and K2", prismatic_unit="N/m"),
    Key(DRIVE, "T1", NUMBER, SHEET, "N m", Range(1e-6, 1e8), "torque at which K1 ends", prismatic_unit="N"),
    Key(DRIVE, "T2", NUMBER, SHEET, "N m", Range(1e-6, 1e8), "torque at which K2 ends", prismatic_unit="N"),
    Key(DRIVE, "starting_torque", NUMBER, KeyNeed.DATA_SHEET_ONLY, "N m", Range(1e-5, 1e3),
        "τ_fs, at the wave generator; with hysteresis_loss it gives the wave generator's spring",
        default_text="coulomb_friction"),
    Key(DRIVE, "torsional_damping", PARAMETER, FLEXIBLE, "N m s/rad", Range(0, 1e7),
        "damping beside the springs, at the joint", 0.0, zero_width=10.0, prismatic_unit="N s/m"),
    Key(DRIVE, "law_torque", PARAMETER, FLEXIBLE, "N m", Range(1e-3, 1e8),
        "joint torque from which the spring law goes on along its tangent",
        default_text="the catalogue's momentary peak torque; where none is stated 12/c_f, at which tan() in the "
        "flexspline's law is 12", exact=True, prismatic_unit="N"),
    Key(DRIVE, "hysteresis_loss", NUMBER, FLEXIBLE, "rad", Range(0, 0.1),
        "ψ, width of the torque–torsion loop at the joint", default_text=f"{GEAR}, else unknown", prismatic_unit="m"),

    Key(LIMITS, "position", ValueKind.RANGE, NO, "rad", Range(-1e4, 1e4), "joint position",
        default_text="none", prismatic_unit="m"),
    Key(LIMITS, "speed", NUMBER, NO, "rad/s", range_above(0, 1e4), "joint speed", default_text="none",
        prismatic_unit="m/s"),
    Key(LIMITS, "torque", NUMBER, NO, "N m", range_above(0, 1e6),
        "joint torque (flexspline); without torque_constant the model is meant for inputs up to it, "
        "and where it is not stated for ten times dry friction or what lifts the stretched arm swiftly, rounded",
        default_text="the catalogue's repeated peak torque, else none", prismatic_unit="N"),
    Key(LIMITS, "motor_torque_rate", NUMBER, NO, "N m/s", range_above(0, 1e9), "change of motor torque",
        default_text="none"),

    Key(SENSOR, "motor_encoder_resolution", NUMBER, NO, "rad", Range(0, 10), "0 is exact", 0.0),
    Key(SENSOR, "joint_encoder_resolution", NUMBER, NO, "rad", Range(0, 10), "0 is exact", 0.0, prismatic_unit="m"),
    Key(SENSOR, "motor_encoder_noise", NUMBER, NO, "rad", Range(0, 10),
        "standard deviation of the angle before it is counted", 0.0),
    Key(SENSOR, "joint_encoder_noise", NUMBER, NO, "rad", Range(0, 10),
        "standard deviation of the position before it is counted", 0.0, prismatic_unit="m"),
    Key(SENSOR, "current_noise", NUMBER, NO, "A", Range(0, 1e3),
        "standard deviation (N m where the input is torque)", 0.0),
    Key(SENSOR, "torque_noise", NUMBER, NO, "N m", Range(0, 1e5), "standard deviation", 0.0, prismatic_unit="N"),

    Key("effect", "name", TEXT, YES, "", ANY, "an effect that is in the model; its own parameters are further keys"),
    Key("effect", "joint", ValueKind.WHOLE, YES, "", Range(0, MAX_JOINTS),
        "joint number from 1; 0 for the arm as a whole"),
)
# fmt: on


def keys_of(table: str) -> dict[str, Key]:
    """Find the keys of one table.

    Args:
        table: The table's name in `TABLE`.

    Returns:
        The keys by name, in the order of `TABLE`.

    """
    return {key.name: key for key in TABLE if key.table == table}


def unit_at(key: Key, kind: str) -> str:
    """Find the unit of a key at a joint.

    Args:
        key: The key.
        kind: The joint's kind: ``revolute`` or ``prismatic``.

    Returns:
        The unit.

    """
    if kind == "prismatic":
        return key.prismatic_unit or key.unit
    return key.unit


def describe_range(key: Key) -> str:
    """Write the range of a key in words, with its unit.

    Args:
        key: The key.

    Returns:
        The range; empty where the key has none.

    """
    if key.range == ANY:
        return ""
    words = [f"from {key.range.low:g} to {key.range.high:g}"]
    if key.range.excludes_low:
        words = [f"above {key.range.low:g}, up to {key.range.high:g}"]
    if key.unit not in ("", "1"):
        words.append(key.unit)
    if key.prismatic_unit:
        words.append(f"({key.prismatic_unit} at a prismatic joint)")
    return " ".join(words)


def describe_form(key: Key) -> str:
    """Write how a key's value is written.

    Args:
        key: The key.

    Returns:
        The kind in words, of a list with the number of its entries.

    """
    if key.lengths:
        return "list of " + " or ".join(LENGTH_WORDS[length] for length in key.lengths) + " numbers"
    return key.kind.value
