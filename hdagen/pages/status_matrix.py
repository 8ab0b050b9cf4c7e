"""A matrix of states: a symbol in each cell, with a key that says what each symbol means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hdagen.pages import frame
from hdagen.pages.markup import build_element, escape_html

MOST_MATRIX_ROWS = 12  # of a matrix that stands in one part
States = Mapping[str, tuple[str, str]]  # by name: its symbol, and its words in the key


def draw_status_matrix(
    title: str,
    columns: Sequence[str],
    rows: Sequence[tuple[str, Sequence[str]]],
    states: States,
    *,
    caption: str = "",
) -> str:
    """Draw a matrix whose cells each have one of a few states; symbols differ in shape, not in colour alone.

    Args:
        title: Heading.
        columns: Headings of the columns.
        rows: Name and states of each row, one for every column; "" leaves a cell empty.
        states: The states by name, each with symbol and meaning; the name is a CSS class, too.
        caption: Text below the matrix.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: A row does not have one state for every column, or a state is not among ``states``.

    """
    for name, cells in rows:
        if len(cells) != len(columns) or not set(cells) <= {*states, ""}:
            raise ValueError(f"matrix {title!r}: row {name!r} needs one of {', '.join(states)} for every column")
    half = len(rows)
    if half > MOST_MATRIX_ROWS:  # two parts beside each other
        half = (half + 1) // 2
    parts = [_build_table(columns, rows[at : at + half], states) for at in range(0, len(rows), half or 1)]
    shown = {state for _, cells in rows for state in cells}
    key = [
        build_element("span", build_element("b", escape_html(symbol), class_=name), f" {escape_html(words)}")
        for name, (symbol, words) in states.items()
        if name in shown
    ]
    drawn = build_element("p", *key, class_="matrix-key") + build_element("div", *parts, class_="matrices")
    sent = [["", *columns], *([name, *(states[c][1] if c else "" for c in cells)] for name, cells in rows)]
    return frame.build_figure("table", title, drawn, caption=caption, data={"rows": sent})


def _build_table(columns: Sequence[str], rows: Sequence[tuple[str, Sequence[str]]], states: States) -> str:
    heads = [build_element("th", escape_html(name), scope="col") for name in ("", *columns)]
    head = build_element("thead", build_element("tr", *heads))
    body = build_element("tbody", *(_build_row(name, cells, states) for name, cells in rows))
    return build_element("div", build_element("table", head, body, class_="matrix"), class_="scroll")


def _build_row(name: str, cells: Sequence[str], states: States) -> str:
    written = [build_element("th", escape_html(name), scope="row")]
    for state in cells:
        if not state:
            written.append(build_element("td"))
            continue
        symbol, words = states[state]
        written.append(build_element("td", escape_html(symbol), class_=state, title=words))
    return build_element("tr", *written)
