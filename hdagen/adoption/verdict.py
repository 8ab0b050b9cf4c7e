"""The verdict of a diagnosis.json: effects with their parameters, re-estimated base parameters, and a model that has
them."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeGuard

from hdagen.adoption.diagnosis_file import is_finite, read_content
from hdagen.adoption.diagnosis_schema import FIRST_SCHEMA, SCHEMA, upgrade_content
from hdagen.adoption.link_inertia import make_inertias_possible
from hdagen.adoption.robot_identity import compute_robot_identity
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.arm.joint_names import number_effect
from hdagen.support.messages import show_path, show_value

UNCHANGED_WIDTH_SHARE = 0.9  # posterior by prior width, from which on a log said nothing of a parameter
LEAST_MOVE = 0.1  # of the prior width, that such a parameter has moved at most
MOST_TOLERANCES = 3.0  # standard deviations of its tolerance that a base parameter may move
FACTOR = "factor"  # of a wrong number, beside its parameter: truth over file
MOST_GRAVITY_CHANGE = 0.13  # m/s² that gravity may move, three quarters of a degree: no base is quite level
_BOUND_ROUNDING = 1e-6  # of a range, by which a number may lie beyond its ends without a word
_MOST_READ_EFFECTS = 200  # effects of a verdict
_EFFECT_PATTERN = re.compile(r"([a-z][a-z0-9_]{0,47})@(0|[1-9][0-9]?)")
_PARAMETER_PATTERN = re.compile(r"[a-z][a-z0-9_]{0,63}")


@dataclass(frozen=True)
class NamedEffect:
    """An effect of the verdict: ``joint`` 0 is the whole arm; ``parameters`` by the model's names (``bias_2``)."""

    name: str
    joint: int
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class DiagnosedRobot:
    """The robot that was diagnosed: its ``name``, its `identity` (None: a diagnosis from before there was one), and the
    SHA-256 of its file (None: a preset)."""

    name: str
    identity: str | None
    sha256: str | None


@dataclass(frozen=True)
class Verdict:
    """``effects`` to add; ``unknown``: joints of gaps that no effect explains; ``base`` parameters by the model's names
    (``mass_1``), without those of the effects, with their ``standard_deviations``: standard deviation after the log
    and, where the diagnosis states one, before; ``source`` for sentences; ``robot``: None where a diagnosis does not
    say."""

    source: str
    effects: tuple[NamedEffect, ...]
    unexplained_joints: tuple[int, ...]
    base_parameters: Mapping[str, float]
    robot: DiagnosedRobot | None = None
    standard_deviations: Mapping[str, tuple[float, float | None]] = field(default_factory=dict)

    @property
    def effect_parameters(self) -> dict[str, float]:
        """Those of all effects."""
        return {name: value for effect in self.effects for name, value in effect.parameters.items()}


def read_verdict(given: str | Path | Mapping[str, Any]) -> Verdict:
    """Read the verdict of a diagnosis.

    Args:
        given: A diagnosis.json, or its content.

    Returns:
        The verdict.

    Raises:
        PlantError: It cannot be read, is of another schema, or contradicts itself; the message has every problem.

    """
    if isinstance(given, Mapping):
        source, content = "diagnosis", upgrade_content(given)
    else:
        source, content = show_path(given), read_content(Path(given))
    if type(content.get("schema")) is not int or content["schema"] != SCHEMA:
        found = show_value(content.get("schema"))
        possible = f"possible are {FIRST_SCHEMA} and {SCHEMA}"
        raise PlantError(f"{source}: schema is {found}, {possible}: diagnose again with this version.")
    problems: list[str] = []
    causes = _read_causes(content, source, problems)
    stated = content.get("verdict")
    if not isinstance(stated, list):
        problems.append(f"{source}, verdict: found {show_value(stated)}, possible is a list of effects as name@joint.")
        stated = []
    elif len(stated) > _MOST_READ_EFFECTS:
        problems.append(
            f"{source}, verdict: found {len(stated)} effects, possible are {_MOST_READ_EFFECTS}; diagnose again."
        )
        stated = []
    if isinstance(names := content.get("joints"), list):
        stated = [number_effect(entry, names) if isinstance(entry, str) else entry for entry in stated]
    effects, unknown = _read_effects(stated, causes, source, problems)
    base = _read_numbers(content.get("parameters", {}), f"{source}, parameters", "", problems)
    robot = _read_diagnosed_robot(content.get("robot"), source, problems)
    if problems:
        raise PlantError("\n".join(problems))
    own = {name for effect in effects for name in effect.parameters}
    base = {name: value for name, value in base.items() if name not in own}
    return Verdict(source, tuple(effects), tuple(unknown), base, robot, _read_deviations(content.get("parameters", {})))


