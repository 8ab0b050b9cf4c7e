"""Many effects of a verdict in few clauses: those of one kind with the same fault are said together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hdagen.diagnosis.report.effect_words import Fault, find_fault, name_joint, name_kind, say_effect


def say_many_effects(entries: Sequence[str], content: Mapping[str, Any]) -> list[str]:
    """Say what is wrong at many effects, without their sizes.

    Args:
        entries: effect@joint each, of the verdict.
        content: Of diagnosis.json.

    Returns:
        A clause for each kind of effect with each fault.

    """
    groups: dict[tuple[str, str], list[tuple[str, Fault | None]]] = {}
    for entry in entries:
        fault = find_fault(entry, content)
        alike = (entry, "")  # alone
        if fault is not None:
            alike = (entry.partition("@")[0], fault.words)
        groups.setdefault(alike, []).append((entry, fault))
    return [_say_group(group, content) for group in groups.values()]


def _say_group(group: Sequence[tuple[str, Fault | None]], content: Mapping[str, Any]) -> str:
    """The clause of effects of one kind."""
    entry, fault = group[0]
    if fault is None or len(group) == 1:
        return say_effect(entry, content, with_sizes=False)
    joints = content.get("joints", ())
    places = [name_joint(int(one.partition("@")[2]), joints) for one, _ in group]
    if not any(joints):
        places = [f"joints {places[0].removeprefix('joint ')}", *(one.removeprefix("joint ") for one in places[1:])]
    listed = f"{', '.join(places[:-1])} and {places[-1]}"
    times = [one.times for _, one in group if one is not None]
    return f"{name_kind(entry.partition('@')[0])} on {listed} is {fault.say(times)}"
