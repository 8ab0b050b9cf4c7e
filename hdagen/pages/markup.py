"""HTML and SVG as text: what makes a string safe to stand in a page, and elements."""

from __future__ import annotations

import html
import json
import re

# Control characters, lone surrogates and the marks that turn the direction of writing around: none belongs in a name,
# and each can break a parser or make a line read as something else.
UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\u202a-\u202e\u2066-\u2069\ufffe\uffff]")

OPTION_NAME = re.compile(r"(?<!\S)--?[a-z][a-z-]*")  # in a command, as --hold-out


def replace_unprintable(text: object) -> str:
    """Replace every character that may not stand in a page.

    Args:
        text: Anything that can be written.

    Returns:
        The text with replacement characters.

    """
    return UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", str(text))


def escape_html(text: object) -> str:
    """Escape a text so that HTML shows it as it is, inside elements and inside quoted attributes.

    Args:
        text: Anything that can be written.

    Returns:
        The escaped text, without characters that may not stand in a page.

    """
    return html.escape(replace_unprintable(text), quote=True)


def build_element(name: str, *children: str, **attributes: object) -> str:
    """Build an element of HTML or SVG.

    Args:
        name: Name of the element.
        *children: Markup of the children, which is not escaped.
        **attributes: Values that are escaped here. In their names ``_`` stands for ``-``, and a trailing one is dropped
            (``class_``). None and False leave the attribute out, True writes the bare name, and a float is written to
            two decimals.

    Returns:
        The element as markup.

    """
    written = []
    for key, value in attributes.items():
        if value is None or value is False:
            continue
        plain = key.rstrip("_").replace("_", "-")
        if value is True:
            written.append(f" {plain}")
        elif isinstance(value, float):
            written.append(f' {plain}="{round(value, 2):g}"')
        else:
            written.append(f' {plain}="{escape_html(value)}"')
    return f"<{name}{''.join(written)}>{''.join(children)}</{name}>"


def build_data_block(data: object) -> str:
    """Build a script element that holds JSON, which is read and never run.

    Args:
        data: Anything that JSON takes.

    Returns:
        The element; nothing in the data can end it.

    Raises:
        ValueError: A number is NaN or infinite.

    """
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return f'<script type="application/json">{text}</script>'


def build_code(text: str) -> str:
    """Write lines of code, in which no line of the page ends within the name of an option.

    Args:
        text: The lines, which are escaped.

    Returns:
        The content of a `pre` element.

    """
    return OPTION_NAME.sub(lambda name: build_element("span", name[0], class_="option"), escape_html(text))


def build_paragraphs(text: str) -> str:
    """Write plain text as HTML.

    Args:
        text: An empty line ends a paragraph; a paragraph whose lines all start with four spaces is code.

    Returns:
        The paragraphs as markup.

    """
    parts = []
    for part in re.split(r"\n[ \t]*\n", text.strip("\n")):
        lines = [line for line in part.split("\n") if line.strip()]
        if lines and all(line.startswith("    ") for line in lines):
            parts.append(build_element("pre", build_code("\n".join(line[4:].rstrip() for line in lines))))
        elif lines:
            parts.append(build_element("p", escape_html(" ".join(line.strip() for line in lines))))
    return "".join(parts)
