"""The figures of sealed checks, pooled by population in one file, and the tables of them for README and docs.

python -m hdagen.blind.rates blind-single/blind.json blind-none/blind.json again/blind.json --out docs/blind.json
python -m hdagen.blind.rates docs/blind.json blind-unknown/blind.json --out docs/blind.json
python -m hdagen.blind.rates docs/blind.json

A combined file may be combined with further checks. Of cases that it does not hold, shares and means are pooled from
their figures. A median and an error of calibration cannot be pooled; those of the larger number of cases stand. The
duration of a diagnosis depends on the version that ran, and is that of the last check alone.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from hdagen.blind.confidence_intervals import Figure, pool_means, pool_rates
from hdagen.blind.family_table import render_family_table
from hdagen.blind.labels import FIGURE_LABELS, describe_population, format_figure
from hdagen.blind.realities.population import EVERY_FAMILY, Population, read_population
from hdagen.blind.required_rates import BARS, Bar, find_bars
from hdagen.blind.score_summary import summarize_rows
from hdagen.blind.scores import Row
from hdagen.diagnosis.decision import calibration
from hdagen.diagnosis.decision.calibration import LARGEST_FILE_BYTES
from hdagen.support.atomic_write import write_atomically
from hdagen.support.input_file import InputFileError, read_json

NUMBER_FIELDS = {one.name for one in fields(Row) if one.type == "float"}
MEAN_FIGURES = {"p_truth", "brier", "pair_f1"}
UNPOOLED_FIGURES = {"calibration_error", "closed", "achieved", "seconds"}  # the others are shares
KEPT_KEYS = ("cases", "seconds", "version", "machine", "seal", "seed", "seed_hash")


def combine_checks(reports: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Combine checks by population.

    Args:
        reports: contents of blind.json, or of files that this function made.

    Returns:
        By name of the population (`hdagen.blind.realities.population`): it, the figures over all cases, the data to run
        each check again (``checks``), the cases (``rows``), and the figures of the cases that are missing there
        (``without_rows``).

    Raises:
        ValueError: a seed stands twice, so that its cases would count twice, or was used for the calibration.

    """
    found = {}
    for name, parts_of in _parts_by_population(reports).items():
        population = _find_population(name, parts_of[0])
        kind = population.kind
        checks = [check for part in parts_of for check in part["checks"]]
        seeds = [check["seed"] for check in checks]
        if len(set(seeds)) < len(seeds):
            raise ValueError(f"{name}: a seed stands twice among {', '.join(sorted(seeds))}; give each check once.")
        if tuned := [check["seed"] for check in checks if check["seed_hash"] in calibration.read().seeds]:
            raise ValueError(f"{name}: the probabilities were calibrated on {', '.join(tuned)}; give other checks.")
        rows = [row for part in parts_of for row in part.get("rows", [])]
        gone = [_figures_without_rows(part) for part in parts_of]
        before = _pool_figures([one for one in gone if one])
        scored = [_read_row(row, kind) for row in rows]
        figures = _pool_figures([one for one in (before, summarize_rows(scored)) if one])
        if lasted := _last_duration(parts_of[-1], kind):
            figures["seconds"] = lasted
        found[name] = {
            "population": asdict(population),
            "cases": sum(part["cases"] for part in parts_of),
            "summary": {name: figure.as_json() for name, figure in figures.items()},
            "checks": checks,
            "without_rows": {name: figure.as_json() for name, figure in before.items()},
            "rows": rows,
        }
    return found


def _find_population(name: str, part: Mapping[str, Any]) -> Population:
    """The population of a part of a combined file; older files have the kind alone, as its name."""
    return read_population(part.get("population", {"kind": name}))


