"""What stands around every drawing: the figure with its title, caption, numbers and data, for desk and for phone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

from hdagen.pages import markup
from hdagen.pages.markup import build_element, escape_html, replace_unprintable
from hdagen.pages.palette import COLORS, PAPER_COLOR


@dataclass(frozen=True)
class Layout:
    """A figure is drawn twice, so that its letters are legible on a desk and on a phone without a script."""

    name: str
    width: float  # of the drawing, px
    font: float  # height of its letters, px


WIDE = Layout("wide", 820.0, 13.0)
NARROW = Layout("narrow", 360.0, 12.0)
LAYOUTS = (WIDE, NARROW)
_MOST_SHOWN_ROWS = 40  # rows from which a table scrolls in a box of its own
_LETTER_WIDTHS = dict.fromkeys("iIl.,:;'|!()[]· ", 0.34) | dict.fromkeys("mwMW—", 0.9)  # in heights of the letters
_LETTER_WIDTH = 0.6  # of every other letter
_HALO = {
    "class_": "halo",
    "stroke": PAPER_COLOR,
    "stroke_width": 3,
    "paint_order": "stroke",
    "stroke_linejoin": "round",
}


def find_color(name: str) -> str:
    """Look a colour up.

    Args:
        name: A key of ``palette.COLORS``.

    Returns:
        The colour on paper, as #rrggbb.

    Raises:
        ValueError: There is no such colour; the message names those that exist.

    """
    if name not in COLORS:
        raise ValueError(f"colour {name!r}: there is no such colour; use one of {', '.join(COLORS)}")
    return COLORS[name][0]


def group_in_color(name: str, *children: str, class_: str = "", **attributes: object) -> str:
    """Build a ``g`` element in one colour, in which its children draw with currentColor.

    Args:
        name: The colour, a key of ``palette.COLORS``.
        *children: Markup of the children.
        class_: Further CSS classes.
        **attributes: Further attributes, as ``markup.build_element`` takes them.

    Returns:
        The element as markup.

    Raises:
        ValueError: There is no such colour.

    """
    return build_element("g", *children, class_=f"{class_} {name}".strip(), color=find_color(name), **attributes)


def estimate_text_width(text: str, font: float) -> float:
    """Estimate the width of a text from its letters, a little generously.

    Args:
        text: One line.
        font: Height of the letters, px.

    Returns:
        The width, px.

    """
    return font * sum(_LETTER_WIDTHS.get(letter, _LETTER_WIDTH) for letter in text)


def shorten_text(text: str, room: float, font: float) -> str:
    """Shorten a text to a width.

    Args:
        text: One line.
        room: Width that the text may take, px.
        font: Height of the letters, px.

    Returns:
        The text if it fits, otherwise the longest beginning that fits, with an ellipsis.

    """
    if estimate_text_width(text, font) <= room:
        return text
    short = replace_unprintable(text[: max(int(room / (0.3 * font)), 0)])
    while short and estimate_text_width(short + "…", font) > room:
        short = short[:-1]
    return short + "…"


def wrap_text(text: str, room: float, font: float) -> list[str]:
    """Break a text into lines of a width, between words; a word that is wider alone is shortened.

    Args:
        text: One line.
        room: Width that a line may take, px.
        font: Height of the letters, px.

    Returns:
        The lines, one or more.

    """
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and estimate_text_width(longer, font) > room:
            lines.append(word)
        else:
            lines[-1] = longer
    return [shorten_text(line, room, font) for line in lines]


def draw_text(
    x: float,
    y: float,
    text: str,
    *,
    anchor: str = "start",
    strong: bool = False,
    faint: bool = False,
    halo: bool = False,
) -> str:
    """Draw one line of text.

    Args:
        x: Place of the anchor, px.
        y: Base line, px, downwards.
        text: The text, not yet escaped.
        anchor: "start", "middle" or "end": the part of the text that stands at ``x``.
        strong: Bold letters.
        faint: Letters that recede.
        halo: A rim in the colour of the paper, which keeps the text legible over curves.

    Returns:
        The ``text`` element.

    """
    styles: dict[str, object] = {}
    if anchor != "start":
        styles["text_anchor"] = anchor
    if strong:
        styles["font_weight"] = 600
    if faint:
        styles["fill_opacity"] = 0.72
    if halo:
        styles |= _HALO
    return build_element("text", escape_html(text), x=x, y=y, **styles)


def build_svg(layout: Layout, width: float, height: float, description: str, *children: str) -> str:
    """Build an ``svg`` that can stand alone: its colours and fonts are attributes, which a page may override by class.

    Args:
        layout: The layout that the drawing is made for.
        width: Width of the drawing, px.
        height: Height of the drawing, px.
        description: One sentence for readers who cannot see the drawing.
        *children: Markup of the drawing.

    Returns:
        The ``svg`` element.

    """
    return build_element(
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


def build_rows_table(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    caption: str = "",
    sentences: Sequence[str] = (),
    links: Sequence[str | None] = (),
) -> str:
    """Build a table of ready text, whose first column names the row.

    Args:
        columns: Headings.
        rows: Cells of each row, one for every column.
        caption: Heading of the table, or none.
        sentences: Headings of the columns that break their lines.
        links: Where the first cell of each row leads, if anywhere.

    Returns:
        The table in an element that scrolls.

    """
    broken = dict.fromkeys(sentences, "words")
    classes = [broken.get(name) for name in columns]
    heads = [
        build_element("th", escape_html(name), scope="col", class_=kind)
        for name, kind in zip(columns, classes, strict=True)
    ]
    parts = [
        build_element("thead", build_element("tr", *heads)),
        build_element("tbody", *(_table_row(row, classes, at) for row, at in zip_longest(rows, links))),
    ]
    if caption:
        parts.insert(0, build_element("caption", escape_html(caption)))
    kind = "scroll long" if len(rows) > _MOST_SHOWN_ROWS else "scroll"
    return build_element("div", build_element("table", *parts), class_=kind)


def _table_row(row: Sequence[str], classes: Sequence[str | None], link: str | None) -> str:
    name = escape_html(row[0])
    if link:
        name = build_element("a", name, href=link)
    cells = [build_element("th", name, scope="row", class_=classes[0])]
    cells += [
        build_element("td", _keep_together(escape_html(cell)), class_=kind)
        for cell, kind in zip(row[1:], classes[1:], strict=True)
    ]
    return build_element("tr", *cells)


def _keep_together(cell: str) -> str:
    """A cell whose line ends neither before a percent sign nor behind a plus or minus."""
    return cell.replace("± ", "±\N{NO-BREAK SPACE}").replace(" %", "\N{NO-BREAK SPACE}%")


def build_figure(
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
    """Build the whole figure: title, drawings, caption, numbers and data.

    Args:
        kind: Tells the script how to read ``data``.
        title: Heading, not yet escaped.
        body: Markup of the drawings.
        caption: Text below the drawings.
        note: A remark behind the caption.
        numbers: Markup of a table that opens on demand.
        data: Numbers for the script, as JSON takes them; None: none.
        link: Figures of one link share cursor and zoom.

    Returns:
        The ``build_figure`` element.

    """
    parts = [build_element("h3", escape_html(title)), build_element("div", body, class_="drawing")]
    words = []
    if caption:
        words.append(build_element("span", escape_html(caption)))
    if note:
        words.append(build_element("span", escape_html(note), class_="note"))
    if words:
        parts.append(build_element("figcaption", " ".join(words)))
    if numbers:
        parts.append(build_element("details", build_element("summary", "Numbers"), numbers))
    if data is not None:
        parts.append(markup.build_data_block(data))
    return build_element("figure", *parts, data_kind=kind, data_link=link or None, aria_label=title)