def _read_effects(
    stated: list[Any], causes: Mapping[tuple[str, int], Any], source: str, problems: list[str]
) -> tuple[list[NamedEffect], list[int]]:
    """The effects of a verdict, and the joints of gaps that no effect explains."""
    effects, unknown = [], []
    for k, entry in enumerate(stated):
        match = _EFFECT_PATTERN.fullmatch(str(entry))
        if not match or not isinstance(entry, str):
            problems.append(
                f"{source}, verdict: found {show_value(entry)}, possible is name@joint, as stribeck_friction@2."
            )
        elif stated.index(entry) < k:
            problems.append(f"{source}, verdict: {entry} stands there twice; diagnose again.")
        elif match[1] == "unknown":
            unknown.append(int(match[2]))
        elif causes.get((match[1], int(match[2]))) is None:
            problems.append(f"{source}, causes: {entry} is in the verdict and has no parameters here; diagnose again.")
        else:
            name, joint, suffix = match[1], int(match[2]), f"_{match[2]}"
            if joint == 0:
                suffix = ""
            values = _read_numbers(causes[name, joint], f"{source}, causes, {entry}", suffix, problems)
            values.pop(f"{FACTOR}{suffix}", None)
            effects.append(NamedEffect(name, joint, values))
    return effects, unknown


def load_with_effects(robot: str | Path, profile: str, verdict: Verdict) -> Arm:
    """Load a robot with the verdict's effects in its model, at the parameters of the robot file.

    Args:
        robot: A preset or the path of a robot.toml.
        profile: Profile of the build, "portable" or "native".
        verdict: The verdict.

    Returns:
        The arm.

    Raises:
        PlantError: The diagnosis is of another robot, the robot file has changed since, or no model can be built.

    """
    arm = load(robot, profile)
    _check_joints(arm, verdict)
    if verdict.robot is not None:
        _check_same_robot(robot, arm, verdict.source, verdict.robot)
    added = _list_absent_effects(arm, verdict)
    if not added:
        return arm
    try:
        return load(robot, profile, added)
    except PlantError as error:
        raise PlantError(f"{verdict.source}: no model can be built with {', '.join(added)}: {error}") from None


