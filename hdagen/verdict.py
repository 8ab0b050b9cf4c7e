"""The verdict of a diagnosis.json: effects with their parameters and re-estimated base parameters, and a model that has them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.plant import Arm, PlantError, load

SCHEMA = 1
REACH = 3.0  # standard deviations of its tolerance that a base parameter may move
_LARGEST = 10_000_000  # bytes of a file
_EFFECT = re.compile(r"([a-z][a-z0-9_]{0,47})@([0-9]{1,2})")
_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")


@dataclass(frozen=True)
class Verdict:
    """``effects``: (name, joint), joint 0 the whole arm; ``unknown``: joints of gaps that no effect explains; ``parameters`` of the
    effects and ``base`` parameters by the model's names (``mass_1``); ``source`` for sentences."""

    source: str
    effects: tuple[tuple[str, int], ...]
    unknown: tuple[int, ...]
    parameters: Mapping[str, float]
    base: Mapping[str, float]


def read(given: str | Path | Mapping[str, Any]) -> Verdict:
    """A diagnosis.json, or what it holds. Raises PlantError with every problem."""
    source = "diagnosis" if isinstance(given, Mapping) else str(given)
    content = given if isinstance(given, Mapping) else _load(Path(given))
    if content.get("schema") != SCHEMA:
        raise PlantError(
            f"{source}: schema is {_short(content.get('schema'))}, possible is {SCHEMA}: diagnose again with this version."
        )
    problems: list[str] = []
    effects, unknown = [], []
    causes = _causes(content, source, problems)
    parameters: dict[str, float] = {}
    stated = content.get("verdict")
    if not isinstance(stated, list):
        problems.append(f"{source}, verdict: found {_short(stated)}, possible is a list of effects as name@joint.")
        stated = []
    for entry in stated:
        match = _EFFECT.fullmatch(entry) if isinstance(entry, str) else None
        if not match:
            problems.append(
                f"{source}, verdict: found {_short(entry)}, possible is name@joint, as stribeck_friction@2."
            )
            continue
        name, joint = match[1], int(match[2])
        if name == "unknown":
            unknown.append(joint)
        elif (name, joint) not in causes:
            problems.append(
                f"{source}, causes: {entry} is in the verdict and has no entry with its parameters; diagnose again."
            )
        else:
            effects.append((name, joint))
            parameters |= _numbers(
                causes[name, joint], source, f"causes, {entry}", f"_{joint}" if joint else "", problems
            )
    base = _numbers(content.get("parameters", {}), source, "parameters", "", problems)
    if problems:
        raise PlantError("\n".join(problems))
    return Verdict(
        source, tuple(effects), tuple(unknown), parameters, {k: v for k, v in base.items() if k not in parameters}
    )


def with_effects(robot: str | Path, profile: str, verdict: Verdict) -> Arm:
    """The model of ``robot`` with the verdict's effects in it; parameters as the robot file says. Raises PlantError."""
    arm = load(robot, profile)
    _fits(arm, verdict)
    added = tuple(sorted(_absent(arm, verdict)))
    if not added:
        return arm
    try:
        return load(robot, profile, added)
    except PlantError as error:
        raise PlantError(f"{verdict.source}: the model cannot be built with {', '.join(added)}: {error}") from None


