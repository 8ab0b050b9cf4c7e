"""The page of a check: rates of right verdicts, their confidence, and which effects were confused."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

import numpy as np

from hdagen.blind.blind_report import Report, describe_host, figures_by_effect
from hdagen.blind.confidence_intervals import finite_or_none
from hdagen.blind.labels import FIGURE_LABELS, describe_population, format_figure
from hdagen.blind.realities.effect_places import EFFECT_PLACES
from hdagen.blind.realities.population import DRIVETRAIN, FRICTION_KIND, JOINT, MAXWELL, MODEL
from hdagen.blind.required_rates import Bar
from hdagen.blind.score_summary import (
    accuracy_by_coverage,
    bin_by_confidence,
    closed_share,
    count_confusions,
    select_single,
)
from hdagen.blind.scores import Row
from hdagen.blind.sealed_check import Check
from hdagen.pages import figure, page
from hdagen.pages.number_table import TableCell
from hdagen.support.version import __version__

LEADING_FIGURES = {
    "none": "false_alarm",
    "unknown": "unknown_found_at_joint",
    "unknown+one": "both_said",
    "pair": "pair_f1",
    "rough": "numbers_right",
    FRICTION_KIND: "named",
}
ARMS_TEXT = (
    "MuJoCo moves rotors and links, with its own dry friction, walls and current filter; hand-coded drives join them. "
    "The robot file states other parameters than the true ones, by 4 % standard deviation, and none of the effects."
)
MAXWELL_TEXT = (
    "Lagrange's equations and Moreau's midpoint rule move two-joint arms in steps of 20 µs; drives have Maxwell slip, "
    "Dahl's hysteresis and set-valued friction, and a loop inside. Currents have coloured noise, stamps are off, and "
    "rows are lost. The robot file states other parameters than the true ones, by 4 % standard deviation, and none of "
    "the effects."
)
CHAIN_TEXT = (
    "MuJoCo moves one to three joints under gravity, rigid or with springs, of which a log has angle and effort. "
    "Efforts have coloured noise, stamps are off, and rows are lost. The robot file states other parameters than the "
    "true ones, by 4 % standard deviation, and none of the effects."
)
MODEL_TEXT = (
    "MuJoCo moves the links of a model in space, of which a log has angle and effort. The model states masses, centres "
    "and inertias that differ from the true ones by 3 % standard deviation, and not the effect."
)
ROUGH_TEXT = " Some of its numbers are wrong by far more than that."
JOINTS_TEXT = (
    "MuJoCo moves one or two rigid joints with dry friction, and beside it friction that grows with the speed, in most "
    "not quite linearly, and up to a tenth of it that has no name. The robot file states other parameters than the "
    "true ones, by 2 to 4 % standard deviation, and no friction, or half of it."
)
CASE_COLUMNS = (
    "case", "truth", "size", "snr", "verdict", "beside it", "p of truth", "gap before", "after", "closed (%)",
)  # fmt: skip
NB = "\N{NO-BREAK SPACE}"


def write_page(path: Path, report: Report) -> None:
    """Write the page of a check, whole or not at all.

    Args:
        path: the HTML file.
        report: the report of the check.

    Raises:
        OSError: the file cannot be written.

    """
    sections = [_figures_section(report)]
    if select_single(report.rows):
        sections += [_reliability_section(report), _effects_section(report)]
    sections += [_confusion_section(report), _gap_section(report)]
    if report.lines:
        sections.append(_parameters_section(report))
    sections.append(_cases_section(report))
    title = f"Blind check: {describe_population(report.asked.population)}"
    page.write_page(path, title, summarize_check(report), sections, _describe_reproduction(report))


def summarize_check(report: Report) -> str:
    """Sum up a check in one sentence.

    Args:
        report: the report of the check.

    Returns:
        The leading figure of the check's kind, and the bars that were missed.

    """
    lead = LEADING_FIGURES.get(report.asked.kind, "effect")
    words = f"{FIGURE_LABELS[lead][0].upper()}{FIGURE_LABELS[lead][1:]}"
    missed = [FIGURE_LABELS[bar.figure] for bar, _, met in report.bars if not met]
    bars = "every bar is met"
    if missed:
        bars = f"missed: {', '.join(missed)}"
    if lead not in report.summary:
        return f"No case of {report.asked.count} could be judged; {bars}."
    found = report.summary[lead]
    return f"{words}: {format_figure(lead, found)}, of {found.count} cases whose labels were sealed; {bars}."


def _figures_section(report: Report) -> page.Section:
    bars = {bar.figure: _bar_cells(bar, met) for bar, _, met in report.bars}
    rows: list[list[TableCell]] = []
    for name, words in FIGURE_LABELS.items():
        if name in report.summary:
            found = report.summary[name]
            rows.append([words, found.value, found.low, found.high, found.count, *bars.get(name, ("", ""))])
    table = figure.draw_table(
        "Figures",
        ("", "value", "from", "to", "cases", "bar", ""),
        rows,
        digits=3,
        caption="From and to: 95 % interval (Wilson's for shares, normal for means, order statistics for medians). A "
        "case without a diagnosis counts as wrong.",
    )
    texts = {DRIVETRAIN: ARMS_TEXT, MAXWELL: MAXWELL_TEXT, JOINT: CHAIN_TEXT, MODEL: MODEL_TEXT}
    made = texts[report.asked.population.family]
    if report.asked.kind == FRICTION_KIND:
        made = JOINTS_TEXT
    if report.asked.kind == "rough":
        made += ROUGH_TEXT
    text = (
        f"Each case is a reality that another simulator made: {made} The labels were sealed by a hash before the first "
        "diagnosis; each diagnosis ran as a process of its own that had a robot file, a log and nothing else; the seal "
        "was opened after the last."
    )
    return page.Section("How often right", text, [table])


def _bar_cells(bar: Bar, met: bool) -> tuple[str, str]:
    """A bar's limit, and whether it was met, as cells of the table."""
    sign = "≤" if bar.most else "≥"
    outcome = "met" if met else "missed"
    return f"{sign} {bar.value:g}", outcome