def apply_verdict(arm: Arm, verdict: Verdict) -> tuple[Arm, list[str]]:
    """Copy an arm with the verdict's parameters.

    Args:
        arm: An arm whose model has the verdict's effects.
        verdict: The verdict.

    Returns:
        The copy, and notes in sentences.

    Raises:
        PlantError: The model lacks an effect or a parameter of the verdict.

    """
    _check_joints(arm, verdict)
    absent = ", ".join(f'"{name}"' for name in _list_absent_effects(arm, verdict))
    if absent:
        raise PlantError(
            f"{verdict.source}: the model lacks {absent}; load it with hdagen.load_robot(robot, effects=({absent},))."
        )
    described, stated = arm.parameters.described, verdict.effect_parameters
    missing = [name for name in (*stated, *verdict.base_parameters) if name not in described]
    if missing:
        raise PlantError(
            f"{verdict.source}: the model has no parameter {', '.join(missing)}: the diagnosis is of another robot, or "
            "of another version."
        )
    notes = [f"unknown@{joint} has no equation: nothing is added for it." for joint in verdict.unexplained_joints]
    notes += [
        f"{effect.name}@{effect.joint} has no numbers in the diagnosis, as no fit has it: nothing is added for it."
        for effect in verdict.effects
        if not effect.parameters
    ]
    values = find_rigid_compliances(arm, stated) | stated
    for name, value in verdict.base_parameters.items():
        q = described[name]
        std, prior = verdict.standard_deviations.get(name, (None, None))
        if std is not None and is_uninformed(value - q.nominal, std, prior or q.deviation):
            continue
        reach, words = (
            MOST_TOLERANCES * q.deviation,
            f"{MOST_TOLERANCES:g} times its tolerance, {100 * q.tolerance:g} % of {q.reference_size:.3g} {q.unit}",
        )
        if name.startswith("gravity_") and reach < MOST_GRAVITY_CHANGE:
            reach, words = MOST_GRAVITY_CHANGE, f"{MOST_GRAVITY_CHANGE:g} {q.unit} that a base may lean"
        values[name] = min(max(value, q.nominal - reach), q.nominal + reach)
        if abs(values[name] - value) > 1e-9 * max(abs(q.nominal), abs(value)):
            notes.append(f"{name}: {value:.6g} {q.unit} lies beyond {words} and is taken as {values[name]:.6g}.")
    for name, value in values.items():
        q = described[name]
        values[name] = min(max(value, q.low), q.high)
        if abs(values[name] - value) > _BOUND_ROUNDING * (q.high - q.low):
            span = f"[{q.low:g}, {q.high:g}]"
            notes.append(f"{name}: {value:.6g} {q.unit} is not within {span} and is taken as {values[name]:.6g}.")
    changed = arm.with_parameters(arm.p)
    changed.parameters.update(values)
    possible, said = make_inertias_possible(changed)
    changed.parameters.update(possible)
    return changed, [*notes, *said]


def is_uninformed(moved: float, std: float, prior: float) -> bool:
    """Tell whether a log said nothing of a base parameter: its deviation is as before, and it hardly moved.

    A parameter that moved counts although its deviation is as before: the log may tell it together with others.

    Args:
        moved: Difference from the robot file.
        std: Standard deviation after the log.
        prior: Standard deviation before it.

    Returns:
        Whether the log said nothing.

    """
    return prior > 0.0 and std >= UNCHANGED_WIDTH_SHARE * prior and abs(moved) <= LEAST_MOVE * prior


def find_rigid_compliances(arm: Arm, stated: Mapping[str, float]) -> dict[str, float]:
    """Of drives that the robot file calls rigid and the model gives a spring, its compliance where none is ``stated``:
    the least there is."""
    described = arm.parameters.described.values()
    springs = arm.effects.series_springs
    free = (q for q in described if q.effect in springs and q.role == "amplitude" and q.name not in stated)
    absent = {effect["joint"] for effect in arm.robot["effects"] if effect["name"] in springs}
    return {q.name: q.low for q in free if q.joint not in absent}


def _check_joints(arm: Arm, verdict: Verdict) -> None:
    """Refuse a diagnosis of a robot with more joints."""
    stated = [(effect.name, effect.joint) for effect in verdict.effects] + [
        ("unknown", j) for j in verdict.unexplained_joints
    ]
    beyond = [f"{name}@{joint}" for name, joint in stated if joint > arm.n]
    if beyond:
        raise PlantError(
            f"{verdict.source}: {', '.join(beyond)} is at a joint that {arm.robot['name']} does not have, its joints "
            f"are 1 to {arm.n}: the diagnosis is of another robot."
        )


def _read_diagnosed_robot(stated: Any, source: str, problems: list[str]) -> DiagnosedRobot | None:
    """The robot that was diagnosed."""
    if isinstance(stated, Mapping):
        name, same, digest = stated.get("name"), stated.get("identity"), stated.get("sha256", 0)
        if isinstance(name, str) and isinstance(same, str | None) and isinstance(digest, str | None):
            return DiagnosedRobot(name, same, digest)
    if stated is not None:
        problems.append(f"{source}, robot: possible is an object with name and sha256; diagnose again.")
    return None


