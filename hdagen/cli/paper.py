"""`hdagen paper`: the paper's tables and figures on its virtual prototype, its claims, and the results here."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdagen.cli.cluster_options import add_cluster_options, read_cluster_request, refuse_file_as_folder

if TYPE_CHECKING:
    from rich.console import Console

    from hdagen.paper.figure_catalogue import FigureEntry

PAPER_EXAMPLE = """example:
  hdagen paper list
  hdagen paper fig11 table4 --out paper
  hdagen paper all

writes SVG, PNG, JSON and logs, which `hdagen replay paper_prototype LOG` takes; all also writes index.html.
docs/project/paper.md has what came out and why it differs"""
DONE = 0
CLAIM_MARKS = {True: "holds", False: "does not", None: ""}


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "paper",
        help="the paper's tables and figures, reproduced",
        description="Makes tables and figures of the paper by simulating its virtual prototype: pictures, numbers, "
        "logs, "
        "and a line for each thing that the paper says of them. What is finished is not made again while nothing that "
        "it comes from has changed.",
        epilog=PAPER_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("names", nargs="+", metavar="NAME", help="such as fig11 or table4; all; or list, which names them")
    p.add_argument("--out", type=Path, default=Path("paper"), help="the folder (default: paper)")
    p.add_argument("--profile", choices=("portable", "native"), default="native", help="how the arms are compiled")
    p.add_argument("--json", action="store_true", help="print the claims as JSON")
    add_cluster_options(p, "groups of figures", "2")


def run(options: argparse.Namespace) -> int:
    """Make figures, write them, print their claims.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    Raises:
        PlantError: A name is unknown, or the folder cannot be used.

    """
    from rich.console import Console

    from hdagen.paper import figure_production
    from hdagen.paper.drawing import require_matplotlib
    from hdagen.paper.figure_catalogue import PAPER_FIGURES, find_figures

    if options.names == ["list"]:
        titles = {figure.name: figure.title for figure in PAPER_FIGURES}
        if options.json:
            print(json.dumps(titles, indent=1, ensure_ascii=False))
        else:
            print("\n".join(f"{name:10} {title}" for name, title in titles.items()))
        return DONE
    figures = find_figures(options.names)
    refuse_file_as_folder(options.out)
    require_matplotlib()
    begun, console, found, new = time.perf_counter(), Console(), {}, 0
    errors = Console(stderr=True)
    jobs = 1
    if len({figure.module for figure in figures}) > 1:
        jobs = figure_production.count_processors()
    asked = read_cluster_request(options, jobs)

    def say(words: str) -> None:
        errors.print(words, highlight=False, markup=False)

    for figure, content, now in figure_production.make_figures(figures, options.out, options.profile, asked, say):
        found[figure.name] = content
        new += now
    contents = [found[figure.name] for figure in figures]
    if figures == PAPER_FIGURES:
        _write_all_figures(options.out, contents)
    if options.json:
        print(json.dumps({content["name"]: content["claims"] for content in contents}, indent=1, ensure_ascii=False))
    else:
        _print_claims(console, figures, contents)
        where = options.out
        if figures == PAPER_FIGURES:
            where /= "index.html"
        took = time.perf_counter() - begun
        console.print(f"{new} made, {len(figures) - new} left as they were, {took:.0f} s; see {where}", soft_wrap=True)
    return DONE


def _write_all_figures(out: Path, contents: list[dict[str, Any]]) -> None:
    """The page of all figures, results.json, and the table of them that every campaign leaves."""
    from hdagen.arm.build_loader import PlantError
    from hdagen.campaign.result_store import ResultStore
    from hdagen.campaign.task import Outcome, Status
    from hdagen.paper import document_tables, figure_store, paper_page
    from hdagen.support.atomic_write import write_atomically

    try:
        paper_page.write_page(out, contents, figure_store.read_sections(out, [content["name"] for content in contents]))
        write_atomically(out / "results.json", document_tables.collect_results(contents).encode())
        ended = {}
        for one in contents:
            row = {"title": one["title"], "numbers": one["numbers"]}
            ended[one["name"]] = Outcome(Status.DONE, row, seconds=one["seconds"])
        ResultStore(out).write_table(ended)
    except OSError as error:
        raise PlantError(f"{out}: {error.strerror}; choose another place with --out.") from None


def _print_claims(console: Console, figures: tuple[FigureEntry, ...], contents: list[dict[str, Any]]) -> None:
    """Print each claim of the paper with the result here, figure by figure."""
    for figure, content in zip(figures, contents, strict=True):
        console.print(f"\n{figure.name}  {figure.title}", style="bold", highlight=False, markup=False)
        for claim in content["claims"]:
            line = f"  the paper says: {claim['paper']}\n  here: {claim['here']}"
            if mark := CLAIM_MARKS[claim["holds"]]:
                line += f"  [{mark}]"
            console.print(line, highlight=False, markup=False, soft_wrap=True)
