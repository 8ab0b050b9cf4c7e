"""A page of the paper's claims beside the results, the errata and the choices, and one page for each figure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib import resources
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.pages import figure, page
from hdagen.pages.page import Section
from hdagen.paper.prototype.figure_result import Axes, Claim, Grid, Map, Result

CLAIM_COLUMNS, REASON_COLUMN = ("the paper says", "here"), "why they differ, or from where on"
CHOICE_COLUMNS, ERRATA_COLUMNS = ("question", "taken", "alternatives"), ("printed", "checked", "how it shows")
WRAPPED_CELL_LENGTH = 24  # letters from which a cell of a table breaks its lines
LARGEST_SPAN_RATIO = 2.0  # largest ratio of the spans of two parts that share axes
HOLDS_WORDS = {True: "yes", False: "no", None: "–"}


def render_parts(result: Result) -> list[str]:
    """Render the parts as the page's own figures, which follow the reader's light or dark."""
    out: list[str] = []
    parts, k = list(result.parts), 0
    while k < len(parts):
        part = parts[k]
        if isinstance(part, Grid):
            out.append(
                figure.draw_table(
                    part.heading, part.columns, part.rows, digits=part.digits, sentences=_wrapped_columns(part)
                )
            )
            k += 1
        elif isinstance(part, Map):
            maps = [one for one in takewhile(lambda one: isinstance(one, Map), parts[k:]) if isinstance(one, Map)]
            out.append(figure.place_abreast([_render_map(one) for one in maps]))
            k += len(maps)
        else:
            group = [part]
            while k + len(group) < len(parts) and _share_axes(part, parts[k + len(group)]):
                following = parts[k + len(group)]
                assert isinstance(following, Axes)
                group.append(following)
            out.append(_render_planes(result, group))
            k += len(group)
    return out


def _render_map(part: Map) -> str:
    return figure.draw_heat_map(
        part.heading, part.x, part.y, part.values, x_label=part.x_label, y_label=part.y_label,
        value_label=part.value_label, log_x=part.log_x, log_y=part.log_y,
    )  # fmt: skip


def _wrapped_columns(part: Grid) -> list[str]:
    """The columns with long words or sentences, which break their lines."""
    found = []
    for k, name in enumerate(part.columns):
        words = [cell for row in part.rows if isinstance(cell := row[k], str)]
        if any(len(word) > WRAPPED_CELL_LENGTH and " " in word for word in words):
            found.append(name)
    return found


def _share_axes(one: Axes, other: object) -> bool:
    """Tell whether two parts share their axes' names and kinds, and fill the same axes."""
    if not isinstance(other, Axes) or (one.x_label, one.y_label, one.log_x, one.log_y, one.equal) != (
        other.x_label, other.y_label, other.log_x, other.log_y, other.equal,
    ):  # fmt: skip
        return False
    for side in ("x", "y"):
        first, second = _value_span(one, side), _value_span(other, side)
        if max(first, second) > LARGEST_SPAN_RATIO * min(first, second):
            return False
    return True


def _value_span(part: Axes, side: str) -> float:
    """Difference of the largest and the least value of all curves."""
    values = np.concatenate([np.asarray(getattr(curve, side), float) for curve in part.curves])
    return float(np.nanmax(values) - np.nanmin(values))


def _make_plane(axes: Axes, heading: str) -> figure.Plane:
    curves = [
        figure.Curve(c.label, c.x, c.y, color=c.color, dash=c.dash, draw=c.draw, width=c.width) for c in axes.curves
    ]
    return figure.Plane(curves, heading=heading, marks=axes.marks)


def _render_planes(result: Result, group: Sequence[Axes]) -> str:
    """Render parts that share axes, side by side."""
    first = group[0]
    drawn = [_make_plane(axes, axes.heading) for axes in group]
    if len(group) == 1:  # the heading stands in the title
        drawn = [_make_plane(first, "")]
    pushed = [f"{words} from {begin:g} to {end:g} s" for axes in group for begin, end, words in axes.bands]
    caption = ""
    if pushed:
        caption = f"Pushed: {', '.join(dict.fromkeys(pushed))}."
    title = "; ".join(axes.heading for axes in group)
    every = len(group) == len([part for part in result.parts if isinstance(part, Axes)])
    if every or len(group) > 2:
        title = result.title
    return figure.draw_planes(
        title, drawn, x_label=first.x_label, y_label=first.y_label, columns=min(2, result.columns), equal=first.equal,
        log_x=first.log_x, log_y=first.log_y, caption=caption,
    )  # fmt: skip


def make_section(result: Result) -> dict[str, Any]:
    """Make the page's section of a result.

    Args:
        result: the figure or table.

    Returns:
        Its "text", and its "figures" in HTML: the parts, then the table of claims.

    """
    return {"text": result.text, "figures": [*render_parts(result), render_claims(result.claims)]}


def render_claims(claims: Sequence[Claim]) -> str:
    """Render the table of claims: "the paper says … / here …"."""
    rows = [(claim.paper, claim.here, HOLDS_WORDS[claim.holds], claim.why or "–") for claim in claims]
    return figure.draw_table(
        "The paper and here", (*CLAIM_COLUMNS, "holds", REASON_COLUMN), rows, sentences=(*CLAIM_COLUMNS, REASON_COLUMN)
    )


