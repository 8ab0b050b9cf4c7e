"""What stands around every drawing: the figure with its title, caption, numbers and data, for desk and for phone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hdagen.pages import markup
from hdagen.pages.markup import clean, escape, tag
from hdagen.pages.palette import COLORS, PAPER


@dataclass(frozen=True)
class Layout:
    """A figure is drawn twice, so that its letters are legible on a desk and on a phone without a script."""

    name: str
    width: float  # of the drawing, px
    font: float  # height of its letters, px


WIDE = Layout("wide", 820.0, 13.0)
NARROW = Layout("narrow", 360.0, 12.0)
LAYOUTS = (WIDE, NARROW)


def color(name: str) -> str:
    """The colour called ``name`` on paper, as #rrggbb; ValueError names those that exist."""
    if name not in COLORS:
        raise ValueError(f"colour {name!r}: there is no such colour; use one of {', '.join(COLORS)}")
    return COLORS[name][0]


def group(name: str, *children: str, class_: str = "", **attributes: object) -> str:
    """A ``g`` in the colour called ``name``: its children draw with currentColor."""
    return tag("g", *children, class_=f"{class_} {name}".strip(), color=color(name), **attributes)


def text_width(text: str, font: float) -> float:
    """Roughly how wide ``text`` is, px; a little generous."""
    return font * sum(0.34 if letter in "iIl.,:;'|!()[]· " else 0.9 if letter in "mwMW—" else 0.6 for letter in text)


def shortened(text: str, room: float, font: float) -> str:
    """``text`` where it fits into ``room`` px; otherwise as much of its beginning as does, and an ellipsis."""
    if text_width(text, font) <= room:
        return text
    short = clean(text[: max(int(room / (0.3 * font)), 0)])
    while short and text_width(short + "…", font) > room:
        short = short[:-1]
    return short + "…"


def letters(
    x: float,
    y: float,
    text: str,
    *,
    anchor: str = "start",
    strong: bool = False,
    faint: bool = False,
    halo: bool = False,
) -> str:
    """A line of text whose base line starts, ends or is centred at (x, y); a ``halo`` keeps it legible over curves."""
    return tag(
        "text",
        escape(text),
        x=x,
        y=y,
        text_anchor=None if anchor == "start" else anchor,
        font_weight=600 if strong else None,
        fill_opacity=0.72 if faint else None,
        class_="halo" if halo else None,
        stroke=PAPER if halo else None,
        stroke_width=3 if halo else None,
        paint_order="stroke" if halo else None,
        stroke_linejoin="round" if halo else None,
    )


def drawing(layout: Layout, width: float, height: float, description: str, *children: str) -> str:
    """An ``svg`` that can stand alone: colours and fonts in it are attributes; a page may override them by class."""
    return tag(
        "svg",
        *children,
        class_=f"{layout.name} ink",
        width=width,
        height=height,
        viewBox=f"0 0 {width:g} {height:g}",
        role="img",
        aria_label=description,
        color=COLORS["ink"][0],
        fill="currentColor",
        font_family="system-ui, 'Segoe UI', 'Liberation Sans', Arial, sans-serif",
        font_size=layout.font,
    )


def rows_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "", sentences: Sequence[str] = ()
) -> str:
    """A table of ready text; the first column names the row. Columns named in ``sentences`` break their lines."""
    words = ["words" if name in sentences else None for name in columns]
    head = tag("tr", *(tag("th", escape(name), scope="col", class_=k) for name, k in zip(columns, words, strict=True)))
    body = [
        tag(
            "tr",
            tag("th", escape(row[0]), scope="row", class_=words[0]),
            *(tag("td", escape(cell), class_=k) for cell, k in zip(row[1:], words[1:], strict=True)),
        )
        for row in rows
    ]
    title = tag("caption", escape(caption)) if caption else ""
    return tag("div", tag("table", title, tag("thead", head), tag("tbody", *body)), class_="scroll")


def figure(
    kind: str,
    title: str,
    body: str,
    *,
    caption: str = "",
    note: str = "",
    numbers: str = "",
    data: object = None,
    link: str = "",
) -> str:
    """The whole figure. ``kind`` tells the script what ``data`` means; figures of one ``link`` move together."""
    words = [tag("span", escape(caption)) if caption else "", tag("span", escape(note), class_="note") if note else ""]
    return tag(
        "figure",
        tag("h3", escape(title)),
        tag("div", body, class_="drawing"),
        tag("figcaption", " ".join(word for word in words if word)) if any(words) else "",
        tag("details", tag("summary", "Numbers"), numbers) if numbers else "",
        markup.block(data) if data is not None else "",
        data_kind=kind,
        data_link=link or None,
        aria_label=title,
    )