def _parts_by_population(reports: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """The parts of all reports that belong to each population; the report of a check is one part."""
    found: dict[str, list[Mapping[str, Any]]] = {}
    for report in reports:
        parts = report
        if "kind" in report:
            parts = {read_population(report).name: _as_part(report)}
        for name, part in parts.items():
            found.setdefault(name, []).append(part)
    return found


def _figures_without_rows(part: Mapping[str, Any]) -> dict[str, Figure]:
    """The figures of a part's cases that are not among its rows."""
    if "rows" in part:
        return _read_figures(part["without_rows"])
    return _read_figures(part["summary"])


def _as_part(report: Mapping[str, Any]) -> dict[str, Any]:
    """A check's own report as a part of a combined file."""
    check = {key: report[key] for key in KEPT_KEYS}
    population = asdict(read_population(report))
    return {
        "population": population,
        "cases": report["cases"],
        "checks": [check],
        "without_rows": {},
        "rows": report["rows"],
    }


def _read_figures(stated: Mapping[str, Any]) -> dict[str, Figure]:
    found = {name: _read_figure(one) for name, one in stated.items()}
    return {name: one for name, one in found.items() if one is not None}


def _last_duration(part: Mapping[str, Any], kind: str) -> Figure | None:
    """The duration of a diagnosis in the last check of a part."""
    if "summary" in part:
        return _read_figure(part["summary"].get("seconds"))
    return summarize_rows([_read_row(row, kind) for row in part["rows"]]).get("seconds")


def _pool_figures(parts: Sequence[Mapping[str, Figure]]) -> dict[str, Figure]:
    """Figures over the cases of all parts, by name."""
    if len(parts) == 1:
        return dict(parts[0])
    found = {}
    for name in dict.fromkeys(name for part in parts for name in part):
        each = [part[name] for part in parts if name in part]
        if name in MEAN_FIGURES:
            found[name] = pool_means(each)
        elif name in UNPOOLED_FIGURES:
            found[name] = max(each, key=lambda one: one.count)
        else:
            found[name] = pool_rates(each)
    return found


def _read_row(stated: Mapping[str, Any], kind: str) -> Row:
    """A row of a ``kind`` from blind.json, where lists stand for tuples and null for NaN."""
    values: dict[str, Any] = {"kind": kind} | dict(stated)
    for key, value in values.items():
        if isinstance(value, list):
            values[key] = tuple(value)
    return Row(**(values | {key: math.nan for key in NUMBER_FIELDS if values.get(key) is None}))


HEADLINE_RATES = (  # the rates of README: population and figure
    ("single", "effect"),
    ("background", "effect"),
    ("pair", "pair_f1"),
    ("none", "false_alarm"),
    ("unknown", "unknown_found_at_joint"),
    ("background", "closed"),
)


def render_headline_table(checks: Mapping[str, Any]) -> str:
    """Render the rates of README.

    Args:
        checks: a combined file, by population.

    Returns:
        A Markdown table with a line for each of `HEADLINE_RATES`.

    """
    return render_table(checks, HEADLINE_RATES)


def render_table(checks: Mapping[str, Any], chosen: Sequence[tuple[str, str]] | None = None) -> str:
    """Render the figures that have a bar.

    Args:
        checks: a combined file, by population.
        chosen: population and figure of the bars to show; all if None.

    Returns:
        A Markdown table with a line for each bar of each population, in the order of families and kinds.

    """
    lines = ["| measured on | cases | figure | bar | reached (95 % interval) | |", "|---|---|---|---|---|---|"]
    populations = {name: _find_population(name, part) for name, part in checks.items()}
    for name, population in sorted(populations.items(), key=lambda item: _place_population(item[1])):
        for bar in find_bars(population):
            if chosen is not None and (name, bar.figure) not in chosen:
                continue
            found = _read_figure(checks[name]["summary"].get(bar.figure))
            if found is not None:
                outcome = "met" if bar.is_met_by(found) else "missed"
                cells = (
                    describe_population(population),
                    str(found.count),
                    FIGURE_LABELS[bar.figure],
                    _describe_limit(bar),
                    format_figure(bar.figure, found),
                    outcome,
                )
                lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def render_families(checks: Mapping[str, Any]) -> str:
    """Render the figures of one effect by family, with the calibration that the other families give.

    Args:
        checks: a combined file, by population.

    Returns:
        A Markdown table with a line for each family whose cases the file holds.

    """
    rows: dict[str, list[Row]] = {}
    for name, part in checks.items():
        population = _find_population(name, part)
        rows.setdefault(population.family, []).extend(_read_row(row, population.kind) for row in part.get("rows", ()))
    return render_family_table(rows)


def _place_population(population: Population) -> tuple[int, int, float]:
    """Where a population stands in a table."""
    kinds = list(BARS)
    return EVERY_FAMILY.index(population.family), kinds.index(population.kind), population.background or 0.0


def _describe_limit(bar: Bar) -> str:
    """A bar in words."""
    side = ("at least", "at most")[bar.most]
    if bar.figure == "seconds":
        return f"{side} {bar.value:g} s"
    return f"{side} {100 * bar.value:g} %"


def _read_figure(stated: Mapping[str, Any] | None) -> Figure | None:
    if stated is None or stated["value"] is None:
        return None
    ends = [stated[key] for key in ("low", "high")]
    low, high = (math.nan if end is None else end for end in ends)
    return Figure(stated["value"], stated["count"], low, high)


def main() -> int:
    """Combine reports with --out, or print the table of a combined file."""
    p = argparse.ArgumentParser(prog="python -m hdagen.blind.rates", description=(__doc__ or "").split("\n")[0])
    p.add_argument("files", nargs="+", type=Path, help="blind.json of checks; without --out one combined file")
    p.add_argument("--out", type=Path, help="the combined file")
    options = p.parse_args()
    try:
        read = [read_json(path, LARGEST_FILE_BYTES, "`hdagen blind` writes a blind.json") for path in options.files]
    except InputFileError as error:
        print(error, file=sys.stderr)
        return 2
    if options.out:
        try:
            content = combine_checks(read)
        except ValueError as error:
            print(error, file=sys.stderr)
            return 2
        write_atomically(options.out, (json.dumps(content, indent=1) + "\n").encode())
        return 0
    sys.stdout.write(render_table(read[0]))
    sys.stdout.write("\n" + render_families(read[0]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