def applied(arm: Arm, verdict: Verdict) -> tuple[Arm, list[str]]:
    """A copy of ``arm`` with the verdict's parameters, and what there is to say. Raises PlantError."""
    _fits(arm, verdict)
    absent = _absent(arm, verdict)
    if absent:
        names = ", ".join(f'"{name}"' for name in sorted(absent))
        raise PlantError(
            f"{verdict.source}: the model lacks {names}; load it with hdagen.load(robot, effects=({names},))."
        )
    names = [name for name in (*verdict.parameters, *verdict.base) if name not in arm.parameters]
    if names:
        raise PlantError(
            f"{verdict.source}: the model has no parameter {', '.join(names)}; is the diagnosis of another robot?"
        )
    notes = [f"unknown@{joint} has no equation: nothing is added for it." for joint in verdict.unknown]
    values = dict(verdict.parameters)
    for name, value in verdict.base.items():
        described = arm.parameters.described[name]
        reach = REACH * described.tolerance * abs(described.nominal)
        values[name] = min(max(value, described.nominal - reach), described.nominal + reach)
        if abs(values[name] - value) > 1e-9 * abs(described.nominal):
            notes.append(
                f"{name}: {value:.6g} {described.unit} lies beyond {REACH:g} times its tolerance of {100 * described.tolerance:g} % "
                f"and is taken as {values[name]:.6g}."
            )
    changed = Arm(arm.folder)
    changed.parameters.update(dict(arm.parameters))
    try:
        changed.parameters.update(values)
    except PlantError as error:
        raise PlantError("\n".join(f"{verdict.source}: {line}" for line in str(error).split("\n"))) from None
    return changed, notes


def _fits(arm: Arm, verdict: Verdict) -> None:
    """Refuses a diagnosis of a robot with more joints."""
    beyond = [f"{name}@{joint}" for name, joint in verdict.effects if joint > arm.n]
    beyond += [f"unknown@{joint}" for joint in verdict.unknown if joint > arm.n]
    if beyond:
        raise PlantError(
            f"{verdict.source}: {', '.join(beyond)} at a joint that {arm.robot['name']} does not have, its joints are 1 to {arm.n}: "
            "the diagnosis is of another robot."
        )


def _absent(arm: Arm, verdict: Verdict) -> set[str]:
    """The verdict's effects whose equation the model does not have: some parameter of theirs is missing."""
    prefix = {(name, joint): f"_{joint}" if joint else "" for name, joint in verdict.effects}
    present = {effect["name"] for effect in arm.manifest["effects"]}
    known = {name for name in verdict.parameters if name in arm.parameters}
    absent = set()
    for (name, _), suffix in prefix.items():
        own = [p for p in verdict.parameters if p.endswith(suffix)]
        if name not in present and not set(own) <= known:
            absent.add(name)
    return absent


def _load(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > _LARGEST:
            raise PlantError(f"{path}: larger than {_LARGEST} bytes, no diagnosis is; name a diagnosis.json.")
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        why = getattr(error, "strerror", None) or str(error)[:200]
        raise PlantError(
            f"{path}: cannot be read as JSON ({why}); name the diagnosis.json that hdagen diagnose wrote."
        ) from None
    if not isinstance(content, dict):
        raise PlantError(f"{path}: found {_short(content)}, possible is a JSON object; name a diagnosis.json.")
    return content


def _causes(content: Mapping[str, Any], source: str, problems: list[str]) -> dict[tuple[str, int], Any]:
    """Parameters of every cause by effect and joint."""
    causes = content.get("causes", [])
    found = {}
    for k, cause in enumerate(causes if isinstance(causes, list) else [causes]):
        if (
            not isinstance(cause, Mapping)
            or not isinstance(cause.get("effect"), str)
            or type(cause.get("joint")) is not int
        ):
            problems.append(
                f"{source}, causes[{k}]: found {_short(cause)}, possible is an object with effect and joint."
            )
            continue
        found[cause["effect"], cause["joint"]] = cause.get("parameters", {})
    return found


def _numbers(values: Any, source: str, where: str, suffix: str, problems: list[str]) -> dict[str, float]:
    """``{name: {value, …}}`` or ``{name: number}`` as numbers by the model's names."""
    if not isinstance(values, Mapping):
        problems.append(f"{source}, {where}: found {_short(values)}, possible is an object of parameters.")
        return {}
    found = {}
    for name, entry in values.items():
        value = entry.get("value") if isinstance(entry, Mapping) else entry
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            problems.append(f"{source}, {where}: {_short(name)} is no name of a parameter.")
        elif isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            problems.append(
                f"{source}, {where}, {name}: found {_short(value)}, possible is a finite number; diagnose again."
            )
        else:
            found[name + suffix] = float(value)
    return found


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
