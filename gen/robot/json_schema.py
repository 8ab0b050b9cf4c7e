"""The JSON Schema (draft 2020-12) of robot.toml, made from the table of keys in `gen.robot.schema`.

`python -m gen.robot.json_schema` prints it. An editor that knows it completes the keys of a robot file and marks wrong
values. It states the keys, their kinds, ranges and needs; whether the numbers make a machine together is checked by
`python -m gen check` alone.
"""

from __future__ import annotations

import json
import math
from typing import Any

from gen.effects import ALL
from gen.effects.effect import Effect
from gen.robot.gear_catalogue import DATA_SHEET_KEYS
from gen.robot.schema import MAX_JOINTS, Key, KeyNeed, Range, ValueKind, describe_range, keys_of
from gen.robot.trust import TOLERANCES

DIALECT = "https://json-schema.org/draft/2020-12/schema"
LONGEST_NAME = 80  # characters of a robot's name

JsonSchema = dict[str, Any]


def build_json_schema() -> JsonSchema:
    """Build the JSON Schema of robot.toml.

    Returns:
        The schema, as JSON takes it.

    """
    top = _build_table("")
    top["properties"]["name"] |= {"minLength": 1, "maxLength": LONGEST_NAME}
    joints = {"type": "array", "minItems": 1, "maxItems": MAX_JOINTS}
    forms = [joints | {"items": _build_joint()}, joints | {"items": _build_joint_in_space()}]
    top["properties"] |= {"joint": joints, "effect": {"type": "array"}, "tip": _build_table("tip")}
    top["required"].append("joint")
    flat = {"joint": forms[0], "tip": False, "gravity": {"maxItems": 2}, "effect": _build_effects(in_space=False)}
    deep = {"joint": forms[1], "gravity": {"minItems": 3}, "effect": _build_effects(in_space=True)}
    return {"$schema": DIALECT, "title": "robot.toml", **top, "anyOf": [{"properties": flat}, {"properties": deep}]}


def _build_table(name: str) -> JsonSchema:
    """The schema of one table: its keys and those that every file needs; subtables are the caller's to add."""
    keys = keys_of(name)
    return {
        "type": "object",
        "properties": {key.name: _build_value(key) for key in keys.values()},
        "required": [key.name for key in keys.values() if key.need is KeyNeed.YES],
        "additionalProperties": False,
    }


def _build_joint_in_space() -> JsonSchema:
    """The schema of a joint of the long form."""
    return _build_joint_tables("joint in space")


def _build_joint_tables(name: str) -> JsonSchema:
    """The schema of the keys of a joint, in either form, with the tables that both have."""
    joint = _build_table(name)
    joint["properties"] |= {
        "drive": _build_drive(),
        "limits": _build_table("joint.limits"),
        "sensor": _build_table("joint.sensor"),
    }
    joint["required"].append("drive")
    return joint


def _build_joint() -> JsonSchema:
    """The schema of [[joint]] of the short form, with what depends on its type."""
    joint = _build_joint_tables("joint")
    slides = {"properties": {"type": {"const": "prismatic"}}, "required": ["type"]}
    fixed = {"properties": {"length": _build_zero(), "inertia_about_joint": False}}
    inertia = [{"required": ["inertia"]}, {"required": ["inertia_about_joint"]}]
    return joint | {"oneOf": inertia, "if": slides, "then": fixed, "else": {"required": ["length"]}}


def _build_zero() -> JsonSchema:
    """A parameter that is 0."""
    return {"anyOf": [{"const": 0}, {"properties": {"value": {"const": 0}}, "type": "object"}]}


