"""The numbers of a robot that a verdict changes, joint by joint, and the effects that no simulator's element holds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import ExportedNumber
from hdagen.model_export.joint_numbers import JointNumbers, RobotNumbers, list_unheld_effects
from hdagen.model_export.link_numbers import SPATIAL_AXES

_UNITS = {  # of a joint that turns; one that slides has m for rad and N for N m
    "armature": "kg m²",
    "damping": "N m s/rad",
    "quadratic_damping": "N m s²/rad²",
    "frictionloss": "N m",
    "gain": "N m per unit of input",
    "bias": "N m",
    "input_limit": "unit of input",
    "delay": "s",
    "lag": "s",
    "cable_stiffness": "N m/rad",
    "cable_rest": "rad",
    "sensor_delay": "s",
}
_SLIDING = {"kg m²": "kg", "N m s/rad": "N s/m", "N m s²/rad²": "N s²/m²", "N m": "N", "N m/rad": "N/m", "rad": "m"}
_SPRING_UNITS = {"linear": "N m/rad", "cubic": "N m/rad³", "damping": "N m s/rad", "play": "rad"}
_LEAST_RELATIVE_CHANGE = 1e-9


def list_number_changes(before: RobotNumbers, after: RobotNumbers) -> tuple[ExportedNumber, ...]:
    """List the numbers that differ.

    Args:
        before: The robot file's numbers.
        after: Those with the verdict.

    Returns:
        Each number with its place as ``joint.number``.

    """
    changes = []
    for axis, level, tilted in zip(SPATIAL_AXES, before.gravity, after.gravity, strict=True):
        if _differ(level, tilted):
            changes.append(ExportedNumber(f"gravity_{axis}", level, tilted, "m/s²"))
    if _differ(before.payload.mass, after.payload.mass):
        changes.append(ExportedNumber("payload", before.payload.mass, after.payload.mass, "kg"))
    for axis, level, moved in zip(SPATIAL_AXES, before.payload.center, after.payload.center, strict=True):
        if _differ(level, moved):
            changes.append(ExportedNumber(f"payload_{axis}", level, moved, "m"))
    for old, new in zip(before.joints, after.joints, strict=True):
        held = dict(_list_numbers(old, before.in_space))
        for key, (value, unit) in _list_numbers(new, after.in_space):
            earlier = held.get(key, (None, unit))[0]
            if earlier is None or _differ(earlier, value):
                stated = None if earlier is None or math.isinf(earlier) else earlier
                changes.append(ExportedNumber(f"{new.name}.{key}", stated, value, unit))
    return tuple(changes)


def describe_left_out(robot: CorrectedRobot, shares: Mapping[str, float] | None, simulator: str) -> dict[str, str]:
    """Describe the effects of the verdict that a simulator cannot hold.

    Args:
        robot: The robot.
        shares: The share of the closed gap that each leaves, as ``name@joint``; None where no proof measured it.
        simulator: The name of the simulator or format.

    Returns:
        A sentence for each, by ``name@joint``.

    """
    if robot.stated is None:
        return {}
    acting = {f"{name}@{joint}" for name, joint in list_unheld_effects(robot.corrected)}
    stated = [f"{effect.name}@{effect.joint}" for effect in robot.stated.effects]
    found = _read_shares(robot.content or {})
    sentences = {}
    for effect in (one for one in stated if one in acting):
        left = "its share of the gap is not known; export mjcf --prove LOG measures what it leaves"
        if shares is not None and effect in shares:
            left = f"it leaves {100 * shares[effect]:.0f} % of the gap that hdagen closes"
        elif shares is None and effect in found:
            left = (
                f"the diagnosis gives it {100 * found[effect]:.0f} % of the closed gap; "
                "export mjcf --prove LOG measures what it leaves"
            )
        sentences[effect] = f"{simulator} has no element for it, and {left}."
    return sentences


def _list_numbers(joint: JointNumbers, in_space: bool) -> Iterator[tuple[str, tuple[float, str]]]:
    """The numbers of a joint by name, each with its unit."""
    for key, value, unit in joint.body.list_numbers(in_space):
        yield key, (value, unit)
    for key, unit in _UNITS.items():
        yield key, (getattr(joint, key), _SLIDING.get(unit, unit) if joint.is_prismatic else unit)
    if joint.transmission:
        for key, unit in _SPRING_UNITS.items():
            yield f"torsion.{key}", (getattr(joint.transmission, key), unit)
    for stop in joint.soft_stops:
        side = "above" if stop.side > 0 else "below"
        yield f"contact_{side}", (stop.angle, "rad")
        yield f"contact_stiffness_{side}", (stop.stiffness, "N m/rad")


def _differ(old: float, new: float) -> bool:
    return old != new and not math.isclose(old, new, rel_tol=_LEAST_RELATIVE_CHANGE)


def _read_shares(content: Mapping[str, object]) -> dict[str, float]:
    """The shares of the verdict's effects in the closed gap, as diagnosis.json states them in the verdict's order."""
    verdict, where = content.get("verdict"), content.get("where")
    if not isinstance(verdict, list) or not isinstance(where, list):
        return {}
    shares = {}
    for effect, entry in zip(verdict, where, strict=False):
        share = entry.get("share") if isinstance(entry, Mapping) else None
        if isinstance(share, int | float) and not isinstance(share, bool):
            shares[str(effect)] = min(max(float(share), 0.0), 1.0)
    return shares
