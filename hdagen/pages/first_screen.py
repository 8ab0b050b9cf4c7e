"""The first screen of a page: the answer as a heading, its key figures, its numbers, and the commands that follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hdagen.pages.markup import build_code, build_element, escape_html


@dataclass(frozen=True)
class Fact:
    """A key figure: its ``label``, its ``value`` in large letters, and a ``detail`` below it."""

    label: str
    value: str
    detail: str = ""


@dataclass(frozen=True)
class NextCommand:
    """A ``command`` of the shell, and the ``purpose`` that it serves."""

    purpose: str
    command: str


def build_first_screen(
    title: str,
    headline: str,
    facts: Sequence[Fact],
    *,
    remarks: Sequence[str] = (),
    body: str = "",
    commands: Sequence[NextCommand] = (),
) -> str:
    """Build the header of a page.

    Args:
        title: Heading of the page.
        headline: The answer, one sentence.
        facts: Key figures, about four.
        remarks: Sentences that a reader must know beside the answer.
        body: Markup of a table, which is not escaped.
        commands: Commands to copy.

    Returns:
        The ``header`` element.

    """
    parts = [
        build_element("h1", escape_html(title), class_="eyebrow"),
        build_element("p", escape_html(headline), class_="verdict"),
        build_element("dl", *(_build_fact(fact) for fact in facts), class_="facts"),
    ]
    if remarks:
        listed = [build_element("li", escape_html(one)) for one in remarks]
        parts.append(build_element("ul", *listed, class_="remarks"))
    if body:
        parts.append(body)
    if commands:
        parts.append(build_element("div", *(_build_command(one) for one in commands), class_="commands"))
    return build_element("header", *parts)


def _build_fact(fact: Fact) -> str:
    words = [build_element("dt", escape_html(fact.label)), build_element("dd", escape_html(fact.value), class_="value")]
    if fact.detail:
        words.append(build_element("dd", escape_html(fact.detail)))
    return build_element("div", *words)


def _build_command(one: NextCommand) -> str:
    """The purpose above the command; the script adds a button that copies it."""
    return build_element(
        "div",
        build_element("p", escape_html(one.purpose)),
        build_element("pre", build_element("code", build_code(one.command))),
        class_="command",
    )
