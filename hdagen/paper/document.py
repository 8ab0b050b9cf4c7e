"""The tables of docs/paper.md from the results of `hdagen paper all`.

    python -m hdagen.paper.document docs/paper.json docs/paper.md

puts the tables of the first into the second, between its two markers; docs/paper.json is the results.json that
`hdagen paper all` writes beside its page.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hdagen.paper.page import HOLDS, heading
from hdagen.plant import PlantError
from hdagen.whole import write_whole

BEGIN, END = "<!-- results: begin -->", "<!-- results: end -->"


def results(contents: Sequence[Mapping[str, Any]]) -> str:
    """results.json: of every figure's JSON its claims and choices."""
    kept = [{key: content[key] for key in ("name", "title", "claims", "choices")} for content in contents]
    return json.dumps(kept, indent=1, ensure_ascii=False) + "\n"


def tables(found: Sequence[Mapping[str, Any]]) -> str:
    """The claims, then the choices, as Markdown."""
    lines = ["| | the paper | here | holds | why they differ, or from where on |", "|---|---|---|---|---|"]
    for figure in found:
        for claim in figure["claims"]:
            cells = (claim["paper"], claim["here"], HOLDS[claim["holds"]], claim["why"])
            lines.append(_row(heading(figure["name"]), *cells))
    lines += ["", "What the paper leaves open:", "", "| | question | taken | alternatives |", "|---|---|---|---|"]
    for figure in found:
        for choice in figure["choices"]:
            lines.append(_row(heading(figure["name"]), choice["question"], choice["taken"], choice["alternatives"]))
    return "\n".join(lines)


def _row(*cells: str) -> str:
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def updated(document: str, found: Sequence[Mapping[str, Any]]) -> str:
    """The document with the tables of ``found``. PlantError where its markers are missing."""
    before, begin, rest = document.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise PlantError(f"the document has no lines {BEGIN} and {END}; put them where the tables are to stand.")
    return f"{before}{BEGIN}\n\n{tables(found)}\n\n{END}{after}"


def main(arguments: Sequence[str]) -> int:
    """0 done, 2 usage."""
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    source, target = map(Path, arguments)
    text = updated(target.read_text(encoding="utf-8"), json.loads(source.read_text(encoding="utf-8")))
    write_whole(target, text.encode())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
