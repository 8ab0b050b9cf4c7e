"""An XML file whose attributes are changed in place: every other byte stays as it is."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape

from hdagen.arm.build_loader import PlantError
from hdagen.support.input_file import InputFileError, read_bytes
from hdagen.support.messages import make_printable, show_path

_MOST_XML_BYTES = 20_000_000  # bytes of a model; meshes lie in files of their own
_MOST_DEPTH = 500
_INCLUDE_TAGS = ("include", "mujocoinclude")
_ATTRIBUTE_PATTERN = re.compile(rb"""\s([A-Za-z_:][\w:.\-]*)\s*=\s*("[^"]*"|'[^']*')""")
_TAG_END_PATTERN = re.compile(rb""">|"[^"]*"|'[^']*'""")


@dataclass
class XmlElement:
    """An element: its tag, its attributes, the element around it (None: it is the root), and the bytes of its tags."""

    tag: str
    attributes: dict[str, str]
    parent: XmlElement | None
    begin: int
    end: int = 0
    closing: int = 0
    changed: dict[str, str] = field(default_factory=dict)
    removed: list[str] = field(default_factory=list)
    added_children: list[str] = field(default_factory=list)
    new_tag: str | None = None
    replacement: str | None = None
    wrapping: tuple[str, str] | None = None

    @property
    def container(self) -> XmlElement | None:
        """The element around it in the model, where files that are included count as their content."""
        around = self.parent
        while around is not None and around.tag in _INCLUDE_TAGS:
            around = around.parent
        return around

    def is_inside(self, tag: str) -> bool:
        """Tell whether an element around it has a tag.

        Args:
            tag: The tag.

        Returns:
            Whether one has.

        """
        around = self.parent
        while around is not None:
            if around.tag == tag:
                return True
            around = around.parent
        return False

    def set_attribute(self, name: str, value: str) -> None:
        """Change or add an attribute.

        Args:
            name: Its name.
            value: Its new value.

        """
        if self.attributes.get(name) != value:
            self.attributes[name] = self.changed[name] = value

    def remove_attribute(self, name: str) -> None:
        """Take an attribute out, if it is there.

        Args:
            name: Its name.

        """
        if self.attributes.pop(name, None) is not None:
            self.removed.append(name)

    def add_child(self, text: str) -> None:
        """Put an element in front of its content.

        Args:
            text: The element.

        """
        self.added_children.append(text)


class XmlText:
    """The file ``path``. Raises PlantError where it cannot be read as XML in UTF-8 without a document type."""

    def __init__(self, path: Path) -> None:
        self.path, self.elements = path, list[XmlElement]()
        try:
            self._content = read_bytes(path, _MOST_XML_BYTES, "name an XML file")
        except InputFileError as error:
            raise PlantError(error) from None
        self._open: list[XmlElement] = []
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._begin_element
        parser.EndElementHandler = self._end_element
        parser.StartDoctypeDeclHandler = self._refuse_doctype
        self._parser = parser
        try:
            self._content.decode("utf-8")
            parser.Parse(self._content, True)
        except (expat.ExpatError, UnicodeDecodeError) as error:
            why = make_printable(error)[:200]
            raise PlantError(f"{show_path(path)}: cannot be read as XML in UTF-8 ({why}); mend the file.") from None

    @property
    def is_changed(self) -> bool:
        """Whether an element has changed."""
        return any(self._list_edits(element) for element in self.elements)

    def to_bytes(self) -> bytes:
        """Write the file as it is now.

        Returns:
            Its bytes.

        """
        edits = [edit for element in self.elements for edit in self._list_edits(element)]
        content = self._content
        for begin, end, text in sorted(edits, reverse=True):
            content = content[:begin] + text + content[end:]
        return content

    def _begin_element(self, tag: str, attributes: dict[str, str]) -> None:
        begin = self._parser.CurrentByteIndex
        if len(self._open) >= _MOST_DEPTH:
            raise PlantError(f"{show_path(self.path)}: its elements are nested too deeply; name a model.")
        end = next(m.end() for m in _TAG_END_PATTERN.finditer(self._content, begin) if m[0] == b">")
        element = XmlElement(tag, dict(attributes), self._open[-1] if self._open else None, begin, end)
        self.elements.append(element)
        self._open.append(element)

    def _end_element(self, tag: str) -> None:
        self._open.pop().closing = self._parser.CurrentByteIndex

    def _refuse_doctype(self, *declared: object) -> None:
        raise PlantError(f"{show_path(self.path)}: it declares a document type, which no model needs; take it out.")

    def _list_edits(self, element: XmlElement) -> list[tuple[int, int, bytes]]:
        """Begin, end and new text of each change to an element."""
        edits = []
        if element.wrapping is not None:
            before, after = element.wrapping
            end = self._find_end(element)
            edits += [(element.begin, element.begin, before.encode()), (end, end, after.encode())]
        if element.replacement is not None:
            return [*edits, (element.begin, self._find_end(element), element.replacement.encode())]
        head = self._content[element.begin : element.end]
        found = {match[1].decode(): match for match in _ATTRIBUTE_PATTERN.finditer(head)}
        spans = {name: match.span(2) for name, match in found.items()}
        for name in element.removed:
            edits.append((element.begin + found[name].start(), element.begin + found[name].end(), b""))
        if element.added_children:
            edits.append(self._insert_children(element, head))
        for name, value in element.changed.items():
            text = escape(value, {'"': "&quot;"}).encode()
            if name in spans:
                low, high = spans[name]
                edits.append((element.begin + low + 1, element.begin + high - 1, text))
            else:
                at = element.end - (2 if head.endswith(b"/>") else 1)
                at -= len(head[: at - element.begin]) - len(head[: at - element.begin].rstrip())
                edits.append((at, at, b" " + name.encode() + b'="' + text + b'"'))
        if element.new_tag:
            edits.append((element.begin + 1, element.begin + 1 + len(element.tag.encode()), element.new_tag.encode()))
            if self._content[element.closing : element.closing + 2] == b"</":
                at = element.closing + 2
                edits.append((at, at + len(element.tag.encode()), element.new_tag.encode()))
        return edits

    def _find_end(self, element: XmlElement) -> int:
        """The byte after an element with all that is in it."""
        if self._content[element.closing : element.closing + 2] == b"</":
            return self._content.index(b">", element.closing) + 1
        return element.end

    def find_indent(self, element: XmlElement) -> str:
        """Find the blanks before an element that begins its line.

        Args:
            element: The element.

        Returns:
            The blanks; none where something else stands on its line.

        """
        line = self._content[: element.begin].rpartition(b"\n")[2]
        return "" if line.strip() else line.decode()

    def _insert_children(self, element: XmlElement, head: bytes) -> tuple[int, int, bytes]:
        """The edit that puts children in front of an element's content, each on a line of its own."""
        before = self._content[: element.begin]
        line = before[before.rfind(b"\n") + 1 :]
        indent = line[: len(line) - len(line.lstrip())]
        text = b"".join(b"\n" + indent + b"  " + child.encode() for child in element.added_children)
        if not head.endswith(b"/>"):
            return element.end, element.end, text
        return element.end - 2, element.end, b">" + text + b"\n" + indent + b"</" + element.tag.encode() + b">"
