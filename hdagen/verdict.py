"""The verdict of a diagnosis.json: effects with their parameters, re-estimated base parameters, and a model that has
them."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.input_file import InputFileError, read_json
from hdagen.names import printable, shown, shown_path
from hdagen.plant import Arm, PlantError, load

SCHEMA = 1
REACH = 3.0  # standard deviations of its tolerance that a base parameter may move
LEVEL = 0.13  # m/s² that gravity may move, three quarters of a degree: no base is quite level
LARGEST = 10_000_000  # bytes of a file
_MOST = 200  # effects of a verdict
_EFFECT = re.compile(r"([a-z][a-z0-9_]{0,47})@(0|[1-9][0-9]?)")
_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")


@dataclass(frozen=True)
class Named:
    """An effect of the verdict: ``joint`` 0 is the whole arm; ``parameters`` by the model's names (``bias_2``)."""

    name: str
    joint: int
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Verdict:
    """``effects`` to add; ``unknown``: joints of gaps that no effect explains; ``base`` parameters by the model's names
    (``mass_1``), without those of the effects; ``source`` for sentences; ``robot``: name of what was diagnosed, and
    SHA-256 of its file (None: a preset); None where a diagnosis does not say."""

    source: str
    effects: tuple[Named, ...]
    unknown: tuple[int, ...]
    base: Mapping[str, float]
    robot: tuple[str, str | None] | None = None

    @property
    def parameters(self) -> dict[str, float]:
        """Those of all effects."""
        return {name: value for effect in self.effects for name, value in effect.parameters.items()}


def read(given: str | Path | Mapping[str, Any]) -> Verdict:
    """A diagnosis.json, or what it holds. Raises PlantError with every problem."""
    source = "diagnosis" if isinstance(given, Mapping) else shown_path(given)
    content = given if isinstance(given, Mapping) else read_content(Path(given))
    if type(content.get("schema")) is not int or content["schema"] != SCHEMA:
        found = shown(content.get("schema"))
        raise PlantError(f"{source}: schema is {found}, possible is {SCHEMA}: diagnose again with this version.")
    problems: list[str] = []
    causes = _causes(content, source, problems)
    stated = content.get("verdict")
    if not isinstance(stated, list):
        problems.append(f"{source}, verdict: found {shown(stated)}, possible is a list of effects as name@joint.")
        stated = []
    elif len(stated) > _MOST:
        problems.append(f"{source}, verdict: found {len(stated)} effects, possible are {_MOST}; diagnose again.")
        stated = []
    effects, unknown = [], []
    for k, entry in enumerate(stated):
        match = _EFFECT.fullmatch(entry) if isinstance(entry, str) else None
        if not match:
            problems.append(f"{source}, verdict: found {shown(entry)}, possible is name@joint, as stribeck_friction@2.")
        elif stated.index(entry) < k:
            problems.append(f"{source}, verdict: {entry} stands there twice; diagnose again.")
        elif match[1] == "unknown":
            unknown.append(int(match[2]))
        elif not causes.get((match[1], int(match[2]))):
            problems.append(f"{source}, causes: {entry} is in the verdict and has no parameters here; diagnose again.")
        else:
            name, joint = match[1], int(match[2])
            values = _numbers(causes[name, joint], f"{source}, causes, {entry}", f"_{joint}" if joint else "", problems)
            effects.append(Named(name, joint, values))
    base = _numbers(content.get("parameters", {}), f"{source}, parameters", "", problems)
    robot = _robot(content.get("robot"), source, problems)
    if problems:
        raise PlantError("\n".join(problems))
    own = {name for effect in effects for name in effect.parameters}
    return Verdict(source, tuple(effects), tuple(unknown), {k: v for k, v in base.items() if k not in own}, robot)


def with_effects(robot: str | Path, profile: str, verdict: Verdict) -> Arm:
    """The model of ``robot`` with the verdict's effects in it, at the robot file's parameters. Raises PlantError: where
    the diagnosis is of another robot, or of its file before it was changed, too."""
    arm = load(robot, profile)
    _fits(arm, verdict)
    if verdict.robot is not None:
        _same(robot, arm, verdict.source, *verdict.robot)
    added = _absent(arm, verdict)
    if not added:
        return arm
    try:
        return load(robot, profile, added)
    except PlantError as error:
        raise PlantError(f"{verdict.source}: no model can be built with {', '.join(added)}: {error}") from None


def applied(arm: Arm, verdict: Verdict) -> tuple[Arm, list[str]]:
    """A copy of ``arm`` with the verdict's parameters, and what there is to say. Raises PlantError."""
    _fits(arm, verdict)
    absent = ", ".join(f'"{name}"' for name in _absent(arm, verdict))
    if absent:
        raise PlantError(
            f"{verdict.source}: the model lacks {absent}; load it with hdagen.load(robot, effects=({absent},))."
        )
    described, values = arm.parameters.described, verdict.parameters
    missing = [name for name in (*values, *verdict.base) if name not in described]
    if missing:
        raise PlantError(
            f"{verdict.source}: the model has no parameter {', '.join(missing)}: the diagnosis is of another robot, or "
            "of another version."
        )
    notes = [f"unknown@{joint} has no equation: nothing is added for it." for joint in verdict.unknown]
    for name, value in verdict.base.items():
        q = described[name]
        reach, words = REACH * q.tolerance * abs(q.nominal), f"{REACH:g} times its tolerance of {100 * q.tolerance:g} %"
        if name.startswith("gravity_") and reach < LEVEL:
            reach, words = LEVEL, f"{LEVEL:g} {q.unit} that a base may lean"
        values[name] = min(max(value, q.nominal - reach), q.nominal + reach)
        if abs(values[name] - value) > 1e-9 * max(abs(q.nominal), abs(value)):
            notes.append(f"{name}: {value:.6g} {q.unit} lies beyond {words} and is taken as {values[name]:.6g}.")
    changed = arm.at(arm.p)
    try:
        changed.parameters.update(values)
    except PlantError as error:
        raise PlantError("\n".join(f"{verdict.source}: {line}" for line in str(error).split("\n"))) from None
    return changed, notes


