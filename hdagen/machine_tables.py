"""What the diagnosis says of real machines, as tables of the docs; docs/examples/real_machines.py makes the file.

An entry of a verdict is either what is there, a named effect with its size, or what remains, `unknown` at a joint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

PAGES = ("bam", "dfki", "dfki_simple", "emps", "kinova", "kuka")  # folders of docs/examples
UNKNOWN = "unknown@"


def table(found: Mapping[str, Any]) -> str:
    """A line for each case of all machines and one for each bar, as Markdown; ``found`` as figures.py reads it."""
    bars = ["| | | bar | |", "|---|---|---|---|"]
    for bar in found["real"]["bars"]:
        met = bar["reached"] >= bar["asked"] if bar["bound"] == "least" else bar["reached"] <= bar["asked"]
        limit = f"at {bar['bound']} {bar['asked']:.3g}"
        bars.append(f"| {bar['name']} | {bar['reached']:.3g} | {limit} | {'met' if met else '**missed**'} |")
    return "\n".join([*_lines(found["real"]["cases"]), "", *bars]) + "\n"


def page_table(found: Mapping[str, Any], page: str) -> str:
    """The lines of one example, ``page`` the name of its folder."""
    return "\n".join(_lines([case for case in found["real"]["cases"] if case["page"] == page])) + "\n"


def _lines(cases: list[Mapping[str, Any]]) -> list[str]:
    heads = ("machine", "known", "what is there", "what remains", "sure", "before", "after", "achievable", "closed")
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for case in cases:
        there = [_sized(entry, case["sizes"]) for entry in case["verdict"] if not entry.startswith(UNKNOWN)]
        remains = [f"`{entry}`" for entry in case["verdict"] if entry.startswith(UNKNOWN)]
        cells = (
            case["machine"],
            case["answer"] + ("" if case["named"] else ": **missed**"),
            "<br>".join(there) or "nothing named",
            ", ".join(remains),
            "yes" if case["sure"] else "no",
            *(
                f"{case[key]:.0f}" if case[key] >= 100 else f"{case[key]:.3g}"
                for key in ("before", "after", "achievable")
            ),
            "" if case["closed"] is None else f"{100 * case['closed']:.0f} %",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _sized(entry: str, sizes: Mapping[str, Any]) -> str:
    """A named effect with the values of its parameters."""
    values = []
    for value in sizes.get(entry, {}).values():
        spread = "" if value["std"] is None else f" ± {value['std']:.1g}"
        values.append(f"{value['value']:.3g}{spread} {value['unit']}".rstrip())
    return f"`{entry}`" + (f" ({', '.join(values)})" if values else "")


TABLES: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "real": table,
    **{f"real {page}": partial(page_table, page=page) for page in PAGES},
}
