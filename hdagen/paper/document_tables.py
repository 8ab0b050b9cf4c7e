"""The tables of docs/project/paper.md, from the results of `hdagen paper all`; docs/paper.json is a copy of these."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from hdagen.paper.paper_page import HOLDS_WORDS, paper_heading

SWEEP_KEYS = ("sets", "sweep_seconds", "sweep_processor_seconds")


def collect_results(contents: Sequence[Mapping[str, Any]]) -> str:
    """Collect the claims and choices of all figures, and the duration of their sweeps.

    Args:
        contents: the JSON of each figure.

    Returns:
        The text of results.json.

    """
    kept = []
    for content in contents:
        one = {key: content[key] for key in ("name", "title", "claims", "choices")}
        numbers = content.get("numbers", {})
        if all(key in numbers for key in SWEEP_KEYS):
            one["sweep"] = {key: numbers[key] for key in SWEEP_KEYS}
        kept.append(one)
    return json.dumps(kept, indent=1, ensure_ascii=False) + "\n"


def render_tables(found: Sequence[Mapping[str, Any]]) -> str:
    """Render the claims and the choices of all figures.

    Args:
        found: the content of results.json.

    Returns:
        Two tables in Markdown.

    """
    lines = ["| | the paper | here | holds | why they differ, or from where on |", "|---|---|---|---|---|"]
    for figure in found:
        for claim in figure["claims"]:
            cells = (claim["paper"], claim["here"], HOLDS_WORDS[claim["holds"]], claim["why"])
            lines.append(_render_row(paper_heading(figure["name"]), *cells))
    lines += ["", "What the paper leaves open:", "", "| | question | taken | alternatives |", "|---|---|---|---|"]
    for figure in found:
        for choice in figure["choices"]:
            lines.append(
                _render_row(paper_heading(figure["name"]), choice["question"], choice["taken"], choice["alternatives"])
            )
    return "\n".join(lines)


def _render_row(*cells: str) -> str:
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"