def _check_same_robot(robot: str | Path, arm: Arm, source: str, diagnosed: DiagnosedRobot) -> None:
    """Refuse a ``robot`` with other numbers than the diagnosed one; the same bytes are the same numbers, also where
    another version of hdagen hashed them. Of an older diagnosis, which has only the hash of the file, refuse one of
    another name or of other bytes."""
    name, own, file = diagnosed.name, arm.robot["name"], Path(robot)
    if diagnosed.identity == compute_robot_identity(arm.robot):
        return
    if name != own:
        raise PlantError(
            f"{source}: the diagnosis is of the robot {name!r:.90}, {robot} is of {own!r:.90}; name the "
            "file that was diagnosed."
        )
    if file.is_file() and diagnosed.sha256 == hashlib.sha256(file.read_bytes()).hexdigest():
        return
    if diagnosed.identity is not None:
        raise PlantError(
            f"{source}: {robot} is not the robot that was diagnosed, or has changed since: its gravity, a link, a "
            "drive or an effect has another number or tolerance; name the file as it was, or diagnose again."
        )
    if file.is_file():
        raise PlantError(
            f"{source}: is of an older version and knows its robot file by its bytes alone (SHA-256), and {robot} has "
            "others, be it in a comment; name the file as it was, or diagnose again."
        )


def _list_absent_effects(arm: Arm, verdict: Verdict) -> tuple[str, ...]:
    """The verdict's effects whose equation the model lacks, with the joint where they change the drive itself; one that
    frees parameters it has needs none."""
    present, springs = {effect["name"] for effect in arm.manifest["effects"]}, arm.effects.series_springs
    known = set(arm.parameters.described)
    lacking = [e for e in verdict.effects if set(e.parameters) - known]
    return tuple(
        sorted(
            {f"{e.name}@{e.joint}" for e in lacking if e.name in springs}
            | {e.name for e in lacking if e.name not in springs and e.name not in present}
        )
    )


def _read_causes(content: Mapping[str, Any], source: str, problems: list[str]) -> dict[tuple[str, int], Any]:
    """Parameters of every cause by effect and joint."""
    causes = content.get("causes", [])
    found: dict[tuple[str, int], Any] = {}
    if not isinstance(causes, list):
        problems.append(f"{source}, causes: found {show_value(causes)}, possible is a list of objects; diagnose again.")
        return found
    for k, cause in enumerate(causes):
        whole = isinstance(cause, Mapping) and isinstance(cause.get("effect"), str)
        if not whole or type(cause.get("joint")) is not int:
            problems.append(
                f"{source}, causes[{k}]: found {show_value(cause)}, possible is an object with effect and joint."
            )
        else:
            found[cause["effect"], cause["joint"]] = cause.get("parameters")
    return found


def _read_numbers(values: Any, where: str, suffix: str, problems: list[str]) -> dict[str, float]:
    """``{name: {value, …}}`` or ``{name: number}`` as numbers by the model's names."""
    if not isinstance(values, Mapping):
        problems.append(f"{where}: found {show_value(values)}, possible is an object of parameters.")
        return {}
    found = {}
    for name, entry in values.items():
        value = entry
        if isinstance(entry, Mapping):
            value = entry.get("value")
        if not isinstance(name, str) or not _PARAMETER_PATTERN.fullmatch(name):
            problems.append(f"{where}: {show_value(name)} is no name of a parameter.")
        elif isinstance(value, bool) or not isinstance(value, int | float) or not is_finite(value):
            problems.append(f"{where}, {name}: found {show_value(value)}, possible is a finite number; diagnose again.")
        else:
            found[name + suffix] = float(value)
    return found


def _read_deviations(parameters: Mapping[str, Any]) -> dict[str, tuple[float, float | None]]:
    """Standard deviations of the parameters that have one, after the log and before."""
    found = {}
    for name, entry in parameters.items():
        if not isinstance(entry, Mapping) or not _is_width(entry.get("std")):
            continue
        prior = entry.get("prior")
        if not _is_width(prior):
            prior = None
        found[name] = entry["std"], prior
    return found


def _is_width(value: Any) -> TypeGuard[float]:
    return not isinstance(value, bool) and isinstance(value, int | float) and is_finite(value) and value >= 0
