"""Every measured figure of README and docs, printed from the JSON of the command that measured it.

    python -m hdagen.bench.published_figures

puts each table between its two markers, `<!-- NAME: begin -->` and `<!-- NAME: end -->`. SOURCES says which command
makes which file; a bar that is missed stands there as missed. The settings of a stage of the diagnosis are printed from
the class that declares them, between the markers `settings STAGE`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from hdagen.bench import measured_tables, real_machine_tables, settings_tables
from hdagen.bench.measured_tables import SourceContents
from hdagen.blind import ablation_table, rates
from hdagen.diagnosis.settings import STAGE_SETTINGS
from hdagen.paper import document_tables
from hdagen.support.atomic_write import write_atomically

SOURCES = {
    "bench": ("docs/bench.json", "hdagen bench --json"),
    "panda": ("docs/bench_panda.json", "hdagen bench panda --json"),
    "predictive": ("docs/bench_mpc.json", "hdagen bench --mpc --json"),
    "sense": ("docs/sense.json", "hdagen mpc sense --json"),
    "demo": ("docs/demo.json", "hdagen demo --json"),
    "paper": ("docs/paper.json", "hdagen paper all"),
    "blind": ("docs/blind.json", "hdagen blind"),
    "ablation": ("docs/ablation.json", "python -m hdagen.blind.ablation --out"),
    "real": ("docs/real.json", "docs/examples/real_machines.py"),
    "identification": (
        "docs/examples/emps/identification.json",
        "hdagen replay emps DATA_EMPS.mat --columns columns.toml --json",
    ),
    "pulses": (
        "docs/examples/emps/pulses.json",
        "hdagen replay emps DATA_EMPS_PULSES.mat --columns columns_pulses.toml --json",
    ),
}


def read_sources(root: Path) -> dict[str, Any]:
    """Read the sources of all tables.

    Args:
        root: The project's folder.

    Returns:
        Content of each source, by name.

    Raises:
        FileNotFoundError: A source is missing.

    """
    return {name: json.loads((root / path).read_text(encoding="utf-8")) for name, (path, _) in SOURCES.items()}


def list_documents(root: Path) -> list[Path]:
    """List the documents that may have markers.

    Args:
        root: The project's folder.

    Returns:
        Paths of the documents.

    """
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def update_tables(text: str, found: SourceContents) -> str:
    """Print every table of a document anew.

    Args:
        text: The document.
        found: Content of each source, by name.

    Returns:
        The document with the tables between their markers as the sources have them.

    Raises:
        ValueError: A marker stands alone.

    """
    for name, table in DOCUMENT_TABLES.items():
        begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->\n"
        if begin not in text and end not in text:
            continue
        before, opened, rest = text.partition(begin)
        _, closed, after = rest.partition(end)
        if not opened or not closed:
            raise ValueError(f"the markers {begin.strip()} and {end.strip()} stand in this order around a table.")
        text = f"{before}{begin}{table(found)}{end}{after}"
    return text


def _build_settings_table(stage: str, found: SourceContents) -> str:
    """A table of settings, which needs none of the sources."""
    del found
    return settings_tables.build_settings_table(stage)


DOCUMENT_TABLES: dict[str, Callable[[SourceContents], str]] = {
    "reached": measured_tables.build_reached_table,
    "bench": measured_tables.build_bench_tables,
    "bench panda": measured_tables.build_panda_tables,
    "predictive": measured_tables.build_mpc_tables,
    "sense": measured_tables.build_sensing_table,
    "blind": lambda found: rates.render_table(found["blind"]),
    "ablation": lambda found: ablation_table.render_ablation(found["ablation"]),
    "headline": lambda found: rates.render_headline_table(found["blind"]),
    **real_machine_tables.MACHINE_TABLES,
    **{f"settings {stage}": partial(_build_settings_table, stage) for stage in STAGE_SETTINGS},
    "results": lambda found: f"\n{document_tables.render_tables(found['paper'])}\n\n",
}


def main() -> int:
    """Update the documents of the current folder.

    Returns:
        The exit code: 2 where a source is missing.

    """
    root = Path()
    try:
        found = read_sources(root)
    except FileNotFoundError as error:
        print(f"{error.filename}: there is no such file; call this in the project's folder.", file=sys.stderr)
        return 2
    for path in list_documents(root):
        text = path.read_text(encoding="utf-8")
        if (made := update_tables(text, found)) != text:
            write_atomically(path, made.encode())
            print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
