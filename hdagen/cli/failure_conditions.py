"""`hdagen diagnose --fail-above GAP --fail-on EFFECT`: conditions that a diagnosis is to fail on, with a code of their
own."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

CONDITION_MET = 5  # exit code: 4 is an error that hdagen did not foresee
UNEXPLAINED = "unknown"  # of a gap that no effect explains


def add_failure_options(parser: argparse.ArgumentParser) -> None:
    """Add the options.

    Args:
        parser: The parser of `hdagen diagnose`.

    """
    parser.add_argument(
        "--fail-above",
        type=float,
        metavar="GAP",
        help=f"exit code {CONDITION_MET} if the robot file's gap on held-out motion is larger, in multiples of noise",
    )
    parser.add_argument(
        "--fail-on",
        action="append",
        default=[],
        metavar="EFFECT",
        help=f"exit code {CONDITION_MET} if the verdict names this effect, as name or name@joint; may be repeated",
    )


def check_failure_options(options: argparse.Namespace, robots: Iterable[str]) -> None:
    """Refuse conditions that can never be met, before anything is diagnosed.

    Args:
        options: The parsed arguments.
        robots: The robots that will be diagnosed, presets or robot files.

    Raises:
        PlantError: A gap is no positive number, no robot has an effect, or a model cannot be built.

    """
    from hdagen.arm.build_loader import PlantError

    problems = []
    gap = options.fail_above
    if gap is not None and not (math.isfinite(gap) and gap > 0.0):
        problems.append(f"--fail-above {gap:g}: possible is a positive number, in multiples of noise; give one.")
    if options.fail_on:
        joints = _find_joints_of_effects(robots)
        problems += filter(None, (_find_fault(given, joints) for given in options.fail_on))
    if problems:
        raise PlantError("\n".join(problems))


def _find_joints_of_effects(robots: Iterable[str]) -> dict[str, set[str]]:
    """The joints at which some robot can have each effect, by number and by name; joint 0 is the whole arm."""
    from hdagen.arm.compiled_arm import load
    from hdagen.arm.joint_names import list_joint_names

    found: dict[str, set[str]] = {}
    for robot in dict.fromkeys(robots):
        arm = load(robot, "native", ("all",))
        every = range(1, arm.n + 1)
        joints = {effect["name"]: effect["joints"] for effect in arm.manifest["effects"]}
        springs = arm.effects.series_springs  # "all" leaves these out
        names = ("", *list_joint_names(arm))
        for name, numbers in (joints | dict.fromkeys((*springs, UNEXPLAINED), every)).items():
            found.setdefault(name, set()).update(str(j) for j in numbers)
            found[name].update(str(names[j]) for j in numbers if names[j])
    return found


def _find_fault(given: str, joints: Mapping[str, set[str]]) -> str:
    """The sentence on an effect that no robot can have; empty where one can."""
    from hdagen.support.messages import join_nearest_names, make_printable, suggest_name

    name, _, joint = given.partition("@")
    if name not in joints:
        nearest = join_nearest_names([name], sorted(joints))
        meant = suggest_name(name, joints)
        return f"--fail-on {make_printable(given)}: no effect has this name{meant}; possible are {nearest}."
    possible = sorted(joints[name])
    if "@" in given and joint not in possible:
        return (
            f"--fail-on {make_printable(given)}: {name} does not act there; possible is {name} at"
            f" {', '.join(possible) or 'no joint of this robot'}; correct the joint, or leave @ and the joint out."
        )
    return ""


def find_met_conditions(options: argparse.Namespace, content: Mapping[str, Any]) -> Iterator[str]:
    """Find the conditions that a diagnosis meets.

    Args:
        options: The parsed arguments.
        content: The content of diagnosis.json.

    Yields:
        A sentence for each. A gap that could not be measured counts as too large: nothing says that it is small.

    """
    from hdagen.arm.joint_names import number_effect

    bound, gap = options.fail_above, content["gap"]["before"]
    if bound is not None and gap is None:
        yield f"--fail-above {bound:g}: the gap of the robot file could not be measured on held-out motion."
    elif bound is not None and gap > bound:
        yield f"--fail-above {bound:g}: the gap of the robot file on held-out motion is {gap:.4g} times the noise."
    for given in dict.fromkeys(options.fail_on):
        wanted = number_effect(given, content.get("joints", ()))
        named = [entry for entry in content["verdict"] if wanted in (entry, entry.partition("@")[0])]
        if named:
            yield f"--fail-on {given}: the verdict names {', '.join(named)}."
