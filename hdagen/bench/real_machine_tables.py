"""The verdicts on real machines as tables of the docs; docs/examples/real_machines.py makes the file.

An entry of a verdict is a named effect with its size, or a gap that remains, `unknown` at a joint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

EXAMPLE_FOLDERS = ("bam", "dfki", "dfki_simple", "emps", "kinova", "kuka")  # folders of docs/examples
UNKNOWN_PREFIX = "unknown@"


def build_machine_table(found: Mapping[str, Any]) -> str:
    """Tabulate all machines, a line for each case and one for each bar.

    Args:
        found: The sources as figures.py reads them.

    Returns:
        Markdown.

    """
    bars = ["| | | bar | |", "|---|---|---|---|"]
    for bar in found["real"]["bars"]:
        met, verdict = bar["reached"] <= bar["asked"], "**missed**"
        if bar["bound"] == "least":
            met = bar["reached"] >= bar["asked"]
        if met:
            verdict = "met"
        limit = f"at {bar['bound']} {bar['asked']:.3g}"
        bars.append(f"| {bar['name']} | {bar['reached']:.3g} | {limit} | {verdict} |")
    return "\n".join([*_format_cases(found["real"]["cases"]), "", *bars]) + "\n"


def build_page_table(found: Mapping[str, Any], page: str) -> str:
    """Tabulate one example.

    Args:
        found: The sources as figures.py reads them.
        page: Name of the example's folder.

    Returns:
        Markdown.

    """
    return "\n".join(_format_cases([case for case in found["real"]["cases"] if case["page"] == page])) + "\n"


def _format_cases(cases: list[Mapping[str, Any]]) -> list[str]:
    heads = ("machine", "known", "what is there", "what remains", "sure", "before", "after", "achievable", "closed")
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for case in cases:
        there = [
            _format_named_effect(entry, case["sizes"])
            for entry in case["verdict"]
            if not entry.startswith(UNKNOWN_PREFIX)
        ]
        remains = [f"`{entry}`" for entry in case["verdict"] if entry.startswith(UNKNOWN_PREFIX)]
        answer, sure, closed = f"{case['answer']}: **missed**", "no", ""
        if case["named"]:
            answer = case["answer"]
        if case["sure"]:
            sure = "yes"
        if case["closed"] is not None:
            closed = f"{100 * case['closed']:.0f} %"
        gaps = [_format_gap(case[key]) for key in ("before", "after", "achievable")]
        named = "<br>".join(there) or "nothing named"
        cells = (case["machine"], answer, named, ", ".join(remains), sure, *gaps, closed)
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _format_gap(value: float) -> str:
    """A gap with three digits, or to whole multiples of the noise."""
    if value >= 100:
        return f"{value:.0f}"
    return f"{value:.3g}"


def _format_named_effect(entry: str, sizes: Mapping[str, Any]) -> str:
    """A named effect with the values of its parameters."""
    values = []
    for value in sizes.get(entry, {}).values():
        number = f"{value['value']:.3g}"
        if value["std"] is not None:
            number += f" ± {value['std']:.1g}"
        values.append(f"{number} {value['unit']}".rstrip())
    if not values:
        return f"`{entry}`"
    return f"`{entry}` ({', '.join(values)})"


MACHINE_TABLES: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "real": build_machine_table,
    **{f"real {page}": partial(build_page_table, page=page) for page in EXAMPLE_FOLDERS},
}
