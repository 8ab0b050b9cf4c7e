"""Words for joints, channels, effects and their sizes, as sentences and pages have them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hdagen.adoption.verdict import FACTOR
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.pages.quantity import Quantity, format_fixed, format_number, scale_quantity

JointNames = Sequence[str | None]
CHANNEL_UNITS = {"motor_position": "rad", "joint_position": "rad", "motor_current": "A", "motor_torque": "N m"}
COMMAND_GAIN = "torque_constant"  # the number of a robot file by which commands act
NAMES_OF_PEOPLE = ("coulomb", "stribeck")


@dataclass(frozen=True)
class SizeChange:
    """One number as the robot file has it and as it was found.

    Attributes:
        name: Of the parameter, without its joint.
        file: The robot file's number; None where the diagnosis does not say.
        value: As found.
        std: Its standard deviation, if it has one.
        unit: Of all three.

    """

    name: str
    file: float | None
    value: float
    std: float | None
    unit: str

    @property
    def ratio(self) -> float | None:
        """The found value over the file's number; None where the file has none."""
        if not self.file:
            return None
        return self.value / self.file


@dataclass(frozen=True)
class Fault:
    """What is wrong with a number of the robot file, or with an effect that the model lacks.

    Attributes:
        words: What follows "is".
        times: By how many times the number is wrong; None where the words say it, or nothing says how much.

    """

    words: str
    times: float | None = None

    def say(self, times: Sequence[float | None]) -> str:
        """Say the fault, with its sizes.

        Args:
            times: By how many times each of the numbers that have it is wrong.

        Returns:
            The words that follow "is".

        """
        told = [format_number(one, 2) for one in sorted(one for one in times if one is not None)]
        if not told:
            return self.words
        return f"{self.words} by {' to '.join(dict.fromkeys((told[0], told[-1])))} times"


def name_joint(joint: int, joints: JointNames = ()) -> str:
    """Name a joint: by its name and number, or by its number where it has no name.

    Args:
        joint: The number, 0 being the whole arm.
        joints: Names of the joints, None where one has no name.

    Returns:
        The words.

    """
    if joint == 0:
        return "the whole arm"
    name = None
    if joint <= len(joints):
        name = joints[joint - 1]
    if name:
        return f"{name} ({joint})"
    return f"joint {joint}"


def name_effect(entry: str, joints: JointNames = ()) -> str:
    """Name an effect as people say it, without the prefix "missing".

    Args:
        entry: effect@joint, joint 0 being the whole arm.
        joints: Names of the joints, None where one has no name.

    Returns:
        The name with its place.

    """
    effect, _, joint = entry.partition("@")
    at = "on"
    if joint == "0":
        at = "of"
    return f"{name_kind(effect)} {at} {name_joint(int(joint), joints)}"


def name_kind(effect: str) -> str:
    """Name an effect without its joint, people's names with a capital.

    Args:
        effect: Its name in the model.

    Returns:
        The words.

    """
    words = effect.removeprefix("missing_").replace("_dependent", "-dependent").split("_")
    return " ".join(word.capitalize() if word in NAMES_OF_PEOPLE else word for word in words)


def join_effects(entries: Iterable[str], joints: JointNames = ()) -> str:
    """Name several effects in a row.

    Args:
        entries: effect@joint each.
        joints: Names of the joints, None where one has no name.

    Returns:
        The words.

    """
    by_kind: dict[str, list[int]] = {}
    for entry in entries:
        effect, _, joint = entry.partition("@")
        by_kind.setdefault(effect, []).append(int(joint))
    said = []
    for effect, numbers in by_kind.items():
        if len(numbers) > 1 and not any(joints) and 0 not in numbers:
            listed = " and ".join(map(str, sorted(numbers)))
            said.append(f"{name_kind(effect)} on joints {listed}")
        else:
            said += [name_effect(f"{effect}@{joint}", joints) for joint in numbers]
    return " and ".join(said)


def name_channel(name: str, joints: JointNames = ()) -> str:
    """Name a channel of a log.

    Args:
        name: Of its column, as motor_position_2.
        joints: Names of the joints, None where one has no name.

    Returns:
        The words, as "motor position of joint 2".

    """
    quantity, _, number = name.rpartition("_")
    if not quantity or not number.isdigit():
        return name.replace("_", " ")
    return f"{quantity.replace('_', ' ')} of {name_joint(int(number), joints)}"


