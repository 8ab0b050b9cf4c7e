"""Checks the keys of robot.toml against each other: the values that the file states, or the problems with them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from keyword import iskeyword
from typing import Any

from gen.effects.effect import Effect, Port
from gen.robot import space_checks
from gen.robot.description import StatedEffect, Value
from gen.robot.gear_catalogue import CATALOGUE, DATA_SHEET_KEYS, largest_stiffness_ratio
from gen.robot.schema import MAX_JOINTS, SUBTABLES, Key, KeyNeed, Range, ValueKind, keys_of
from gen.robot.table_reader import RobotFileReader, key_path
from gen.robot.value_reader import show_value

Values = dict[str, Any]
LEAST_ROTOR_INERTIA = 1e-12  # kg m², of a body of its own
NAME_PATTERN = re.compile(r"[A-Za-z][A-Za-z0-9 _.,()+-]{0,79}")
C_WORDS = frozenset(
    [
        "asm",
        "auto",
        "bool",
        "break",
        "case",
        "char",
        "const",
        "continue",
        "default",
        "do",
        "double",
        "else",
        "enum",
        "extern",
        "float",
        "for",
        "goto",
        "if",
        "inline",
        "int",
        "long",
        "main",
        "register",
        "restrict",
        "return",
        "short",
        "signed",
        "sizeof",
        "static",
        "struct",
        "switch",
        "typedef",
        "union",
        "unsigned",
        "void",
        "volatile",
        "while",
    ]
)


def make_slug(name: str) -> str:
    """Write a robot's name so that a path and a symbol can hold it.

    Args:
        name: The name.

    Returns:
        Text that matches ^[a-z][a-z0-9_]{0,47}$.

    """
    return re.sub(r"[^a-z0-9]+", "_", name.lower())[:48].rstrip("_")


def check_top(table: Mapping[str, Any], reading: RobotFileReader) -> Values:
    """Check the keys above the first [[joint]]; from here on plain numbers have the file's tolerance.

    Args:
        table: The parsed file.
        reading: Collects the problems.

    Returns:
        The values by key.

    """
    values: Values = {}
    if "tolerance" in table:
        # a problem with it is reported by `table` below
        RobotFileReader("").read_value(keys_of("")["tolerance"], table["tolerance"], "", values)
        reading.tolerance = values.get("tolerance", reading.tolerance)
    values = reading.read_table(table, "", "")
    name = values.get("name")
    if name is not None and not NAME_PATTERN.fullmatch(name):
        possible = "a letter, then letters, digits, spaces and _.,()+- up to 80 characters"
        reading.add_problem("name", f"found {show_value(name)}, possible is {possible}; choose such a label")
    elif name is not None and (make_slug(name) in C_WORDS or iskeyword(make_slug(name))):
        reading.add_problem(
            "name", f"found {show_value(name)}, possible is anything but a word of C or Python; add a word to it"
        )
    space_checks.check_gravity(values, space_checks.uses_long_form(table), reading)
    return values


def check_joints(table: Mapping[str, Any], reading: RobotFileReader) -> list[dict[str, Values]]:
    """Check every [[joint]].

    Args:
        table: The parsed file.
        reading: Collects the problems.

    Returns:
        The values of each joint, base first: its own keys under "joint", and "drive", "limits", "sensor".
        In the long form the own keys are those of "joint in space".

    """
    raw = table.get("joint", [])
    if not isinstance(raw, list):
        reading.add_problem(
            "joint", f"found {show_value(raw)}, possible are tables; write [[joint]] in two brackets for each joint"
        )
        return []
    if not 1 <= len(raw) <= MAX_JOINTS:
        reading.add_problem(
            "joint", f"found {len(raw)} joints, possible are 1 to {MAX_JOINTS}; write one [[joint]] for each"
        )
    in_space = space_checks.uses_long_form(table)
    joints = [
        _check_joint(one, f"joint[{number}]", in_space, reading) for number, one in enumerate(raw[:MAX_JOINTS], 1)
    ]
    space_checks.check_joint_names(joints, reading)
    return joints


def _check_joint(raw: Any, place: str, in_space: bool, reading: RobotFileReader) -> dict[str, Values]:
    if not isinstance(raw, Mapping):
        return {"joint": reading.read_table(raw, "joint", place)} | {name: {} for name in SUBTABLES["joint"]}
    if in_space:
        values = {"joint": space_checks.read_joint_in_space(raw, place, reading)}
    else:
        values = {"joint": reading.read_table(raw, "joint", place)}
        _check_link(raw, values["joint"], place, reading)
    for name in ("limits", "sensor"):
        values[name] = reading.read_table(raw.get(name, {}), f"joint.{name}", f"{place}.{name}")
    if "drive" not in raw:
        reading.add_problem(
            f"{place}.drive", "found nothing, required is a drive; write [joint.drive] and its keys below [[joint]]"
        )
        return values | {"drive": {}}
    values["drive"] = reading.read_table(raw["drive"], "joint.drive", f"{place}.drive")
    if isinstance(raw["drive"], Mapping):
        _check_needs(raw["drive"], values["drive"], f"{place}.drive", reading)
        _check_drive(values["drive"], f"{place}.drive", reading)
    return values


def _check_link(raw: Mapping[str, Any], values: Values, place: str, reading: RobotFileReader) -> None:
    """Check length and inertia against the joint's kind."""
    prismatic = values.get("type") == "prismatic"
    if prismatic and "length" in values and values["length"].nominal != 0:
        found = f"found {values['length'].nominal:g}"
        reading.add_problem(
            key_path(place, "length"), f"{found}, possible is 0 at a prismatic joint; remove it or use a further joint"
        )
    if not prismatic and "length" not in raw:
        reading.add_missing(keys_of("joint")["length"], place)
    lumped = "inertia_about_joint" in raw
    if lumped and "inertia" in raw:
        reading.add_problem(
            key_path(place, "inertia_about_joint"), "found beside inertia, possible is one of the two; remove one"
        )
    elif lumped and prismatic:
        possible = "possible is inertia, as a prismatic joint has no axis"
        reading.add_problem(
            key_path(place, "inertia_about_joint"), f"found at a prismatic joint, {possible}; write inertia"
        )
    elif not lumped and "inertia" not in raw:
        reading.add_missing(keys_of("joint")["inertia"], place)