def _reliability_section(report: Report) -> page.Section:
    rows = select_single(report.rows)
    parts = bin_by_confidence(rows)
    x = [point.value for point, _ in parts]
    y = [right.value for _, right in parts]
    curves = [
        figure.Curve("perfect", [0.0, 1.0], [0.0, 1.0], color="grey", dash="dotted", width=1.2),
        figure.Curve("reached", x, y, color="blue", draw="points", width=2.4),
    ]
    for point, right in parts:
        curves.append(
            figure.Curve("", [point.value] * 2, [right.low, right.high], color="blue", dash="solid", width=1.2)
        )
    diagram = figure.draw_plane(
        "Reliability",
        curves,
        x_label="probability that was said",
        y_label="share that was right",
        caption="A point for each tenth of confidence that occurs, with its 95 % interval; "
        + ", ".join(f"{right.count} at {point.value:.2f}" for point, right in parts)
        + ".",
    )
    share, right_so_far = accuracy_by_coverage(rows)
    covered = figure.draw_lines(
        "Accuracy against coverage",
        share,
        [figure.Series("right among those answered", right_so_far, "blue", "solid", draw="step")],
        x_label="share of cases answered, surest first",
        y_label="share right",
        caption="What would be right if only the surest cases were answered.",
    )
    text = "Whether a probability of 0.9 is right nine times in ten, and what it costs to answer only where sure."
    return page.Section("How sure", text, [diagram, covered])


def _effects_section(report: Report) -> page.Section:
    rows: list[list[TableCell]] = []
    for name, found in figures_by_effect(report.rows).items():
        right = found["effect"]
        low, high = 100 * right.low, 100 * right.high
        rows.append(
            [
                name.replace("_", " "),
                right.count,
                100 * right.value,
                f"{low:.0f} to {high:.0f}",
                100 * found["joint"].value,
                100 * found["place"].value,
                found["p_truth"].value,
                found["snr"].value,
            ]
        )
    columns = ("effect", "cases", "right (%)", "95 % interval", "joint (%)", "place (%)", "p of truth", "snr")
    caption = "snr: how far the effect moves the channel that shows it best, rms, in multiples of its noise; median."
    return page.Section("By effect", "", [figure.draw_table("By effect", columns, rows, digits=3, caption=caption)])


def _confusion_section(report: Report) -> page.Section:
    counts = count_confusions(report.rows)
    if not counts:
        return page.Section("What was taken for what", "Cases of several effects stand in the table of all cases.")
    order = [*EFFECT_PLACES, "unknown", "none", "several", "failed"]
    truths = sorted(counts, key=order.index)
    names = {one for line in counts.values() for one in line}
    # effects that a diagnosis names beyond the table of effects stand at the end
    verdicts = [one for one in order if one in names] + sorted(names - set(order))
    grid = [[counts[true].get(one, math.nan) for one in verdicts] for true in truths]
    number = {one: str(at) for at, one in enumerate(dict.fromkeys([*truths, *verdicts]), 1)}
    drawn = figure.draw_heat_map(
        "Confusion",
        [number[one] for one in verdicts],
        [f"{one.replace('_', ' ')} {number[one]}" for one in truths],
        grid,
        x_label="verdict, by the number of its row",
        y_label="truth",
        value_label="cases",
        caption="Asymmetric friction and a bias of the current are the same but near standstill and count as one. "
        + "; ".join(f"{number[one]}: {one.replace('_', ' ')}" for one in verdicts if one not in truths),
    )
    mistakes: list[list[TableCell]] = [
        [true.replace("_", " "), one.replace("_", " "), count]
        for true in truths
        for one, count in sorted(counts[true].items(), key=lambda item: -item[1])
        if one != true
    ]
    parts = [drawn]
    if mistakes:
        parts.append(figure.draw_table("Taken for something else", ("truth", "verdict", "cases"), mistakes))
    return page.Section("What was taken for what", "", parts)