def find_channel_unit(name: str, channel: Mapping[str, Any]) -> str:
    """Return the unit of a channel, of diagnosis.json or by its name.

    Args:
        name: Of its column.
        channel: Its entry in `gap.by_channel`.

    """
    return str(channel.get("unit") or CHANNEL_UNITS.get(name.rpartition("_")[0], ""))


def format_values(values: Sequence[float], unit: str, digits: int = REPORT.value_digits) -> tuple[list[str], str]:
    """Format values of one quantity with one prefix of their unit.

    Args:
        values: In the unit.
        unit: Without a prefix; "1" and "" stand for none.
        digits: Significant digits.

    Returns:
        The values as texts, and the unit with its prefix.

    """
    sizes = [abs(v) for v in values if math.isfinite(v) and v] or [0.0]
    told = min(sizes)
    if max(sizes) > REPORT.largest_shared_ratio * told:
        told = max(sizes)
    scaled = _scale_unit(unit, told)
    if max(sizes) * scaled.factor >= REPORT.largest_shared_ratio:
        scaled = _scale_unit(unit, max(sizes))
    return [format_number(float(f"{v * scaled.factor:.{digits}g}"), digits) for v in values], scaled.unit


def format_change(before: float, after: float, unit: str, between: str = " → ") -> str:
    """Format two values of one quantity with one prefix of their unit: of two far apart, the one between theirs.

    Args:
        before: The first value.
        after: The second value.
        unit: Of both, without a prefix.
        between: What stands between them.

    Returns:
        The text.

    """
    sizes = sorted((abs(before), abs(after)))
    if sizes[0]:
        scaled = _scale_unit(unit, math.sqrt(sizes[0] * sizes[1]))
        are_short = all(0.1 <= size * scaled.factor < 1000.0 for size in sizes)
        if are_short or sizes[1] > REPORT.largest_shared_ratio * sizes[0]:
            texts = [format_number(value * scaled.factor, REPORT.value_digits) for value in (before, after)]
            return f"{texts[0]}{between}{texts[1]} {scaled.unit}".rstrip()
    (first, second), written = format_values([before, after], unit)
    return f"{first}{between}{second} {written}".rstrip()


def format_estimate(change: SizeChange) -> tuple[str, str, str, str]:
    """Format a number of the file, its estimate, and their unit, to digits that its standard deviation bears.

    Args:
        change: The number.

    Returns:
        The file's number, the value, its standard deviation ("" where there is none), and the unit with its prefix.

    """
    scaled = _scale_unit(change.unit, max(abs(change.value), abs(change.file or 0.0)))
    file = "–"
    if change.file is not None:
        file = format_number(change.file * scaled.factor, 4)
    value = change.value * scaled.factor
    if not change.std or value == 0:
        return file, format_number(value, REPORT.value_digits), "", scaled.unit
    std = change.std * scaled.factor
    decimals = max(1 - math.floor(math.log10(std)), 0)
    if decimals + math.floor(math.log10(abs(value))) < REPORT.most_digits:
        return file, format_fixed(value, decimals), format_fixed(std, decimals), scaled.unit
    return file, format_number(value, REPORT.most_digits), format_number(std, 2), scaled.unit


def _scale_unit(unit: str, largest: float) -> Quantity:
    """The unit with the prefix that suits a number; "1" and "" stand for none."""
    if unit in ("1", ""):
        return scale_quantity("x", largest)
    return scale_quantity(f"x ({unit})", largest)


def list_sizes(cause: Mapping[str, Any]) -> list[SizeChange]:
    """List the sizes of an effect; what only shapes it is left out, and so is what the log says nothing of.

    Args:
        cause: Of diagnosis.json.

    Returns:
        Its amplitudes; the sine and the cosine of one as one amplitude.

    """
    every = [
        SizeChange(name, one.get("file"), one["value"], one["std"], one["unit"])
        for name, one in cause["parameters"].items()
        if name != FACTOR
    ]
    if FACTOR in cause["parameters"] and len(every) == 1:
        return [_size_number(every[0], cause["parameters"][FACTOR])]
    sizes = [one for one in every if one.std is not None and one.value != one.file] or every[:1]
    by_name = {one.name: one for one in sizes}
    found = []
    for one in sizes:
        stem = one.name.removesuffix("_sine").removesuffix("_cosine")
        sine, cosine = by_name.get(f"{stem}_sine"), by_name.get(f"{stem}_cosine")
        if sine is None or cosine is None or sine.file or cosine.file:
            found.append(one)
        elif one is sine:
            spread = math.hypot(sine.std or 0.0, cosine.std or 0.0)
            size = math.hypot(sine.value, cosine.value)
            found.append(SizeChange(f"{stem}_amplitude", None, size, spread or None, one.unit))
    return found


