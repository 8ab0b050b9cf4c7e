"""Names that are HTML, and what a page must have made of them."""

from __future__ import annotations

from html.parser import HTMLParser

NAME = "<script>alert(1)</script>&amp;<img src=x onerror=alert(2)>\"'"


class _Read(HTMLParser):
    """The text of a page as a reader sees it, its elements, and the attributes that hold code."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.words, self.scripts, self.images, self.code = "", list[dict[str, str | None]](), 0, list[str]()
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.words += "".join(value or "" for value in found.values())
        self.images += tag == "img" and found.get("src") == "x"
        self.code += [name for name, value in attrs if name.startswith("on") or (value or "").startswith("javascript:")]
        if tag == "script":
            self.scripts.append(found)

    def handle_data(self, data: str) -> None:
        self.words += data


def check_escaped(page: str, times: int = 1) -> None:
    """Holds that a page shows `NAME` as text, ``times`` times at least, and has no element and no code of it.

    A page's own scripts are one module at its end, and data that is read.
    """
    read = _Read(page)
    assert read.words.count(NAME) >= times, f"shown {read.words.count(NAME)} times"
    kinds = [script.get("type") for script in read.scripts]
    assert kinds.count("module") == 1 and set(kinds) <= {"module", "application/json"}
    assert "<script>alert" not in page and read.images == 0 and read.code == []