def _check_needs(raw: Mapping[str, Any], values: Values, place: str, reading: RobotFileReader) -> None:
    """Check the drive's keys against `KeyNeed`; where ``rigid`` itself is wrong, problems that follow are left out."""
    rigid, geared = values.get("rigid"), "catalogue" in raw
    sheet = any(name in raw for name in DATA_SHEET_KEYS)
    springs = (KeyNeed.SPRING_KEY, KeyNeed.FLEXIBLE, KeyNeed.DATA_SHEET, KeyNeed.DATA_SHEET_ONLY)
    for name, key in keys_of("joint.drive").items():
        given = name in raw
        if rigid is None or key.need in (KeyNeed.YES, KeyNeed.NO):
            continue
        if rigid and given and key.need in springs:
            reading.add_problem(
                key_path(place, name),
                "found with rigid = true, possible only in a drive with springs; remove it or rigid = true",
            )
        elif geared and given and key.need in (KeyNeed.SPRING_KEY, KeyNeed.DATA_SHEET, KeyNeed.DATA_SHEET_ONLY):
            reading.add_problem(key_path(place, name), "found beside catalogue, possible is one of the two; remove one")
        elif sheet and given and key.need is KeyNeed.SPRING_KEY:
            reading.add_problem(
                key_path(place, name), "found beside K1 to T2 of a data sheet, possible is either; remove one"
            )
        elif given and key.need is KeyNeed.DATA_SHEET_ONLY and not sheet:
            reading.add_problem(
                key_path(place, name), "found without K1 to T2 of a data sheet, possible is beside them; remove it"
            )
        elif not given and not geared and _is_required(key, rigid, sheet):
            reading.add_missing(key, place)


def _is_required(key: Key, rigid: bool, sheet: bool) -> bool:
    """Whether a drive without catalogue must have a key; its springs come from a data ``sheet`` or from keys."""
    if rigid or key.need is KeyNeed.GEARED:
        return key.need is KeyNeed.GEARED
    if sheet:
        return key.need is KeyNeed.DATA_SHEET or key.name == "hysteresis_loss"
    return key.need is KeyNeed.SPRING_KEY


