"""Sentences on wrong numbers of the robot file: which, too small or too large, by how much, and which others strain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdagen.adoption.verdict import FACTOR
from hdagen.pages.quantity import format_number


def find_wrong_numbers(content: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Find the entries of the verdict that are numbers of the robot file.

    Args:
        content: of diagnosis.json.

    Returns:
        Their causes by effect@joint, in the order of the verdict.

    """
    causes = {f"{cause['effect']}@{cause['joint']}": cause for cause in content["causes"]}
    found = {entry: causes[entry] for entry in content["verdict"] if entry in causes}
    return {entry: cause for entry, cause in found.items() if FACTOR in cause["parameters"]}


def say_wrong_numbers(content: Mapping[str, Any]) -> str:
    """Say which numbers of the robot file are wrong, by how much.

    Args:
        content: of diagnosis.json.

    Returns:
        A clause without a full stop; empty where none is wrong.

    """
    said = "; ".join(say_factor(cause) for cause in find_wrong_numbers(content).values())
    if not said:
        return ""
    return f"The robot file is too sure of itself: {said}"


def say_factor(cause: Mapping[str, Any]) -> str:
    """Say of one number by how much it is too small or too large in the robot file.

    Args:
        cause: of diagnosis.json, with a factor.

    Returns:
        A clause.

    """
    unit = next(f" {estimate['unit']}" for name, estimate in cause["parameters"].items() if name != FACTOR)
    if unit == " 1":
        unit = ""
    factor, stated = (cause["parameters"][FACTOR][key] for key in ("value", "stated"))
    values = f"{format_number(stated, 3)}, and should be {format_number(factor * stated, 3)}{unit}"
    name = name_number(f"{cause['effect']}@{cause['joint']}") + _say_combination(cause)
    if factor <= 0.0:
        return f"{name} is wrong in it ({values})"
    if factor < 1.0:
        return f"{name} is too large in it by {format_number(1.0 / factor, 3)} times ({values})"
    return f"{name} is too small in it by {format_number(factor, 3)} times ({values})"


def name_number(entry: str) -> str:
    """Name a number of the robot file as people say it.

    Args:
        entry: effect@joint.

    """
    effect, _, joint = entry.partition("@")
    return f"{effect.replace('_', ' ')} of joint {joint}"


def _say_combination(cause: Mapping[str, Any]) -> str:
    """The other numbers from which the motion cannot part this one."""
    entry = f"{cause['effect']}@{cause['joint']}"
    others = [other for other in cause.get("combination", ()) if other != entry]
    if not others:
        return ""
    return f" (or {', '.join(map(name_number, others))}, which this motion does not part from it)"


def say_strained_numbers(content: Mapping[str, Any]) -> str:
    """Say which numbers the log presses against the limit of what the robot file claims.

    Args:
        content: of diagnosis.json.

    Returns:
        A sentence with a space before it; empty where none strains.

    """
    strained = content.get("method", {}).get("strained", ())
    if not strained:
        return ""
    named = ", ".join(
        name.rpartition("_")[0].replace("_", " ") + f" of joint {name.rpartition('_')[2]}" for name in strained
    )
    return (
        f" Further numbers strain against three of their tolerances ({named}): what is named beside them may stand in "
        "for them. State their sources or tolerances in the robot file and diagnose again."
    )
