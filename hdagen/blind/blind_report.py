"""The report of a check, blind.json: every figure, every case, and the machine it ran on."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from hdagen.blind.confidence_intervals import Figure, estimate_mean, estimate_median, estimate_rate, finite_or_none
from hdagen.blind.label_seal import Seal, hash_seed
from hdagen.blind.parameter_errors import ComparisonLine, compare_parameters
from hdagen.blind.realities.effect_places import EFFECT_PLACES
from hdagen.blind.required_rates import Bar, find_bars
from hdagen.blind.score_summary import bin_by_confidence, count_confusions, select_single, summarize_rows
from hdagen.blind.scores import Row
from hdagen.blind.sealed_check import Check
from hdagen.support.version import __version__

REPORT_SCHEMA = 1


@dataclass(frozen=True)
class Report:
    """A finished check: the request, its seal, its rows, and the figures and comparisons that follow from them."""

    asked: Check
    seal: Seal
    rows: Sequence[Row]
    summary: Mapping[str, Figure]
    lines: Sequence[ComparisonLine]

    @property
    def bars(self) -> list[tuple[Bar, Figure, bool]]:
        """The kind's bars whose figure exists: each bar, its figure, and whether it is met."""
        bars = find_bars(self.asked.population)
        known = [(bar, self.summary[bar.figure]) for bar in bars if bar.figure in self.summary]
        return [(bar, found, bar.is_met_by(found)) for bar, found in known]


def make_report(asked: Check, seal: Seal, rows: Sequence[Row]) -> Report:
    """Make the report of a check.

    Args:
        asked: the request.
        seal: the seal that was verified.
        rows: the scored cases.

    Returns:
        The report with all figures and comparisons.

    """
    return Report(asked, seal, rows, summarize_rows(rows), compare_parameters(rows))


def figures_by_effect(rows: Sequence[Row]) -> dict[str, dict[str, Figure]]:
    """Compute figures of each true effect alone.

    Args:
        rows: cases of any kind.

    Returns:
        Figures by effect, in the order of `EFFECT_PLACES`: right "effect", "joint" and "place", "p_truth", and "snr".

    """
    found = {}
    for name in EFFECT_PLACES:
        mine = [row for row in select_single(rows) if row.true_effect == name]
        if mine:
            found[name] = {
                "effect": estimate_rate([row.is_effect_right for row in mine]),
                "joint": estimate_rate([row.is_joint_right for row in mine]),
                "place": estimate_rate([row.is_place_right for row in mine]),
                "p_truth": estimate_mean([row.p_truth for row in mine]),
                "snr": estimate_median([row.snr for row in mine]),
            }
    return found


def render_report(found: Report) -> str:
    """Render blind.json.

    Args:
        found: the report of a check.

    Returns:
        The file's text.

    """
    content = {
        "schema": REPORT_SCHEMA,
        **asdict(found.asked.population),
        "cases": found.asked.count,
        "seconds": found.asked.seconds,
        "version": __version__,
        "machine": describe_host(),
        "seal": found.seal.digest,
        "seed": found.asked.seed,
        "seed_hash": hash_seed(found.asked.seed),
        "summary": _figures_json(found.summary),
        "bars": [
            {"figure": bar.figure, "value": bar.value, "at": ("least", "most")[bar.most], "met": met}
            for bar, _, met in found.bars
        ],
        "reliability": [
            {"said": said.as_json(), "right": right.as_json()}
            for said, right in bin_by_confidence(select_single(found.rows))
        ],
        "confusion": count_confusions(found.rows),
        "effects": {name: _figures_json(figures) for name, figures in figures_by_effect(found.rows).items()},
        "parameters": [
            {
                "effect": line.compared.effect,
                "parameter": line.compared.words,
                "unit": line.compared.unit,
                "relative_error": line.error.as_json(),
                "within_two_std": line.within.as_json(),
                "pairs": line.pairs,
            }
            for line in found.lines
        ],
        "rows": [_row_json(row) for row in found.rows],
    }
    return json.dumps(content, indent=1) + "\n"


def describe_host() -> dict[str, Any]:
    """Describe the machine that the check ran on."""
    return {
        "processor": _processor_name(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def _processor_name() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    except OSError:
        names = []
    return next(iter(names), platform.processor())


def _figures_json(figures: Mapping[str, Figure]) -> dict[str, Any]:
    return {name: figure.as_json() for name, figure in figures.items()}


def _row_json(row: Row) -> dict[str, Any]:
    """The fields of a row as JSON takes them: JSON has no NaN."""
    fields = asdict(row)
    for name, value in fields.items():
        if isinstance(value, float):
            fields[name] = finite_or_none(value)
    return fields
