"""`hdagen compare`: two diagnoses side by side."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdagen.pages.quantity import format_number

if TYPE_CHECKING:
    from hdagen.comparison.diagnosis_comparison import DiagnosisComparison, Estimate
    from hdagen.pages.number_table import TableCell
    from hdagen.pages.result_table import ResultTable

COMPARE_EXAMPLE = """example:
  hdagen compare diagnosis-monday diagnosis-friday
  hdagen compare diagnosis-monday diagnosis-friday --out comparison.html

exit codes: 0 done, 2 usage or configuration; see docs/guides/compare_diagnoses.md"""
DONE = 0
PRINTED_DIGITS, DEVIATION_DIGITS = 4, 2  # significant digits of a number, and of a standard deviation


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "compare",
        help="show two diagnoses side by side",
        description="Shows verdicts, probabilities, gaps and parameters of two diagnoses side by side, and which "
        "parameters agree within their 95 % intervals.",
        epilog=COMPARE_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("first", type=Path, help="a diagnosis.json, or the folder that holds it")
    p.add_argument("second", type=Path, help="another one")
    p.add_argument("--out", type=Path, metavar="PAGE", help="also write a page, .html")
    p.add_argument("--json", action="store_true", help="print the comparison as JSON")


def run(options: argparse.Namespace) -> int:
    """Compare, write the page, print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    Raises:
        PlantError: A diagnosis cannot be read, or the page has no place.

    """
    from hdagen.api.diagnosis_pairs import compare
    from hdagen.arm.build_loader import PlantError

    if options.out is not None and options.out.suffix != ".html":
        raise PlantError(
            f"--out {options.out}: found a name ending in {options.out.suffix!r}, possible is .html; name such a file."
        )
    found = compare(options.first, options.second)
    if options.out is not None:
        from hdagen.comparison.comparison_page import write_comparison_page

        write_comparison_page(options.out, found)
    if options.json:
        print(json.dumps(found.to_dict() | {"out": options.out and str(options.out)}, indent=1))
    else:
        _print_comparison(options, found)
    return DONE


def _print_comparison(options: argparse.Namespace, found: DiagnosisComparison) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    console.print(found.sentence, markup=False)
    for label, name in zip(found.labels, ("first", "second"), strict=True):
        console.print(f"{name}: {label}", markup=False, soft_wrap=True)
    for table in (found.table(), found.tabulate_effects(), _shorten_parameters(found)):
        if len(table):
            _print_table(console, table)
    for note in found.notes:
        console.print(f"note: {note}", markup=False)
    if options.out is not None:
        console.print(f"written: {options.out}", markup=False)


def _shorten_parameters(found: DiagnosisComparison) -> ResultTable:
    """The table of parameters in as many columns as a console has room for."""
    from hdagen.pages.result_table import ResultTable

    pairs = found.parameters
    columns: dict[str, list[TableCell]] = {
        "parameter": [pair.name for pair in pairs],
        "first": [_format_estimate(pair.first) for pair in pairs],
        "second": [_format_estimate(pair.second) for pair in pairs],
        "unit": [pair.unit for pair in pairs],
        "apart, std": [pair.deviations for pair in pairs],
        "agree": [pair.do_agree for pair in pairs],
    }
    return ResultTable("Parameters, with standard deviations", columns)


def _format_estimate(estimate: Estimate | None) -> str | None:
    if estimate is None:
        return None
    text = format_number(estimate.value, PRINTED_DIGITS)
    if estimate.std is not None:
        text += f" ± {format_number(estimate.std, DEVIATION_DIGITS)}"
    return text


def _print_table(console: Any, result: ResultTable) -> None:
    from rich.markup import escape
    from rich.table import Table

    from hdagen.pages.number_table import format_cell

    table = Table(title=escape(result.title), title_justify="left")
    for k, (name, cells) in enumerate(result.columns.items()):
        words = all(isinstance(cell, str) for cell in cells)
        table.add_column(escape(name), justify="left" if words else "right", no_wrap=k == 0)
    for row in zip(*result.columns.values(), strict=True):
        table.add_row(*(escape(format_cell(cell, PRINTED_DIGITS)) for cell in row))
    console.print(table)
