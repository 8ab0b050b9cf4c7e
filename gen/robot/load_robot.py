"""Reads a robot.toml or a preset, checks it as a whole, and fills in the values that it leaves open.

All problems of a file are reported at once, one sentence each: file, key, the value found, the values possible, and the
cure.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gen.effects.effect import Effect
from gen.presets import find_presets
from gen.robot import consistency_checks, space_checks
from gen.robot.description import (
    Drive,
    Joint,
    Limits,
    PlanarLink,
    Robot,
    RobotError,
    Sensor,
    SpatialLink,
    StatedEffect,
    Tip,
    Value,
    describe_robot,
)
from gen.robot.gear_catalogue import CATALOGUE, DATA_SHEET_KEYS, SPRING_KEYS, Gear, drive_laws
from gen.robot.mass_matrix import find_singular_pose
from gen.robot.model_parameters import ParameterValue, list_parameters
from gen.robot.robot_text import parse_robot, read_robot
from gen.robot.schema import LAW_SHARPNESS
from gen.robot.smoothing_width import USUAL_WIDTH, widen_open_smoothing
from gen.robot.table_reader import RobotFileReader
from gen.robot.value_reader import show_value

__all__ = [
    "Drive",
    "Joint",
    "Limits",
    "ParameterValue",
    "Robot",
    "RobotError",
    "Sensor",
    "StatedEffect",
    "Value",
    "describe_robot",
    "from_table",
    "list_parameters",
    "load",
]


def load(source: str | Path, effects: tuple[Effect, ...] | None = None) -> Robot:
    """Read a robot.toml or a preset.

    Args:
        source: A preset's name or the path of a robot.toml.
        effects: The effects that [[effect]] may name; None: all of `gen.effects`.

    Returns:
        The robot, complete and checked.

    Raises:
        RobotError: The file cannot be used; it holds a sentence for each problem.

    """
    file, label = find_presets().get(str(source), Path(source)), label_source(source)
    return from_table(parse_robot(read_robot(file, label), label), label, file, effects)


def label_source(source: str | Path) -> str:
    """Write a preset's name or a path so that a sentence can hold it.

    Args:
        source: The name or the path.

    Returns:
        One line of text.

    """
    name = str(source)
    if name.isprintable() and len(name) <= 200:
        return name
    return show_value(name)


def from_table(table: Mapping[str, Any], label: str, source: Path, effects: tuple[Effect, ...] | None = None) -> Robot:
    """Check the tables of a robot.toml, and fill in the values that they leave open.

    Args:
        table: The parsed file.
        label: The file's name in errors.
        source: Where the file lies.
        effects: The effects that [[effect]] may name; None: all of `gen.effects`.

    Returns:
        The robot, complete and checked.

    Raises:
        RobotError: The file cannot be used; it holds a sentence for each problem.

    """
    reading = RobotFileReader(label)
    top = consistency_checks.check_top(table, reading)
    stated = consistency_checks.check_joints(table, reading)
    present = consistency_checks.check_effects(table, stated, top.get("gravity", ()), effects, reading)
    tip = None
    if space_checks.uses_long_form(table):
        tip = space_checks.read_tip(table, reading)
    if reading.problems:
        raise RobotError(reading.problems)
    joints = tuple(_make_joint(values, reading.tolerance) for values in stated)
    flaw = find_singular_pose(joints)
    if flaw:
        where = ", ".join(f"{position:.3g}" for position in flaw[0])
        found = f"found a mass matrix that is not positive definite at the joint positions [{where}]"
        scaled = f"scaled to a unit diagonal its smallest eigenvalue is {flaw[1]:.2g}, possible is above 0"
        raise RobotError([f"{label}, joint: {found} ({scaled}); give the links more mass or inertia."])
    is_open = [values["drive"].get("friction_smoothing") is None for values in stated]
    joints = widen_open_smoothing(joints, is_open, top["step"])
    name = top["name"]
    return Robot(
        name,
        consistency_checks.make_slug(name),
        top["gravity"],
        top["tolerance"],
        top["step"],
        top["force_noise"],
        joints,
        tuple(present),
        source,
        None if tip is None else Tip(**tip),
    )


# -- the description, with the values that the file leaves open -------------------------------------------------------


def _make_joint(values: dict[str, dict[str, Any]], tolerance: float) -> Joint:
    own, drive = values["joint"], values["drive"]
    gear = CATALOGUE.get(drive.get("catalogue", ""))
    limits = {name: values["limits"].get(name) for name in ("position", "speed", "torque", "motor_torque_rate")}
    if gear and limits["torque"] is None:
        limits["torque"] = gear.repeated_peak_torque
    return Joint(
        kind=own["type"],
        mass=own["mass"],
        link=_make_link(own),
        drive=_make_drive(drive, tolerance),
        limits=Limits(**limits),
        sensor=Sensor(**values["sensor"]),
        name=own.get("name", ""),
    )


def _make_link(own: dict[str, Any]) -> PlanarLink | SpatialLink:
    if "origin" in own:
        return SpatialLink(**{name: own[name] for name in SpatialLink.__dataclass_fields__})
    is_lumped = own.get("inertia") is None
    inertia = _inertia_about_center(own) if is_lumped else own["inertia"]
    return PlanarLink(own["length"], own["center_of_mass"], inertia, is_lumped)


def _inertia_about_center(own: dict[str, Any]) -> Value:
    """Inertia about the centre of mass from the one about the joint, whose standard deviation it keeps."""
    about_joint = own["inertia_about_joint"]
    inertia = about_joint.nominal - own["mass"].nominal * own["center_of_mass"].nominal ** 2
    if not inertia:
        return Value(inertia, about_joint.tolerance)
    return Value(inertia, about_joint.tolerance * abs(about_joint.nominal / inertia))


def _gear_of_data_sheet(stated: dict[str, Any]) -> Gear | None:
    """The gear whose data sheet stands in a drive, None where none does."""
    if DATA_SHEET_KEYS[0] not in stated:
        return None
    starting = stated.get("starting_torque", stated["coulomb_friction"].nominal)
    numbers = {name: stated[name] for name in DATA_SHEET_KEYS}
    loss = stated["hysteresis_loss"]
    return Gear(stated["ratio"].nominal, **numbers, hysteresis_loss=loss, starting_torque=starting, source="robot.toml")


def _make_drive(stated: dict[str, Any], tolerance: float) -> Drive:
    gear = CATALOGUE.get(stated.get("catalogue", "")) or _gear_of_data_sheet(stated)
    values: dict[str, Any] = {name: stated.get(name) for name in Drive.__dataclass_fields__}
    values["compliant"] = False
    if gear:
        values |= {name: Value(number, tolerance) for name, number in zip(SPRING_KEYS, drive_laws(gear), strict=True)}
        values["ratio"] = values["ratio"] or Value(gear.ratio, 0.0)
        if values["hysteresis_loss"] is None:
            values["hysteresis_loss"] = gear.hysteresis_loss
    if values["rigid"]:
        values["torsional_damping"] = None
    elif values["law_torque"] is None:
        law_torque = LAW_SHARPNESS / values["flexspline_stiffening"].nominal
        if gear and gear.momentary_peak_torque:
            law_torque = gear.momentary_peak_torque
        values["law_torque"] = Value(law_torque, 0.0)
    if values["friction_smoothing"] is None:
        values["friction_smoothing"] = Value(USUAL_WIDTH * values["ratio"].nominal, 0.0)
    return Drive(**values)
