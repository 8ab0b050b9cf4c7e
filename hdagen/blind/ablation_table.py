"""The table of an ablation: what changes where a rule of the decision is off, with paired intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hdagen.blind.confidence_intervals import Figure, estimate_paired_difference, estimate_rate
from hdagen.blind.decision_rules import RULES
from hdagen.blind.labels import FAMILY_TITLES

AS_IT_IS = "as it is"  # the name of the decision with all rules
_FIGURES = ("right", "joint", "sure", "sure and wrong", "false alarm")


def measure_outcomes(cases: Sequence[Mapping[str, Any]], rule: str) -> dict[str, list[bool]]:
    """Measure the cases that each figure of the table counts.

    Args:
        cases: of a file of cases, each with the rule.
        rule: name of the rule that is off, or `AS_IT_IS`.

    Returns:
        By the column's name, one Boolean for each case that counts there.

    """
    one = [case["outcomes"][rule] for case in cases if case["truth"]]
    none = [case["outcomes"][rule] for case in cases if not case["truth"]]
    return {
        "right": [case["right"] for case in one],
        "joint": [case["joint"] for case in one],
        "sure": [case["sure"] for case in one],
        "sure and wrong": [case["sure"] and not case["right"] for case in (*one, *none)],
        "false alarm": [case["named"] for case in none],
    }


def render_ablation(content: Mapping[str, Any]) -> str:
    """Render the table of an ablation.

    Args:
        content: of a file of cases.

    Returns:
        Markdown: the counts of cases by family and kind, and a table with a line for each rule.

    """
    cases = content["cases"]
    if not cases:
        return "No case yet.\n"
    lines = [
        _describe_cases(cases),
        "",
        f"| rule that is off | setting | decisions that change | {' | '.join(_FIGURES)} |",
        f"|---|---|---|{'---|' * len(_FIGURES)}",
    ]
    before = measure_outcomes(cases, AS_IT_IS)
    cells = [_format_rate(estimate_rate(before[column])) for column in _FIGURES]
    lines.append(f"| none: the decision as it is |  |  | {' | '.join(cells)} |")
    for rule in RULES:
        mine = [case for case in cases if rule.name in case["outcomes"]]
        other = sum(case["outcomes"][rule.name]["differs"] for case in mine)
        changed = sum(_is_changed(case, rule.name) for case in mine)
        usual, off = measure_outcomes(mine, AS_IT_IS), measure_outcomes(mine, rule.name)
        cells = [_format_difference(usual[column], off[column]) for column in _FIGURES]
        lacking = sum(case["outcomes"][rule.name]["lacks"] for case in mine)
        words = f"{changed} of {len(mine)}, {other} in probabilities"
        if lacking:
            words += f"; {lacking} without a second search"
        lines.append(f"| {rule.words} | `{rule.name.replace(', ', '`, `')}` | {words} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _describe_cases(cases: Sequence[Mapping[str, Any]]) -> str:
    """The counts of cases by family and kind."""
    counts: dict[tuple[str, str], int] = {}
    for case in cases:
        key = (case["family"], case["kind"])
        counts[key] = counts.get(key, 0) + 1
    said = [f"{FAMILY_TITLES[family]}, {kind}: {count}" for (family, kind), count in sorted(counts.items())]
    return f"Cases: {len(cases)} ({'; '.join(said)})."


def _is_changed(case: Mapping[str, Any], rule: str) -> bool:
    """Whether any outcome of a case is another one without the rule."""
    keys = ("right", "joint", "sure", "named")
    return any(case["outcomes"][rule][key] != case["outcomes"][AS_IT_IS][key] for key in keys)


def _format_rate(found: Figure) -> str:
    if not found.count:
        return "no case"
    return f"{100 * found.value:.0f} % ({100 * found.low:.0f} to {100 * found.high:.0f})"


def _format_difference(before: Sequence[bool], after: Sequence[bool]) -> str:
    """The change of a share; the interval alone where nothing changed."""
    found = estimate_paired_difference(before, after)
    if not found.count:
        return "no case"
    interval = f"({100 * found.low:+.0f} to {100 * found.high:+.0f})"
    if list(before) == list(after):
        return f"same {interval}"
    return f"{100 * found.value:+.0f} % {interval}"
