"""The page: title, verdict, sections with figures, how to reproduce it; one file that asks nothing of the network."""

from __future__ import annotations

import base64
import hashlib
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from hdagen.pages import palette, time_chart
from hdagen.pages.markup import build_element, build_paragraphs, escape_html, replace_unprintable
from hdagen.support.atomic_write import write_atomically

SCRIPT_FILES = (
    "axis.js",
    "frame.js",
    "curves.js",
    "heat.js",
    "player.js",
    "animation.js",
    "space_animation.js",
    "time_chart.js",
    "table.js",
    "page.js",
)  # the last starts all


@dataclass(frozen=True)
class Section:
    """``text`` is plain: an empty line ends a paragraph, lines that start with four spaces are code.

    ``figures`` are what ``figure`` and ``animation`` return; nothing else may stand there, for it is not escaped.
    """

    heading: str
    text: str
    figures: Sequence[str] = ()


def render_page(
    title: str, verdict: str, sections: Sequence[Section], reproduce: str, *, first_screen: str = ""
) -> str:
    """Write a whole page as text; the same arguments give the same bytes.

    Args:
        title: Heading of the page.
        verdict: The one sentence to take home.
        sections: Sections in their order.
        reproduce: The commands that make the page again, set like the text of a section.
        first_screen: Markup of `build_first_screen`, which then stands in place of title and verdict.

    Returns:
        HTML that needs nothing from the network.

    """
    shown = "".join(figure for section in sections for figure in section.figures)
    styles, scripts = ["style.css"], list(SCRIPT_FILES)
    if time_chart.FIGURE_MARK in shown:  # the library travels only with a page that draws with it
        styles, scripts = [*time_chart.LIBRARY_STYLES, *styles], [*time_chart.LIBRARY_SCRIPTS, *scripts]
    style = palette.build_color_style() + "".join(_read_part(name) for name in styles)
    script = "".join(_read_part(name) for name in scripts)
    policy = (
        f"default-src 'none'; style-src '{_hash_text(style)}'; script-src '{_hash_text(script)}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
    names = _name_anchors(section.heading for section in sections)
    links = "".join(
        build_element("li", build_element("a", escape_html(section.heading), href=f"#{name}"))
        for section, name in zip(sections, names, strict=True)
    )
    heading = build_element("h1", escape_html(title)), build_element("p", escape_html(verdict), class_="verdict")
    body = [first_screen or build_element("header", *heading)]
    if len(sections) > 2:
        body.append(build_element("nav", build_element("ul", links), aria_label="Contents"))
    body += [
        build_element("main", *(_render_section(section, name) for section, name in zip(sections, names, strict=True))),
        build_element("footer", build_element("h2", "How to reproduce this page"), build_paragraphs(reproduce)),
    ]
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark">',
            '<link rel="icon" href="data:,">',
            f"<title>{escape_html(title)}</title>",
            f"<style>{style}</style>",
            "</head>",
            "<body>",
            *body,
            f'<script type="module">{script}</script>',
            "</body>",
            "</html>",
            "",
        ]
    )


def write_page(
    path: str | os.PathLike[str],
    title: str,
    verdict: str,
    sections: Sequence[Section],
    reproduce: str,
    *,
    first_screen: str = "",
) -> None:
    """Write a page whole or not at all: an older page at its place stays until the new one is complete.

    Args:
        path: Where the page goes.
        title: Heading of the page.
        verdict: The one sentence to take home.
        sections: Sections in their order.
        reproduce: The commands that make the page again, set like the text of a section.
        first_screen: Markup of `build_first_screen`, which then stands in place of title and verdict.

    Raises:
        OSError: The file cannot be written; the message names the place.

    """
    target = Path(path)
    text = render_page(title, verdict, sections, reproduce, first_screen=first_screen).encode("utf-8")
    try:
        write_atomically(target, text)
    except OSError as problem:
        reason = f"the page cannot be written, and what stood there is unchanged: {problem.strerror}"
        raise OSError(problem.errno, reason, str(target)) from problem


def _render_section(section: Section, name: str) -> str:
    return build_element(
        "section",
        build_element("h2", escape_html(section.heading)),
        build_paragraphs(section.text),
        *section.figures,
        id=name,
    )


def _name_anchors(headings: Iterable[str]) -> list[str]:
    """One identifier for each heading, made of its letters, each different."""
    names: list[str] = []
    for heading in headings:
        name = re.sub(r"[^a-z0-9]+", "-", replace_unprintable(heading).lower()).strip("-")[:40] or "section"
        count = sum(other == name or re.fullmatch(re.escape(name) + r"-\d+", other) is not None for other in names)
        if count:
            name = f"{name}-{count + 1}"
        names.append(name)
    return names


def _read_part(name: str) -> str:
    """A file that ships with the package, fit to stand inside an element of the page."""
    return resources.files("hdagen.pages").joinpath(name).read_text("utf-8").replace("\r\n", "\n")


def _hash_text(text: str) -> str:
    """The hash by which the page's policy allows this one inline text and no other."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