def _check_data_sheet(values: Values, place: str, reading: RobotFileReader) -> None:
    """Whether the numbers of a data sheet give springs."""
    T1, T2, K1, K2, K3 = (values[name] for name in DATA_SHEET_KEYS)
    if not T1 < T2:
        reading.add_problem(key_path(place, "T2"), f"found {T2:g}, possible is above T1 = {T1:g}; correct them")
    elif not K1 <= K2 <= K3:
        found = f"found K1 = {K1:g}, K2 = {K2:g} and K3 = {K3:g}"
        reading.add_problem(key_path(place, "K1"), f"{found}, possible are stiffnesses that do not fall; correct them")
    elif values["hysteresis_loss"] <= 0:
        reading.add_problem(
            key_path(place, "hysteresis_loss"), "found 0, possible beside K1 to T2 is above 0; correct it"
        )
    elif values.get("starting_torque", values["coulomb_friction"].nominal) <= 0:
        reading.add_problem(
            key_path(place, "starting_torque"), "found no friction to start against; write that of the data sheet"
        )
    elif (most := largest_stiffness_ratio(T1, T2) * K1) <= K2:
        possible = f"possible is below {most:.6g} with these K1, T1 and T2, so that the law starts above 0"
        reading.add_problem(key_path(place, "K2"), f"found {K2:g}, {possible}; correct them")


def _check_drive(values: Values, place: str, reading: RobotFileReader) -> None:
    """Check the drive's values against each other; those of a rigid drive do not depend on each other."""
    if values.get("rigid") is not False:
        return
    if {*DATA_SHEET_KEYS, "hysteresis_loss", "coulomb_friction"} <= values.keys():
        _check_data_sheet(values, place, reading)
    gear = CATALOGUE.get(values.get("catalogue", ""))
    if gear and "ratio" in values and values["ratio"].nominal != gear.ratio:
        found = f"found {values['ratio'].nominal:g} beside catalogue = {show_value(values['catalogue'])}"
        reading.add_problem(key_path(place, "ratio"), f"{found}, possible is {gear.ratio:g}; correct or remove one")
    rotor = values.get("motor_inertia")
    if rotor and rotor.nominal < LEAST_ROTOR_INERTIA:
        possible = f"possible is {LEAST_ROTOR_INERTIA:g} kg m² or more in a drive with springs"
        reading.add_problem(
            key_path(place, "motor_inertia"), f"found {rotor.nominal:g}, {possible}; correct it or write rigid = true"
        )


# -- effects ----------------------------------------------------------------------------------------------------------


def check_effects(
    table: Mapping[str, Any],
    joints: list[dict[str, Values]],
    gravity: Sequence[Value],
    known: tuple[Effect, ...] | None,
    reading: RobotFileReader,
) -> list[StatedEffect]:
    """Check every [[effect]].

    Args:
        table: The parsed file.
        joints: The values of each joint (`joints`).
        gravity: Its components.
        known: The effects possible; None for all of `gen.effects`.
        reading: Collects the problems.

    Returns:
        The effects stated.

    """
    raw = table.get("effect", [])
    if not isinstance(raw, list):
        reading.add_problem(
            "effect", f"found {show_value(raw)}, possible are tables; write [[effect]] in two brackets for each one"
        )
        return []
    if raw and known is None:
        from gen.effects import ALL  # here, for it brings casadi

        known = ALL
    in_space = space_checks.uses_long_form(table)
    by_name = {effect.name: effect.choose_form(in_space) for effect in known or ()}
    found = [_check_effect(one, f"effect[{number}]", joints, by_name, reading) for number, one in enumerate(raw, 1)]
    first: dict[tuple[str, int], int] = {}
    for number, stated in enumerate(found, 1):
        if stated and first.setdefault((stated.name, stated.joint), number) != number:
            twice = f"found {stated.name} at joint {stated.joint} again, possible is once"
            reading.add_problem(
                f"effect[{number}]", f"{twice}; remove it or effect[{first[stated.name, stated.joint]}]"
            )
        if stated and by_name[stated.name].needs_gravity and not any(part.nominal for part in gravity):
            reading.add_problem(
                f"effect[{number}]", f"found {stated.name} without gravity, which it turns; remove it or state gravity"
            )
    return [stated for stated in found if stated]


