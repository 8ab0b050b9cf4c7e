"""What sealed checks found, those of a kind together, in one file, and the table that README and docs have of it.

python -m hdagen.blind.rates blind-single/blind.json blind-none/blind.json again/blind.json --out docs/blind.json
python -m hdagen.blind.rates docs/blind.json
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from hdagen.blind.bars import BARS
from hdagen.blind.blind_page import KINDS
from hdagen.blind.figures import Figure
from hdagen.blind.run import replace
from hdagen.blind.score import Row, summary
from hdagen.blind.words import WORDS, said

NUMBERS = {one.name for one in fields(Row) if one.type == "float"}
KEPT = ("cases", "seconds", "version", "machine", "seal", "seed", "seed_hash")


def combined(reports: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """By kind: the figures over all cases of its checks, and of each check what it takes to run it again. ValueError
    where a seed stands twice, as its cases would count twice."""
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for report in reports:
        kinds.setdefault(report["kind"], []).append(report)
    found = {}
    for kind, checks in kinds.items():
        seeds = [check["seed"] for check in checks]
        if len(set(seeds)) < len(seeds):
            raise ValueError(f"{kind}: a seed stands twice among {', '.join(sorted(seeds))}; give each check once.")
        figures = summary([_row(row) for check in checks for row in check["rows"]])
        found[kind] = {
            "cases": sum(check["cases"] for check in checks),
            "summary": {name: figure.json() for name, figure in figures.items()},
            "checks": [{key: check[key] for key in KEPT} for check in checks],
        }
    return found


def _row(stated: Mapping[str, Any]) -> Row:
    """A row as blind.json has it, which knows no NaN and no tuple."""
    values: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in stated.items()}
    return Row(**(values | {key: math.nan for key in NUMBERS if values[key] is None}))


def table(checks: Mapping[str, Any]) -> str:
    """A line for each bar of each kind, in the order of the bars, as Markdown."""
    lines = ["| measured on | cases | figure | bar | reached (95 % interval) | |", "|---|---|---|---|---|---|"]
    for kind, bars in BARS.items():
        if kind not in checks:
            continue
        check = checks[kind]
        for bar in bars:
            found = _figure(check["summary"].get(bar.figure))
            if found is None:
                continue
            unit = f"{bar.value:g} s" if bar.figure == "seconds" else f"{100 * bar.value:g} %"
            limit = f"{'at most' if bar.most else 'at least'} {unit}"
            reached = said(bar.figure, found), "met" if bar.met(found) else "missed"
            cells = (KINDS[kind], str(found.count), WORDS[bar.figure], limit, *reached)
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _figure(stated: Mapping[str, Any] | None) -> Figure | None:
    if stated is None or stated["value"] is None:
        return None
    low, high = (math.nan if stated[key] is None else stated[key] for key in ("low", "high"))
    return Figure(stated["value"], stated["count"], low, high)


def main() -> int:
    """Combine reports with --out, or print the table of a combined file."""
    p = argparse.ArgumentParser(prog="python -m hdagen.blind.rates", description=(__doc__ or "").split("\n")[0])
    p.add_argument("files", nargs="+", type=Path, help="blind.json of checks; without --out one combined file")
    p.add_argument("--out", type=Path, help="the combined file")
    options = p.parse_args()
    read = [json.loads(path.read_text(encoding="utf-8")) for path in options.files]
    if options.out:
        try:
            content = combined(read)
        except ValueError as error:
            print(error, file=sys.stderr)
            return 2
        replace(options.out, json.dumps(content, indent=1) + "\n")
        return 0
    sys.stdout.write(table(read[0]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