def _gap_section(report: Report) -> page.Section:
    known = [row for row in report.rows if row.has_gap]
    if not known:
        return page.Section("How far the gap shrinks", "No case has a gap before and after.")
    before, after = np.array([row.before for row in known]), np.array([row.after for row in known])
    ends = np.array([min(before.min(), after.min(), 1.0), max(before.max(), after.max())])
    right = np.array([row.is_right for row in known])
    curves = [figure.Curve("unchanged", ends, ends, color="grey", dash="dotted", width=1.2)]
    for words, chosen, color in (("verdict right", right, "blue"), ("verdict wrong", ~right, "vermilion")):
        if chosen.any():
            curves.append(figure.Curve(words, before[chosen], after[chosen], color=color, draw="points", width=2.2))
    drawn = figure.draw_plane(
        "Gap on held-out motion",
        curves,
        x_label="gap before",
        y_label="gap after",
        log_x=True,
        log_y=True,
        caption="Replay of another motion of the same reality, without and with the diagnosis; in multiples of the "
        "sensors' noise, geometric mean over the channels. 1 is a model as good as the sensors.",
    )
    return page.Section("How far the gap shrinks", "", [drawn])


def _parameters_section(report: Report) -> page.Section:
    rows: list[list[TableCell]] = []
    for line in report.lines:
        inside = 100 * line.within.value if line.within.count else None
        rows.append(
            [
                line.compared.effect.replace("_", " "),
                line.compared.words,
                line.compared.unit,
                line.error.count,
                100 * line.error.value,
                100 * max(abs(found - true) / abs(true) for true, found in line.pairs),
                inside,
            ]
        )
    columns = ("effect", "quantity", "unit", "cases", "error, median (%)", "largest (%)", "within 2 std (%)")
    text = (
        "True against found, of the effects that were named right. Reality has other formulas than the dictionary "
        "(docs/method/blind_check.md), so that a shape has no exact counterpart; orders and times have."
    )
    return page.Section(
        "Orders, time constants and shapes", text, [figure.draw_table("Parameters", columns, rows, digits=3)]
    )


def _cases_section(report: Report) -> page.Section:
    columns = [*CASE_COLUMNS]
    size = "in multiples of the typical one (docs/method/blind_check.md)"
    rows = [_case_cells(row) for row in report.rows]
    brackets = ""
    if any(row.optional for row in report.rows):
        brackets = " In brackets: what may be named or not."
    if report.asked.kind == "rough":
        size = "of a wrong number its factor, truth over file; of an effect " + size
    if report.asked.kind == FRICTION_KIND:
        columns.append("after, with what is true")
        size = "level at the motor, N m and N m s/rad"
        brackets = " In brackets: a term of friction so small that it may be named or not."
        for cells, row in zip(rows, report.rows, strict=True):
            cells.append(finite_or_none(row.after_true))
    caption = f"Size: {size}. Beside it: what the verdict calls unknown beside what it names.{brackets}"
    return page.Section("All cases", "", [figure.draw_table("Cases", columns, rows, digits=3, caption=caption)])


def _case_cells(row: Row) -> list[TableCell]:
    """A case as a row of the table."""
    may = [f"({one})" for one in row.optional]
    return [
        row.name[:8],
        ", ".join([*row.truth, *may]) or "none",
        ", ".join(f"{size:.2g}" for size in row.sizes),
        row.snr,
        row.failed or ", ".join(row.verdict) or "none",
        ", ".join(row.remainder),
        row.p_truth,
        finite_or_none(row.before),
        finite_or_none(row.after),
        100 * closed_share(row) if row.has_gap else None,
    ]


def _describe_reproduction(report: Report) -> str:
    asked, where = report.asked, describe_host()
    options = [f"--kind {asked.kind}", f"--cases {asked.count}", f"--seconds {asked.seconds:g}", f"--seed {asked.seed}"]
    if asked.family is not None:
        options.insert(0, f"--family {asked.family}")
    if asked.model:
        options.insert(0, f"--model {shlex.quote(Path(asked.model).name)}")
    if asked.background is not None:
        options.insert(1, f"--background {asked.background:g}")
    command = f"hdagen blind {' '.join(options)}"
    return "\n\n".join(
        [
            f"hdagen {__version__} made this page; every number on it is of this run.",
            f"    {command}",
            f"Sealed before the first diagnosis: SHA-256 {report.seal.digest}, {report.seal.count} labels.",
            f"{where['processor']}, {where['cores']} cores, Python {where['python']}, {where['system']}; "
            f"{_say_where(asked)}, which lengthens the time of each.",
        ]
    )


def _say_where(asked: Check) -> str:
    if asked.cluster.is_remote:
        return "diagnosed on a cluster"
    return f"{asked.cluster.jobs} cases at the same time"