def _fits(arm: Arm, verdict: Verdict) -> None:
    """Refuses a diagnosis of a robot with more joints."""
    stated = [(effect.name, effect.joint) for effect in verdict.effects] + [("unknown", j) for j in verdict.unknown]
    beyond = [f"{name}@{joint}" for name, joint in stated if joint > arm.n]
    if beyond:
        raise PlantError(
            f"{verdict.source}: {', '.join(beyond)} is at a joint that {arm.robot['name']} does not have, its joints "
            f"are 1 to {arm.n}: the diagnosis is of another robot."
        )


def _robot(stated: Any, source: str, problems: list[str]) -> tuple[str, str | None] | None:
    """Name and SHA-256 of what was diagnosed."""
    if isinstance(stated, Mapping):
        name, digest = stated.get("name"), stated.get("sha256", 0)
        if isinstance(name, str) and isinstance(digest, str | None):
            return name, digest
    if stated is not None:
        problems.append(f"{source}, robot: possible is an object with name and sha256; diagnose again.")
    return None


def _same(robot: str | Path, arm: Arm, source: str, name: str, digest: str | None) -> None:
    """Refuses a ``robot`` that is not the one of this name, or whose file is not the one that was diagnosed."""
    if name != arm.robot["name"]:
        raise PlantError(
            f"{source}: the diagnosis is of the robot {name!r:.90}, {robot} is of {arm.robot['name']!r:.90}; name the "
            "file that was diagnosed."
        )
    file = Path(robot)
    if file.is_file() and digest != hashlib.sha256(file.read_bytes()).hexdigest():
        raise PlantError(
            f"{source}: {robot} is not the file that was diagnosed, or has changed since (its SHA-256 is another); "
            "name the file as it was, or diagnose again."
        )


def _absent(arm: Arm, verdict: Verdict) -> tuple[str, ...]:
    """The verdict's effects whose equation the model lacks; one that frees parameters it has needs none."""
    present = {effect["name"] for effect in arm.manifest["effects"]}
    known = set(arm.parameters.described)
    return tuple(sorted({e.name for e in verdict.effects if e.name not in present and set(e.parameters) - known}))


def read_content(path: Path) -> Mapping[str, Any]:
    """What a diagnosis.json holds: an object whose numbers are all finite. Raises PlantError."""
    try:
        content = read_json(path, LARGEST, "name a diagnosis.json that hdagen diagnose wrote")
    except InputFileError as error:
        raise PlantError(error) from None
    if not isinstance(content, dict):
        raise PlantError(
            f"{shown_path(path)}: found {shown(content)}, possible is a JSON object; name a diagnosis.json."
        )
    if (where := next(_infinite(content), None)) is not None:
        raise PlantError(f"{shown_path(path)}{printable(where):.200}")
    return content


def _infinite(content: Mapping[str, Any]) -> Iterator[str]:
    """Where numbers stand that are none: what is written is finite throughout."""
    left: list[tuple[str, Any]] = [("", content)]
    while left:
        where, value = left.pop()
        if isinstance(value, Mapping):
            left += [(f"{where}, {name}", entry) for name, entry in value.items()]
        elif isinstance(value, list):
            left += [(f"{where}[{k}]", entry) for k, entry in enumerate(value)]
        elif isinstance(value, int | float) and not _finite(value):
            yield f"{where}: found {shown(value)}, possible is a finite number; diagnose again."


def _causes(content: Mapping[str, Any], source: str, problems: list[str]) -> dict[tuple[str, int], Any]:
    """Parameters of every cause by effect and joint."""
    causes = content.get("causes", [])
    found: dict[tuple[str, int], Any] = {}
    if not isinstance(causes, list):
        problems.append(f"{source}, causes: found {shown(causes)}, possible is a list of objects; diagnose again.")
        return found
    for k, cause in enumerate(causes):
        whole = isinstance(cause, Mapping) and isinstance(cause.get("effect"), str)
        if not whole or type(cause.get("joint")) is not int:
            problems.append(
                f"{source}, causes[{k}]: found {shown(cause)}, possible is an object with effect and joint."
            )
        else:
            found[cause["effect"], cause["joint"]] = cause.get("parameters")
    return found


def _numbers(values: Any, where: str, suffix: str, problems: list[str]) -> dict[str, float]:
    """``{name: {value, …}}`` or ``{name: number}`` as numbers by the model's names."""
    if not isinstance(values, Mapping):
        problems.append(f"{where}: found {shown(values)}, possible is an object of parameters.")
        return {}
    found = {}
    for name, entry in values.items():
        value = entry.get("value") if isinstance(entry, Mapping) else entry
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            problems.append(f"{where}: {shown(name)} is no name of a parameter.")
        elif isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
            problems.append(f"{where}, {name}: found {shown(value)}, possible is a finite number; diagnose again.")
        else:
            found[name + suffix] = float(value)
    return found


def _finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond the doubles
        return False
