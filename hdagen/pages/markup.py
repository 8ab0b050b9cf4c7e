"""HTML and SVG as text: what makes a string safe to stand in a page, and elements."""

from __future__ import annotations

import html
import json
import re

# Control characters, lone surrogates and the marks that turn the direction of writing around: none belongs in a name,
# and each can break a parser or make a line read as something else.
UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\u202a-\u202e\u2066-\u2069\ufffe\uffff]")


def clean(text: object) -> str:
    """``text`` with a replacement character for everything that may not stand in a page."""
    return UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", str(text))


def escape(text: object) -> str:
    """``text`` as it must stand in HTML to be read as text, inside elements and inside quoted attributes."""
    return html.escape(clean(text), quote=True)


def tag(name: str, *children: str, **attributes: object) -> str:
    """An element. ``children`` are markup already; attribute values are escaped here.

    In attribute names ``_`` stands for ``-`` and a trailing one is dropped (``class_``). None and False leave the
    attribute out, True writes the bare name, floats are written to two decimals.
    """
    written = []
    for key, value in attributes.items():
        if value is None or value is False:
            continue
        plain = key.rstrip("_").replace("_", "-")
        text = f"{round(value, 2):g}" if isinstance(value, float) else value
        written.append(f" {plain}" if value is True else f' {plain}="{escape(text)}"')
    return f"<{name}{''.join(written)}>{''.join(children)}</{name}>"


def block(data: object) -> str:
    """``data`` as JSON in a script element that is read, never run; nothing in it can end the element."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return f'<script type="application/json">{text}</script>'


def paragraphs(text: str) -> str:
    """Plain text as HTML: an empty line ends a paragraph; one whose lines all start with four spaces is code."""
    parts = []
    for part in re.split(r"\n[ \t]*\n", text.strip("\n")):
        lines = [line for line in part.split("\n") if line.strip()]
        if lines and all(line.startswith("    ") for line in lines):
            parts.append(tag("pre", escape("\n".join(line[4:].rstrip() for line in lines))))
        elif lines:
            parts.append(tag("p", escape(" ".join(line.strip() for line in lines))))
    return "".join(parts)
