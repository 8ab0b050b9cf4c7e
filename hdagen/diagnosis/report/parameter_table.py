"""The numbers of a verdict: in the robot file, found, and their change; in short for the first screen, and in full."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from hdagen.adoption.verdict import FACTOR, is_uninformed
from hdagen.arm.arm_parameters import Parameter, Parameters
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.report.effect_words import (
    JointNames,
    SizeChange,
    format_estimate,
    name_joint,
    name_kind,
)
from hdagen.diagnosis.report.gap_words import list_named_effects
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.pages import frame
from hdagen.pages.number_table import draw_table
from hdagen.pages.page import Section
from hdagen.pages.quantity import MINUS_SIGN, format_number

SHORT_COLUMNS = ("parameter", "file", "found ±", "change", "unit")


@dataclass(frozen=True)
class FoundNumber:
    """One number that was estimated.

    Attributes:
        change: its name, the file's number, and the estimate.
        joint: its joint, 0 for the whole arm.
        described: as the model describes it; None where it does not know it.
        prior: standard deviation before the log; None where it is not known.
        end: the end of its range that it stands at, if any.
        is_of_effect: whether it belongs to an effect that the verdict names.

    """

    change: SizeChange
    joint: int
    described: Parameter | None
    prior: float | None
    end: str | None
    is_of_effect: bool

    @property
    def moved(self) -> float:
        """The difference from the file's number."""
        return self.change.value - (self.change.file or 0.0)

    @property
    def is_uninformed(self) -> bool:
        """Whether the log said nothing of it."""
        return bool(self.change.std and self.prior and is_uninformed(self.moved, self.change.std, self.prior))

    @property
    def moved_share(self) -> float:
        """How far it moved, in standard deviations before the log."""
        if not self.prior:
            return 0.0
        return abs(self.moved) / self.prior


def draw_changed_numbers(content: Mapping[str, Any], parameters: Parameters) -> str:
    """Draw the table of the first screen: the numbers of the named effects, and refitted ones that moved far.

    Args:
        content: of diagnosis.json.
        parameters: of the model that was diagnosed.

    Returns:
        Markup of the table; "" where there is nothing to list.

    """
    every, joints = list(list_found_numbers(content, parameters)), content.get("joints", ())
    base = [one for one in every if not one.is_of_effect and one.moved_share >= REPORT.notable_move]
    base = sorted(base, key=lambda one: -one.moved_share)[: REPORT.most_first_base_numbers]
    shown = [*(one for one in every if one.is_of_effect), *base]
    if not shown:
        return ""
    return frame.build_rows_table(SHORT_COLUMNS, [_write_short_row(one, joints) for one in shown])


def list_found_numbers(content: Mapping[str, Any], parameters: Parameters) -> Iterator[FoundNumber]:
    """List what was estimated: the numbers of the named effects, then those of the file.

    Args:
        content: of diagnosis.json.
        parameters: of the model that was diagnosed.

    Yields:
        The numbers.

    """
    named = list_named_effects(content)
    for cause in content["causes"]:
        if f"{cause['effect']}@{cause['joint']}" in named:
            suffix = f"_{cause['joint']}" if cause["joint"] else ""
            for name, one in ((name, one) for name, one in cause["parameters"].items() if name != FACTOR):
                yield _read_number(parameters, name + suffix, one, is_of_effect=True)
    for name, one in content["parameters"].items():
        yield _read_number(parameters, name, one, is_of_effect=False)


def _read_number(parameters: Parameters, name: str, estimate: Mapping[str, Any], *, is_of_effect: bool) -> FoundNumber:
    q = parameters.described.get(name)
    joint, file, prior = 0, estimate.get("file"), None
    if q is not None:
        joint = q.joint
        if file is None and q.role == "base":  # a diagnosis from before it said so
            file = q.nominal
        prior = estimate.get("prior") or q.deviation or q.typical
    change = SizeChange(
        name.removesuffix(f"_{joint}"), file, estimate["value"], estimate.get("std"), estimate.get("unit", "")
    )
    return FoundNumber(change, joint, q, prior or None, estimate.get("end"), is_of_effect)


def _name_number(one: FoundNumber, joints: JointNames) -> str:
    words = name_kind(one.change.name)
    if one.joint:
        return f"{words}, {name_joint(one.joint, joints)}"
    return words


def _write_short_row(one: FoundNumber, joints: JointNames) -> list[str]:
    file, value, std, unit = format_estimate(one.change)
    return [_name_number(one, joints), file, f"{value} ± {std}" if std else value, _say_change(one), unit or "–"]


def _say_change(one: FoundNumber) -> str:
    """The change from the file's number: a factor, a share, or that it is new."""
    ratio = one.change.ratio
    if ratio is None:
        return "new" if one.change.value and one.is_of_effect else "–"
    if ratio <= 0 or one.change.file is None:
        return "other sign" if ratio < 0 else "none found"
    if ratio >= REPORT.least_told_ratio:
        return f"× {format_number(ratio, 2)}"
    if ratio <= 1 / REPORT.least_told_ratio:
        return f"÷ {format_number(1 / ratio, 2)}"
    percent = 100 * (ratio - 1)
    if abs(percent) < 0.05:
        return "0 %"
    return f"{'+' if percent > 0 else MINUS_SIGN}{format_number(abs(percent), 2)} %"


def show_parameters(content: Mapping[str, Any], parameters: Parameters) -> Section:
    """Show every number that was estimated, with what the log said of it.

    Args:
        content: of diagnosis.json.
        parameters: of the model that was diagnosed.

    Returns:
        The section of the page.

    """
    joints = content.get("joints", ())
    every = list(list_found_numbers(content, parameters))
    silent = [_name_number(one, joints) for one in every if one.is_uninformed and not one.is_of_effect]
    rows = [_write_full_row(one, joints) for one in every if one.is_of_effect or not one.is_uninformed]
    text = (
        "As refitted with the verdict, its effects first. The tolerance is that of the robot file; of an effect it is "
        "the usual size."
    )
    if silent:
        text += f" The log says nothing of these, which keep the file's number: {'; '.join(silent)}."
    columns = ["parameter", "file ±", "found ±", "change", "unit", "the log says"]
    return Section("Parameters", text, [draw_table("Refitted numbers", columns, rows, sentences=columns[-1:])])


def _write_full_row(one: FoundNumber, joints: JointNames) -> list[str | float | None]:
    name, file, found, change, unit = _write_short_row(one, joints)
    if one.prior is not None:
        known = one.change.file or one.change.value or one.prior
        *_, width, written = format_estimate(
            SizeChange("", known, one.change.value or known, one.prior, one.change.unit)
        )
        file = f"{file} ± {width}" if unit in (written, "–") else file
    return [name, file, found, change, unit, _say_informed(one)]


def _say_informed(one: FoundNumber) -> str:
    """How much the log says of a number, by its standard deviation after and before."""
    said = "–"
    if one.change.std is None:
        said = "a shape, or read off"
    elif one.prior:
        said = "a little"
        if one.change.std / one.prior < DECISION.informative_std_ratio:
            said = "much"
        elif one.is_uninformed:
            said = "nothing"
    if one.end:
        said += "; at the end of its range"
    return said
