"""Plain English in README, CONTRIBUTING and docs: short sentences, short paragraphs, no riddles."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
DOCUMENTS = [README, ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
MOST_WORDS_OF_A_SENTENCE = 35
MOST_WORDS_OF_A_PARAGRAPH = 80
MOST_WHATS = 2.0  # in 1000 words
MOST_README_BYTES = 9000
BANNED = (  # riddles, and participles or adverbs in place of a noun
    "anew",
    "aught",
    "beside",
    "besides",
    "heard",
    "hence",
    "lessened",
    "lest",
    "meant",
    "nought",
    "said of",
    "says of",
    "tell apart",
    "tells",
    "thereby",
    "thereof",
    "told",
    "wherein",
    "whereof",
    "wherever",
    "whoever",
)
ABBREVIATION = re.compile(r"\b(?:e\.g|i\.e|etc|vs|cf|approx|Figs?|eqs?|No|al)\.$")


def identity(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def prose(path: Path) -> str:
    """The text of a document without code, comments, figures and tables; link targets are left out, too."""
    text = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    lines = [line for line in text.splitlines() if not line.startswith(("|", "    ", "#"))]
    return "\n".join(lines)


def paragraphs(path: Path) -> Iterator[str]:
    """Paragraphs and list items, each on one line."""
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.)\s)", prose(path)):
        if words := part.split():
            yield " ".join(words)


def sentences(paragraph: str) -> Iterator[str]:
    """The sentences of a paragraph."""
    begun = ""
    for part in re.split(r"(?<=[.!?])\s+", re.sub(r"^(?:[-*]|\d+\.)\s", "", paragraph)):
        begun = f"{begun} {part}".strip()
        if not ABBREVIATION.search(begun):
            yield begun
            begun = ""
    if begun:
        yield begun


@pytest.mark.parametrize("path", DOCUMENTS, ids=identity)
def test_no_sentence_is_long(path: Path) -> None:
    every = [sentence for paragraph in paragraphs(path) for sentence in sentences(paragraph)]
    assert [one for one in every if len(one.split()) > MOST_WORDS_OF_A_SENTENCE] == []


@pytest.mark.parametrize("path", DOCUMENTS, ids=identity)
def test_no_paragraph_is_long(path: Path) -> None:
    assert [one for one in paragraphs(path) if len(one.split()) > MOST_WORDS_OF_A_PARAGRAPH] == []


@pytest.mark.parametrize("path", DOCUMENTS, ids=identity)
def test_no_riddle_stands_in_a_document(path: Path) -> None:
    text = " ".join(prose(path).split()).lower()
    assert [word for word in BANNED if re.search(rf"\b{word}\b", text)] == []


def test_what_is_rare() -> None:
    text = " ".join(paragraph for path in DOCUMENTS for paragraph in paragraphs(path))
    whats = len(re.findall(r"\bwhat\b", text, re.IGNORECASE))
    assert 1000 * whats / len(text.split()) <= MOST_WHATS


def test_the_readme_is_one_screen() -> None:
    assert README.stat().st_size <= MOST_README_BYTES
