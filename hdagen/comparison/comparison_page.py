"""The page of two diagnoses side by side."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from hdagen.comparison.diagnosis_comparison import INTERVAL_DEVIATIONS, DiagnosisComparison
from hdagen.diagnosis.report.effect_words import join_effects, name_effect
from hdagen.pages import figure, page
from hdagen.pages.number_table import TableCell
from hdagen.pages.result_table import ResultTable

SIDE_COLORS = ("orange", "blue")  # of the first diagnosis and of the second


def write_comparison_page(path: Path, comparison: DiagnosisComparison) -> None:
    """Write the page, whole or not at all.

    Args:
        path: Where the page goes.
        comparison: The two diagnoses.

    Raises:
        OSError: The page cannot be written.

    """
    first, second = comparison.labels
    sections = [
        _build_overview_section(comparison),
        _build_effects_section(comparison),
        _build_parameters_section(comparison),
    ]
    command = f"    hdagen compare {first} {second} --out {path.name}"
    page.write_page(path, "Two diagnoses side by side", comparison.sentence, sections, command)


def _build_overview_section(comparison: DiagnosisComparison) -> page.Section:
    content = comparison.to_dict()
    sides = content["first"], content["second"]
    rows: list[list[TableCell]] = [
        ["file", *(side["source"] for side in sides)],
        ["robot", *(_show_text(side["robot"]) for side in sides)],
        ["logs", *(_show_text(side["log"]) for side in sides)],
        ["verdict", *(join_effects(side["verdict"], comparison.joints) or "no effect" for side in sides)],
        ["sure", *(side["sure"] for side in sides)],
    ]
    gaps = comparison.table()
    rows += [[f"gap, {name}", *values] for name, *values in zip(*gaps.columns.values(), strict=True)]
    columns = ("", "first", "second")
    table = figure.draw_table("Both diagnoses", columns, rows, digits=3, sentences=columns[1:])
    text = "\n\n".join(["Gaps are replay errors on held-out motion, in multiples of the noise.", *comparison.notes])
    return page.Section("What each says", text, [table])


def _build_effects_section(comparison: DiagnosisComparison) -> page.Section:
    pairs = comparison.effects
    if not pairs:
        return page.Section("Effects", "Neither diagnosis finds any effect possible.")
    chances = [[pair.first_probability for pair in pairs], [pair.second_probability for pair in pairs]]
    groups = [
        figure.DotGroup(label, np.array([math.nan if value is None else value for value in values]), color=color)
        for label, values, color in zip(("first", "second"), chances, SIDE_COLORS, strict=True)
    ]
    dots = figure.draw_dots(
        "Probability of being present",
        [name_effect(pair.effect, comparison.joints) for pair in pairs],
        groups,
        value_label="probability",
        caption="Without a dot: not tried.",
    )
    return page.Section(
        "Effects",
        "Each effect's probability of being present, alone or with others.",
        [dots, _draw_result_table(comparison.tabulate_effects())],
    )


def _build_parameters_section(comparison: DiagnosisComparison) -> page.Section:
    pairs = comparison.parameters
    if not pairs:
        return page.Section("Parameters", "Neither diagnosis has parameters.")
    figures = []
    known = [(pair.name, pair.deviations) for pair in pairs if pair.deviations is not None]
    finite = [(name, value) for name, value in known if math.isfinite(value)]
    if finite:
        figures.append(
            figure.draw_dots(
                "Difference of both estimates",
                [name for name, _ in finite],
                [figure.DotGroup("second minus first", np.array([value for _, value in finite]), color="blue")],
                value_label="difference (standard deviations)",
                levels=[(-INTERVAL_DEVIATIONS, "−95 %"), (INTERVAL_DEVIATIONS, "95 %")],
                caption="Within the two lines the estimates agree.",
            )
        )
    figures.append(_draw_result_table(comparison.tabulate_parameters()))
    text = (
        "Two estimates agree if their difference is within its 95 % interval. A value without a standard deviation was "
        "read off, or is a shape that is not estimated; it is listed and not judged."
    )
    return page.Section("Parameters", text, figures)


def _draw_result_table(table: ResultTable) -> str:
    rows = [list(cells) for cells in zip(*table.columns.values(), strict=True)]
    return figure.draw_table(table.title, list(table.columns), rows)


def _show_text(value: object) -> str | None:
    return value if isinstance(value, str) else None