def _check_effect(
    raw: Any, place: str, joints: list[dict[str, Values]], known: Mapping[str, Effect], reading: RobotFileReader
) -> StatedEffect | None:
    if not isinstance(raw, Mapping):
        reading.add_problem(place, f"found {show_value(raw)}, possible is a table; write [[effect]] and its keys below")
        return None
    values = reading.read_table({name: raw[name] for name in ("name", "joint") if name in raw}, "effect", place)
    effect = known.get(values.get("name", ""))
    if effect is None:
        if "name" in values:
            hint = reading.suggest(values["name"], known)
            possible = f"possible are {', '.join(known) or 'none'}"
            reading.add_problem(
                key_path(place, "name"), f"found {show_value(values['name'])}, {possible}; choose one of them{hint}"
            )
        return None
    if "joint" in values:
        _check_effect_joint(effect, values["joint"], place, joints, reading)
    at: Values = {}
    if 0 < values.get("joint", 0) <= len(joints):
        at = joints[values["joint"] - 1]["drive"]
    named = {
        p.name: Key(
            "effect", p.name, ValueKind.PARAMETER, KeyNeed.NO, p.unit, Range(p.low, p.high), p.meaning, p.nominal
        )
        for p in effect.parameters
        if p.unless not in at
    }
    scaled = {p.name for p in effect.parameters if p.scale and p.starts}  # whose nominal value is the joint's
    parameters: dict[str, Value] = {}
    for name, key in named.items():
        if name in raw or name not in scaled:
            reading.read_value(key, raw.get(name, key.default), place, parameters)
    for name in raw:
        if name not in named and name not in ("name", "joint"):
            reading.add_unknown(name, place, ("name", "joint", *named))
    if "joint" not in values:
        return None
    return StatedEffect(effect.name, values["joint"], parameters)


def _check_effect_joint(
    effect: Effect, joint: int, place: str, joints: list[dict[str, Values]], reading: RobotFileReader
) -> None:
    n = len(joints)
    fits = {"arm": range(1), "first": range(1, 2), "last": range(n, n + 1)}.get(effect.joints, range(1, n + 1))
    if joint not in fits:
        ends = sorted({*fits[:1], *fits[-1:]})
        possible = " to ".join(map(str, ends)) or "none"
        words = {"arm": " (the arm as a whole)", "first": " (the first joint)", "last": " (the last joint)"}
        which = words.get(effect.joints, "")
        reading.add_problem(
            key_path(place, "joint"), f"found {joint}, possible for {effect.name} is {possible}{which}; correct it"
        )
    elif joint:
        _check_effect_drive(effect, joint, joints[joint - 1], key_path(place, "joint"), reading)


def _check_effect_drive(
    effect: Effect, joint: int, values: dict[str, Values], place: str, reading: RobotFileReader
) -> None:
    """Whether the effect has a meaning at a joint of that kind with that drive."""
    drive, series = values["drive"], effect.port is Port.SERIES
    rotor = drive.get("motor_inertia")
    if not effect.suits_prismatic_joint and values["joint"].get("type") == "prismatic":
        has = f"found {joint}, which is prismatic, possible for {effect.name} is a revolute joint"
        reading.add_problem(place, f"{has}; remove the effect")
    elif series and not drive.get("rigid"):
        has = f"found {joint}, whose drive has springs, possible for {effect.name} is a joint with rigid = true"
        reading.add_problem(place, f"{has}; remove the effect")
    elif series and rotor is not None and rotor.nominal < LEAST_ROTOR_INERTIA:
        has = f"found {joint}, whose motor_inertia is {rotor.nominal:g}, possible for {effect.name} is a joint with"
        reading.add_problem(place, f"{has} {LEAST_ROTOR_INERTIA:g} kg m² or more; state the rotor's own inertia")
    elif not effect.suits_rigid_drive and drive.get("rigid"):
        has = f"found {joint}, whose drive is rigid, possible for {effect.name} is a joint whose drive has springs"
        reading.add_problem(place, f"{has}; remove the effect or rigid = true")