def write_page(folder: Path, contents: Sequence[Mapping[str, Any]], sections: Sequence[Mapping[str, Any]]) -> Path:
    """Write index.html, and beside it a page for each figure, to which its claims lead.

    Args:
        folder: the folder of the results.
        contents: the JSON of each figure.
        sections: the section of each figure, as `make_section` makes it.

    Returns:
        The path of index.html.

    Raises:
        OSError: a page cannot be written.

    """
    claims = [(paper_heading(content["name"]), claim) for content in contents for claim in content["claims"]]
    outcomes = [claim["holds"] for _, claim in claims]
    kept, broken = (sum(holds is value for holds in outcomes) for value in (True, False))
    summary = [(name, claim["paper"], claim["here"], HOLDS_WORDS[claim["holds"]]) for name, claim in claims]
    pages = [f"{content['name']}.html" for content in contents for _ in content["claims"]]
    choices = [
        (paper_heading(content["name"]), choice["question"], choice["taken"], choice["alternatives"])
        for content in contents for choice in content["choices"]
    ]  # fmt: skip
    whole = [
        Section(
            "Every claim",
            "What the paper says, what came out on its virtual prototype, and whether that is the same. Each name "
            "leads to the figure, and to the reasons of differences.",
            [
                figure.draw_table(
                    "The paper and here", ("", *CLAIM_COLUMNS, "holds"), summary, sentences=CLAIM_COLUMNS, links=pages
                )
            ],
        ),
        Section("Every figure", "", [_list_figures(contents)]),
        Section(
            "What the paper leaves open",
            "What was taken, and what the alternatives give.",
            [figure.draw_table("Choices", ("", *CHOICE_COLUMNS), choices, sentences=CHOICE_COLUMNS)],
        ),
        Section(
            "Errata",
            "The paper's equations: as printed, as used, and how it shows. Each is a test.",
            [figure.draw_table("Errata", ("equation", *ERRATA_COLUMNS), read_errata(), sentences=ERRATA_COLUMNS)],
        ),
    ]
    verdict = (
        f"Of {len(claims)} statements of the paper {kept} hold on its virtual prototype, {broken} do not, and for "
        f"{len(claims) - kept - broken} it gives nothing to hold them to."
    )
    reproduce = (
        "    hdagen paper all\n\nEach figure's log lies beside it, and `hdagen replay ROBOT LOG` simulates it again: "
        "ROBOT is the .toml of the same name, else paper_prototype. docs/project/paper.md explains the differences."
    )
    target = folder / "index.html"
    for content, made in zip(contents, sections, strict=True):
        _write_figure_page(folder, content, made, reproduce)
    page.write_page(target, "The paper, reproduced", verdict, whole, reproduce)
    return target


def _list_figures(contents: Sequence[Mapping[str, Any]]) -> str:
    """A table that leads to the page of each figure."""
    rows = [(paper_heading(content["name"]), content["title"]) for content in contents]
    pages = [f"{content['name']}.html" for content in contents]
    return figure.draw_table("Figures and tables", ("", "title"), rows, sentences=("title",), links=pages)


def _write_figure_page(folder: Path, content: Mapping[str, Any], made: Mapping[str, Any], reproduce: str) -> None:
    heading = f"{paper_heading(content['name'])}: {content['title']}"
    sections = [Section("The figure", made["text"], made["figures"])]
    claims = content["claims"]
    kept = sum(claim["holds"] is True for claim in claims)
    verdict = f"{kept} of {len(claims)} statements of the paper hold here; index.html has all figures."
    page.write_page(folder / f"{content['name']}.html", heading, verdict, sections, reproduce)


def paper_heading(name: str) -> str:
    """Name a figure as the paper does.

    Args:
        name: of the figure, as "fig11" or "table4".

    Returns:
        Its heading, as "Fig. 11" or "Table IV".

    """
    found = re.fullmatch(r"(fig|table|maps)(\d+)(\w?)", name)
    if not found:
        return {"resolution": "Beside Fig. 15", "sensorless": "Beside Fig. 16", "joints3": "V"}.get(name, name)
    kind = {"fig": "Fig.", "table": "Table", "maps": "Beside Fig."}[found[1]]
    number, part = found[2], ""
    if found[1] == "table":
        number = ("I", "II", "III", "IV", "V")[int(found[2]) - 1]
    if found[3]:
        part = f" ({found[3]})"
    return f"{kind} {number}{part}"


def read_errata() -> list[list[str]]:
    """Read the rows of docs/method/errata.md from the package's copy: equation, printed, checked, how it shows."""
    text = resources.files("hdagen.data").joinpath("errata.md").read_text("utf-8")
    lines = [line for line in text.splitlines() if line.startswith("|")]
    rows = []
    for line in lines[2:]:
        cells = line.strip().strip("|").split("|")
        rows.append([cell.strip() for cell in cells[:4]])
    return rows