def _size_number(change: SizeChange, factor: Mapping[str, Any]) -> SizeChange:
    """The number that the robot file states, as the factor has it: an inertia may be lumped there."""
    std = None
    if factor["std"] is not None:
        std = factor["std"] * abs(factor["file"])
    return SizeChange(change.name, factor["file"], factor["value"] * factor["file"], std, change.unit)


def say_effect(entry: str, content: Mapping[str, Any], *, with_sizes: bool = True) -> str:
    """Say what is wrong at an effect: too small or too large in the file, by how much, or missing in the model.

    Args:
        entry: effect@joint, of the verdict.
        content: Of diagnosis.json.
        with_sizes: Whether the numbers of file and log follow in brackets.

    Returns:
        A clause.

    """
    joints = content.get("joints", ())
    joint = int(entry.partition("@")[2])
    sizes = list_sizes(_find_cause(entry, content))
    numbers = _say_sizes(sizes) if with_sizes else ""
    fault = find_fault(entry, content)
    if fault is None:
        ratio = sizes[0].value / (sizes[0].file or math.nan)
        times = f"{format_number(ratio, REPORT.value_digits)} times as strongly as the file says"
        return f"commands act on {name_joint(joint, joints)} {times}{numbers}"
    return f"{name_effect(entry, joints)} is {fault.say([fault.times])}{numbers}"


def find_fault(entry: str, content: Mapping[str, Any]) -> Fault | None:
    """Find what is wrong at an effect.

    Args:
        entry: effect@joint, of the verdict.
        content: Of diagnosis.json.

    Returns:
        The fault; None where commands act more or less strongly than the file says.

    """
    cause = _find_cause(entry, content)
    sizes = list_sizes(cause)
    if FACTOR in cause["parameters"] and len(sizes) > 1:
        return Fault("wrong in the file")
    if len(sizes) != 1 or sizes[0].ratio is None:
        return Fault("missing in the model")
    if sizes[0].name == COMMAND_GAIN and not _logs_current(content):
        return None
    return _judge_ratio(sizes[0].ratio)


def _find_cause(entry: str, content: Mapping[str, Any]) -> Mapping[str, Any]:
    """The entry of `causes` in diagnosis.json; one without parameters where there is none."""
    effect, _, joint = entry.partition("@")
    causes: list[Mapping[str, Any]] = [*content["causes"], {"effect": effect, "joint": joint, "parameters": {}}]
    return next(one for one in causes if (one["effect"], str(one["joint"])) == (effect, joint))


def _logs_current(content: Mapping[str, Any]) -> bool:
    """Whether the log has currents: without them a torque per ampere is a gain of commands."""
    return not any(name.startswith("motor_torque") for name in content.get("data", {}).get("channels", {}))


def _judge_ratio(ratio: float) -> Fault:
    """The fault of a number by the found value over the file's."""
    if ratio < -REPORT.least_file_share:
        return Fault("of the other sign in the file")
    if ratio < REPORT.least_file_share:
        return Fault("in the file, and the log has hardly any of it")
    if ratio >= REPORT.least_told_ratio:
        return Fault("too small in the file", ratio)
    if ratio <= 1 / REPORT.least_told_ratio:
        return Fault("too large in the file", 1 / ratio)
    if ratio >= 1:
        return Fault(f"too small in the file by {100 * (ratio - 1):.2g} %")
    return Fault(f"too large in the file by {100 * (1 - ratio):.2g} %")


def _say_sizes(sizes: Sequence[SizeChange]) -> str:
    """The numbers of an effect in brackets: in the file and found, with unit."""
    said = []
    for one in sizes[: REPORT.most_named_sizes]:
        file, value, std, unit = format_estimate(one)
        found = f"{value} ± {std}" if std else value
        words = "found"
        if len(sizes) > 1:
            words = one.name.replace("_", " ")
        if one.file:
            words = f"file {file}, {words}"
        said.append(f"{words} {found} {unit}".rstrip())
    if not said:
        return ""
    return f" ({'; '.join(said)})"
