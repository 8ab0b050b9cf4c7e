"""Sentences on numbers of the robot file: they claim too much, cannot be parted, or strain against their tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdagen.adoption.verdict import FACTOR, MOST_TOLERANCES
from hdagen.diagnosis.report.effect_words import join_effects, name_joint


def say_overconfidence(content: Mapping[str, Any]) -> str:
    """Say that the robot file claims to know numbers better than it does, where one is off by many tolerances.

    Args:
        content: of diagnosis.json.

    Returns:
        A sentence with a space behind it; empty where no number is.

    """
    factors = [cause["parameters"].get(FACTOR) for cause in _find_named_causes(content)]
    if not any(one and abs(one["value"] - 1.0) > MOST_TOLERANCES * one["prior"] for one in factors):
        return ""
    return "The robot file is too sure of itself. "


def say_combinations(content: Mapping[str, Any]) -> str:
    """Say which numbers stand for others that the motion cannot part from them.

    Args:
        content: of diagnosis.json.

    Returns:
        Sentences; empty where there are none.

    """
    joints, said = content.get("joints", ()), []
    for cause in _find_named_causes(content):
        entry = f"{cause['effect']}@{cause['joint']}"
        others = [other for other in cause.get("combination", ()) if other != entry]
        if others:
            named = join_effects(others, joints)
            said.append(f"This motion does not part {join_effects([entry], joints)} from {named}.")
    return " ".join(said)


def say_strained_numbers(content: Mapping[str, Any]) -> str:
    """Say which numbers the log presses against the limit of what the robot file claims.

    Args:
        content: of diagnosis.json.

    Returns:
        Two sentences; empty where none strains.

    """
    strained = content.get("method", {}).get("strained", ())
    if not strained:
        return ""
    joints, named = content.get("joints", ()), []
    for parameter in strained:
        key, _, joint = parameter.rpartition("_")
        if joint.isdigit():
            named.append(f"{key.replace('_', ' ')} of {name_joint(int(joint), joints)}")
        else:
            named.append(parameter.replace("_", " "))
    return (
        f"Numbers strain against {MOST_TOLERANCES:g} times their tolerance ({', '.join(named)}), and an effect may "
        "stand in for them. State their source or tolerance in the robot file, and diagnose again."
    )


def _find_named_causes(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The causes of the verdict's entries."""
    return [cause for cause in content["causes"] if f"{cause['effect']}@{cause['joint']}" in content["verdict"]]
