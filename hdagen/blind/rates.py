"""What sealed checks found, those of a kind together, in one file, and the table that README and docs have of it.

python -m hdagen.blind.rates blind-single/blind.json blind-none/blind.json again/blind.json --out docs/blind.json
python -m hdagen.blind.rates docs/blind.json blind-unknown/blind.json --out docs/blind.json
python -m hdagen.blind.rates docs/blind.json

A combined file may be combined with further checks. Of a kind whose cases it does not hold, shares and means are
counted together from their figures; a median and an error of calibration cannot be, and are those of whichever cases
are more. How long a diagnosis takes is a matter of the version that ran, and told of the last check alone.
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
from hdagen.blind.figures import Figure, means_together, rates_together
from hdagen.blind.score import Row, summary
from hdagen.blind.words import WORDS, said
from hdagen.diagnosis import calibration
from hdagen.diagnosis.calibration import LARGEST
from hdagen.input_file import InputFileError, read_json
from hdagen.whole import write_whole

NUMBERS = {one.name for one in fields(Row) if one.type == "float"}
MEANS = {"p_truth", "brier", "pair_f1"}
NOT_COUNTED = {"calibration_error", "closed", "achieved", "seconds"}  # the others are shares
KEPT = ("cases", "seconds", "version", "machine", "seal", "seed", "seed_hash")


def combined(reports: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """By kind: the figures over all cases of its checks, what it takes to run each again, the cases (``rows``), and the
    figures of those that are not there (``without_rows``). A report is that of a check, or what this returned.
    ValueError where a seed stands twice, as its cases would count twice, or is one that the probabilities were
    calibrated on."""
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for report in reports:
        parts = {report["kind"]: _of_check(report)} if "kind" in report else report
        for kind, part in parts.items():
            kinds.setdefault(kind, []).append(part)
    found = {}
    for kind, parts_of in kinds.items():
        checks = [check for part in parts_of for check in part["checks"]]
        seeds = [check["seed"] for check in checks]
        if len(set(seeds)) < len(seeds):
            raise ValueError(f"{kind}: a seed stands twice among {', '.join(sorted(seeds))}; give each check once.")
        if tuned := [check["seed"] for check in checks if check["seed_hash"] in calibration.read().seeds]:
            raise ValueError(f"{kind}: the probabilities were calibrated on {', '.join(tuned)}; give other checks.")
        rows = [row for part in parts_of for row in part.get("rows", [])]
        gone = [_figures(part["without_rows"] if "rows" in part else part["summary"]) for part in parts_of]
        before = _together([one for one in gone if one])
        figures = _together([one for one in (before, summary([_row(row, kind) for row in rows])) if one])
        if lasted := _lasted(parts_of[-1], kind):
            figures["seconds"] = lasted
        found[kind] = {
            "cases": sum(part["cases"] for part in parts_of),
            "summary": {name: figure.json() for name, figure in figures.items()},
            "checks": checks,
            "without_rows": {name: figure.json() for name, figure in before.items()},
            "rows": rows,
        }
    return found


def _of_check(report: Mapping[str, Any]) -> dict[str, Any]:
    """A check's own report as a part of a combined file."""
    check = {key: report[key] for key in KEPT}
    return {"cases": report["cases"], "checks": [check], "without_rows": {}, "rows": report["rows"]}


def _figures(stated: Mapping[str, Any]) -> dict[str, Figure]:
    found = {name: _figure(one) for name, one in stated.items()}
    return {name: one for name, one in found.items() if one is not None}


def _lasted(part: Mapping[str, Any], kind: str) -> Figure | None:
    """How long a diagnosis took in the last check of a part."""
    if "summary" in part:
        return _figure(part["summary"].get("seconds"))
    return summary([_row(row, kind) for row in part["rows"]]).get("seconds")


def _together(parts: Sequence[Mapping[str, Figure]]) -> dict[str, Figure]:
    """Figures over the cases of all parts, by name."""
    if len(parts) == 1:
        return dict(parts[0])
    found = {}
    for name in dict.fromkeys(name for part in parts for name in part):
        each = [part[name] for part in parts if name in part]
        if name in MEANS:
            found[name] = means_together(each)
        elif name in NOT_COUNTED:
            found[name] = max(each, key=lambda one: one.count)
        else:
            found[name] = rates_together(each)
    return found


def _row(stated: Mapping[str, Any], kind: str) -> Row:
    """A row of a ``kind`` as blind.json has it, which knows no NaN and no tuple."""
    values: dict[str, Any] = {"kind": kind} | {key: tuple(v) if isinstance(v, list) else v for key, v in stated.items()}
    return Row(**(values | {key: math.nan for key in NUMBERS if values.get(key) is None}))


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
    try:
        read = [read_json(path, LARGEST, "`hdagen blind` writes a blind.json") for path in options.files]
    except InputFileError as error:
        print(error, file=sys.stderr)
        return 2
    if options.out:
        try:
            content = combined(read)
        except ValueError as error:
            print(error, file=sys.stderr)
            return 2
        write_whole(options.out, (json.dumps(content, indent=1) + "\n").encode())
        return 0
    sys.stdout.write(table(read[0]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