def _build_drive() -> JsonSchema:
    """The schema of [joint.drive]: rigid, or with springs of the catalogue, of a data sheet, or of their own keys."""
    keys = keys_of("joint.drive").values()
    needs = {need: [key.name for key in keys if key.need is need] for need in KeyNeed}
    springs, only = needs[KeyNeed.SPRING_KEY], needs[KeyNeed.DATA_SHEET_ONLY]
    sheet, geared = list(DATA_SHEET_KEYS), needs[KeyNeed.GEARED]
    rigid = _forbid([*springs, *sheet, *only, *needs[KeyNeed.FLEXIBLE]]) | {"required": geared}
    of_catalogue = _forbid([*springs, *sheet, *only]) | {"required": ["catalogue"]}
    of_sheet = _forbid([*springs, "catalogue"]) | {"required": [*sheet, "hysteresis_loss", *geared]}
    of_keys = _forbid([*sheet, *only, "catalogue"]) | {"required": [*springs, *geared]}
    is_rigid = {"properties": {"rigid": {"const": True}}, "required": ["rigid"]}
    flexible = {"anyOf": [of_catalogue, of_sheet, of_keys]}
    return _build_table("joint.drive") | {"if": is_rigid, "then": rigid, "else": flexible}


def _forbid(names: list[str]) -> JsonSchema:
    """None of these keys may be there."""
    return {"properties": dict.fromkeys(names, False)}


def _build_effects(in_space: bool) -> JsonSchema:
    """The schema of all [[effect]] of a chain in the plane or in space."""
    return {"type": "array", "items": {"anyOf": [_build_effect(effect.choose_form(in_space)) for effect in ALL]}}


def _build_effect(effect: Effect) -> JsonSchema:
    """The schema of an [[effect]] of one name, with its own parameters."""
    table = _build_table("effect")
    table["properties"]["name"] = {"const": effect.name}
    for p in effect.parameters:
        key = Key("effect", p.name, ValueKind.PARAMETER, KeyNeed.NO, p.unit, Range(p.low, p.high), p.meaning, p.nominal)
        table["properties"][p.name] = _build_value(key)
    return table


def _build_value(key: Key) -> JsonSchema:
    """The schema of one value, with its meaning, unit and default."""
    words = "; ".join(part for part in (key.meaning, describe_range(key)) if part)
    schema: JsonSchema = {"description": words}
    if key.default is not None:
        schema["default"] = list(key.default) if isinstance(key.default, tuple) else key.default
    match key.kind:
        case ValueKind.PARAMETER:
            return schema | _build_parameter(key)
        case ValueKind.PARAMETERS:
            return schema | _build_list(_build_parameter(key), key.lengths)
        case ValueKind.VECTOR:
            return schema | _build_list(_build_number(key.range), key.lengths)
        case ValueKind.RANGE:
            return schema | _build_list(_build_number(key.range), (2,))
        case ValueKind.NUMBER:
            return schema | _build_number(key.range)
        case ValueKind.WHOLE:
            return schema | _build_number(key.range) | {"type": "integer"}
        case ValueKind.FLAG:
            return schema | {"type": "boolean"}
        case ValueKind.TEXT:
            choices = {"enum": list(key.choices)} if key.choices else {}
            return schema | {"type": "string"} | choices


def _build_parameter(key: Key) -> JsonSchema:
    """A number, or a table of value and tolerance or source."""
    number = _build_number(key.range)
    trust: dict[str, JsonSchema] = {
        "tolerance": _build_number(keys_of("")["tolerance"].range),
        "source": {"type": "string", "enum": list(TOLERANCES)},
    }
    tables = [
        {
            "type": "object",
            "properties": {"value": number, name: stated},
            "required": ["value", name],
            "additionalProperties": False,
        }
        for name, stated in trust.items()
    ]
    return {"anyOf": [number, *tables]}


def _build_list(entry: JsonSchema, lengths: tuple[int, ...]) -> JsonSchema:
    return {"type": "array", "items": entry, "minItems": min(lengths), "maxItems": max(lengths)}


def _build_number(span: Range) -> JsonSchema:
    """A number in a range; ends at infinity are left out."""
    schema: JsonSchema = {"type": "number"}
    if math.isfinite(span.low):
        schema["exclusiveMinimum" if span.excludes_low else "minimum"] = span.low
    if math.isfinite(span.high):
        schema["maximum"] = span.high
    return schema


if __name__ == "__main__":
    print(json.dumps(build_json_schema(), indent=1, ensure_ascii=False))
