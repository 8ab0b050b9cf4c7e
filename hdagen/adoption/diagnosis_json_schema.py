"""The JSON Schema (draft 2020-12) of diagnosis.json: one table of its keys, with their kinds and meanings.

`python -m hdagen.adoption.diagnosis_json_schema` prints it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from hdagen.adoption.diagnosis_schema import SCHEMA

DIALECT = "https://json-schema.org/draft/2020-12/schema"

JsonSchema = Mapping[str, Any]
Field = tuple[str, JsonSchema, str]  # a key, the schema of its value, and its meaning

NULL: JsonSchema = {"type": "null"}
NUMBER: JsonSchema = {"type": "number"}
COUNT: JsonSchema = {"type": "integer", "minimum": 0}
TEXT: JsonSchema = {"type": "string"}
FLAG: JsonSchema = {"type": "boolean"}
PROBABILITY: JsonSchema = {"type": "number", "minimum": 0, "maximum": 1}
MULTIPLE: JsonSchema = {"type": "number", "minimum": 0}
EFFECT: JsonSchema = {"type": "string", "pattern": "^[a-z][a-z0-9_]*@[0-9]+$"}
SPAN: JsonSchema = {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2}


def _list(entry: JsonSchema) -> JsonSchema:
    return {"type": "array", "items": entry}


def _named(entry: JsonSchema) -> JsonSchema:
    return {"type": "object", "additionalProperties": entry}


def _or_null(schema: JsonSchema) -> JsonSchema:
    return {"anyOf": [schema, NULL]}


def _table(name: str) -> JsonSchema:
    return {"$ref": f"#/$defs/{name}"}


OPTIONAL = {  # keys that a document may lack, each with its table
    ("diagnosis", "settings"),
    ("diagnosis", "joints"),
    ("diagnosis", "not_tried"),
    ("diagnosis", "tried"),
    ("estimate", "prior"),
    ("estimate", "file"),
    ("estimate", "conditional_std"),
    ("channel_gap", "unit"),
    ("cause", "combination"),
    ("method", "strained"),
}

# The keys of each table. Gaps and errors are in multiples of the sensor noise; an effect is name@joint.
# fmt: off
TABLES: dict[str, tuple[Field, ...]] = {
    "diagnosis": (
        ("schema", {"const": SCHEMA}, "version of this layout"),
        ("verdict", _list(EFFECT), "effects that are present, then unknown@j where much remains; empty for none"),
        ("sure", FLAG, "whether the named effects, or none, are sure"),
        ("where", _list(_table("location")), "place and time of the gap, by effect"),
        ("causes", _list(_table("cause")), "every candidate that was tried, the most probable first"),
        ("hypotheses", _list(_table("hypothesis")), "sets of effects with their probabilities"),
        ("parameters", _named(_table("estimate")), "refitted base parameters, by the model's names"),
        ("undetectable", _list(EFFECT), "effects that this motion would not show in their usual size"),
        ("tried", _list(EFFECT), "every candidate that the search had"),
        ("gap", _table("gap"), "gap on held-out motion"),
        ("doubts", _or_null(_table("doubts")), "a verdict that was withdrawn"),
        ("direct_evidence", _list(_table("direct_evidence")), "effects that show without any fit"),
        ("small", _list(_table("small_effect")), "effects that are present and close little"),
        ("contradicted", _or_null(_table("contradiction")), "a hold-out that contradicts the log"),
        ("remains", _list(_table("remainder")), "remaining error of each joint"),
        ("as_good_as_it_gets", FLAG, "whether nothing that was fitted closes much of the gap"),
        ("moments", _list(_table("moment")), "single seconds that hold nearly all of the remaining error"),
        ("nuisance_effects", _list(_table("nuisance_effect")), "effects within tolerance that would close more"),
        ("ranking", _list(_table("rank")), "gaps of the leading hypotheses, the largest first"),
        ("control", {"anyOf": [_table("control"), _table("refusal"), NULL]}, "the change for a controller"),
        ("method", _table("method"), "state of the fit"),
        ("robot", _table("robot"), "the robot that was diagnosed"),
        ("data", _table("data"), "logs, repairs and channels"),
        ("not_tried", _list(_table("untried_part")), "parts that were left out because the time was up"),
        ("settings", {"type": "object"}, "the tuned numbers that the diagnosis used"),
        ("joints", _list(_or_null(TEXT)), "name of each joint; null where the robot file gives none"),
    ),
    "untried_part": (
        ("part", TEXT, "the part of the search, or the stage"),
        ("effects", _list(EFFECT), "the effects that it was left out for; empty where it is for none"),
    ),
    "location": (
        ("joint", COUNT, "0 for the whole arm"),
        ("place", {"enum": ["input", "motor", "transmission", "link", "sensor"]}, "part of the joint"),
        ("share", _or_null(NUMBER), "share of the closed gap; of unknown@j: of the remaining squared error"),
        ("interval", _or_null(SPAN), "95 % interval of the share"),
        ("when", TEXT, "a sentence on the motion in which it shows"),
    ),
    "cause": (
        ("effect", TEXT, "name of the effect"),
        ("joint", COUNT, "0 for the whole arm"),
        ("probability", PROBABILITY, "probability that it is present, alone or with others"),
        ("parameters", _named(_table("estimate")), "estimates without the joint's suffix; empty if it was not fitted"),
        ("confounded_with", _list(EFFECT), "other effects that may explain the same"),
        ("combination", _list(EFFECT), "numbers of the robot file that the motion cannot part, itself among them"),
        ("separate_by", TEXT, "the experiment that separates them"),
        ("gap_after", _or_null(MULTIPLE), "least gap in the ranking with this cause"),
    ),
    "estimate": (
        ("value", NUMBER, "estimate, in its unit"),
        ("std", _or_null(MULTIPLE), "standard deviation; null for a shape and for a value without a fit"),
        ("unit", TEXT, "unit"),
        ("end", {"enum": ["low", "high", None]}, "the end of its range that the fit reached"),
        ("conditional_std", MULTIPLE, "standard deviation while all other parameters are held, where the fit has one"),
        ("prior", MULTIPLE, "standard deviation before the log, where it is not that of the robot file"),
        ("file", _or_null(NUMBER), "the robot file's number; null of an effect that it does not have"),
    ),
    "hypothesis": (
        ("effects", _list(EFFECT), "the set; empty for none"),
        ("probability", PROBABILITY, "calibrated; all sum to 1"),
    ),
    "gap": (
        ("before", MULTIPLE, "gap of the robot file"),
        ("after", MULTIPLE, "gap with the verdict and its base parameters"),
        ("floor", MULTIPLE, "gap of a model that is as good as the sensors"),
        ("flexible", _or_null(MULTIPLE), "gap of the nonparametric baseline"),
        ("achievable", MULTIPLE, "least gap of everything that was fitted"),
        ("shrink", _or_null(NUMBER), "(before - after)/(before - 1); null where there is no gap"),
        ("interval", _or_null(SPAN), "95 % interval of shrink"),
        ("by_channel", _named(_table("channel_gap")), "the same for each channel that counts"),
    ),
    "channel_gap": (
        ("before", MULTIPLE, "rms error of the robot file"),
        ("after", MULTIPLE, "rms error with the verdict"),
        ("noise", MULTIPLE, "standard deviation of the noise, in the channel's unit"),
        ("unit", TEXT, "unit of the channel"),
    ),
    "doubts": (
        ("verdict", _list(EFFECT), "the verdict that was withdrawn"),
        ("joint", COUNT, "joint with the largest share left"),
        ("left", MULTIPLE, "that share of its error"),
    ),
    "direct_evidence": (
        ("effect", TEXT, "name of the effect"),
        ("joint", COUNT, "0 for the whole arm"),
        ("parameters", _named(NUMBER), "values that were read off, by the model's names"),
        ("left", MULTIPLE, "share of the error that remains with the effect"),
    ),
    "small_effect": (
        ("effect", TEXT, "name of the effect"),
        ("joint", COUNT, "0 for the whole arm"),
        ("with", MULTIPLE, "gap with it"),
        ("without", MULTIPLE, "gap without it"),
    ),
    "contradiction": (
        ("verdict", _list(EFFECT), "verdict of the log alone"),
        ("closed", NUMBER, "share of the log's own gap that this closes"),
        ("left", NUMBER, "share of the hold-out's gap that it leaves"),
    ),
    "remainder": (
        ("joint", COUNT, "number of the joint"),
        ("share", MULTIPLE, "error after by error before, of the channel that is explained best"),
        ("noise", MULTIPLE, "error after of that channel"),
    ),
    "moment": (
        ("joint", COUNT, "number of the joint"),
        ("log", TEXT, "path of the log"),
        ("span", SPAN, "begin and end, s in the log's own time"),
        ("noise", MULTIPLE, "error in it, of the encoder that errs least"),
    ),
    "nuisance_effect": (
        ("effect", TEXT, "name of the effect"),
        ("joint", COUNT, "0 for the whole arm"),
        ("parameters", _named(_table("estimate")), "estimates by the model's names"),
        ("size", MULTIPLE, "in usual sizes"),
        ("gap", MULTIPLE, "gap with it and the verdict"),
    ),
    "rank": (
        ("model", {"enum": ["robot file", "hypothesis", "verdict"]}, "the model that was replayed"),
        ("effects", _list(EFFECT), "its effects"),
        ("probability", _or_null(PROBABILITY), "null for the robot file, and for a verdict that is no hypothesis"),
        ("gap", MULTIPLE, "its gap"),
        ("interval", _or_null(SPAN), "95 % interval of the gap"),
    ),
    "control": (
        ("law", TEXT, "the control law"),
        ("tracking", _table("change"), "rms error of the tip, m"),
        ("contact_force", _table("change"), "largest force at a wall, N"),
    ),
    "change": (
        ("before", MULTIPLE, "with a controller that knows the robot file"),
        ("after", MULTIPLE, "with a controller that knows the verdict"),
    ),
    "refusal": (("refused", TEXT, "why no controller can drive the model"),),
    "method": (
        ("calibrated", FLAG, "false for a verdict of the long horizon"),
        ("uncalibrated_probability", PROBABILITY, "probability of the verdict before calibration"),
        ("present_size", MULTIPLE, "size from which an effect is present, in usual sizes"),
        ("most_doubt", PROBABILITY, "probability of everything else, up to which a verdict is sure"),
        ("strained", _list(TEXT), "parameters that the log presses against three of their tolerances"),
        ("nuisance_width", MULTIPLE, "prior width of the nuisance effects, in usual sizes"),
        ("unexplained_torque", MULTIPLE, "size of the residual torque, in 2 % of the usual motor torque"),
        ("noise_scale", MULTIPLE, "geometric mean of the windows' noise scales"),
    ),
    "robot": (
        ("name", TEXT, "name in the robot file"),
        ("identity", TEXT, "hash of the numbers that the equations of motion are made of"),
        ("sha256", _or_null(TEXT), "hash of the file; null for a preset"),
    ),
    "data": (
        ("log", TEXT, "paths of the logs"),
        ("rate", MULTIPLE, "rows a second of the first log, Hz"),
        ("duration", MULTIPLE, "length of all logs, s"),
        ("held_out", TEXT, "a sentence on the hold-out"),
        ("hold_out", _list(_table("held_rows")), "the held-out rows of each log"),
        ("notes", _list(TEXT), "notes of the logs; stages and simulations that failed"),
        ("rows", COUNT, "rows of the first log"),
        ("jitter", MULTIPLE, "of its stamps, s"),
        ("clock", _table("clock"), "the time that is used"),
        ("dropped", COUNT, "rows that are missing"),
        ("gaps", COUNT, "gaps in which they are missing"),
        ("lags", _named(NUMBER), "lag of each measured input behind its command, s"),
        ("missing", _list(TEXT), "channels that are not logged, and the consequence"),
        ("channels", _named(_table("channel")), "statistics of each channel of the first log"),
        ("skews", _list(TEXT), "time skews between channels"),
        ("warnings", _list(TEXT), "findings that somebody should look at"),
        ("noticed", _list(TEXT), "findings that are good to know"),
        ("repaired", _list(_table("repair")), "repairs of the logs"),
        ("still", _list(COUNT), "joints that no log moves"),
        ("refused", {"type": "array", "maxItems": 0}, "always empty: a log that is refused gives no document"),
    ),
    "held_rows": (
        ("log", TEXT, "path of the log"),
        ("rows", COUNT, "rows that are held out"),
        ("spans", _list(SPAN), "first and last instant of each run of rows, s"),
    ),
    "clock": (
        ("even", FLAG, "whether rows are taken as evenly spaced"),
        ("uncertainty", MULTIPLE, "standard deviation of an instant, s"),
    ),
    "channel": (
        ("noise", MULTIPLE, "standard deviation, in the channel's unit"),
        ("step", MULTIPLE, "resolution; 0 where no steps are seen"),
        ("low", NUMBER, "least value"),
        ("high", NUMBER, "largest value"),
    ),
    "repair": (
        ("log", TEXT, "path of the log"),
        ("name", TEXT, "kind of repair"),
        ("joint", COUNT, "0 for the whole log"),
        ("what", TEXT, "a sentence on mistake and repair"),
    ),
}
# fmt: on


def build_json_schema() -> dict[str, Any]:
    """Build the JSON Schema of diagnosis.json.

    Returns:
        The schema, as JSON takes it.

    """
    tables = {name: _build_object(name, fields) for name, fields in TABLES.items()}
    return {"$schema": DIALECT, "title": "diagnosis.json", **tables.pop("diagnosis"), "$defs": tables}


def _build_object(name: str, fields: tuple[Field, ...]) -> dict[str, Any]:
    """The schema of one table."""
    return {
        "type": "object",
        "properties": {key: {**kind, "description": meaning} for key, kind, meaning in fields},
        "required": [key for key, _, _ in fields if (name, key) not in OPTIONAL],
        "additionalProperties": False,
    }


if __name__ == "__main__":
    print(json.dumps(build_json_schema(), indent=1, ensure_ascii=False))
