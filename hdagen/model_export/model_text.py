"""The text of a model in all its files: an MJCF with those that it includes, or a URDF; every other byte stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hdagen.arm.build_loader import PlantError
from hdagen.model_export.xml_text import XmlElement, XmlText
from hdagen.model_import.model_file import ModelError, read_model_file
from hdagen.support.messages import show_path, show_value


@dataclass
class _IncludedText:
    """A file that a model includes, and the element that names it."""

    name: str
    text: XmlText
    element: XmlElement


class ModelText:
    """The files of the model ``path``. Raises PlantError where one cannot be read or lies outside its folder."""

    def __init__(self, path: Path) -> None:
        self.path, self.main = path, XmlText(path)
        try:
            read_model_file(path)
        except ModelError as error:
            raise PlantError(str(error)) from None
        self.included: list[_IncludedText] = []
        self._follow_includes(self.main)
        self.texts = [self.main, *(one.text for one in self.included)]
        self.elements = [element for text in self.texts for element in text.elements]

    def find_child(self, parent: XmlElement, tag: str) -> XmlElement | None:
        """Find an element right inside another one, in whichever file.

        Args:
            parent: The element around it.
            tag: Its tag.

        Returns:
            The first such element; None where there is none.

        """
        return next((one for one in self.elements if one.tag == tag and one.container is parent), None)

    def find_named(self, tags: Sequence[str], name: str, section: str | None = None) -> XmlElement:
        """Find an element by its name.

        Args:
            tags: The tags that it may have.
            name: Its name.
            section: A tag of an element around it; None: any.

        Returns:
            The element.

        Raises:
            PlantError: There is none.

        """
        for element in self.elements:
            own = element.tag in tags and element.attributes.get("name") == name
            if own and (section is None or element.is_inside(section)) and not element.is_inside("default"):
                return element
        raise PlantError(
            f"{show_path(self.path)}: found no <{tags[0]}> with the name {show_value(name)}, possible is one that is"
            " written out; write it into the model."
        )

    def write_files(self, out: Path) -> dict[Path, bytes]:
        """Write the files as they are now. A file that is included and changed gets a new name beside its old one.

        Args:
            out: The place of the model's main file.

        Returns:
            The content of every file to write, the main one last.

        """
        files: dict[Path, bytes] = {}
        for one in reversed(self.included):  # inner files first: their new names stand in the outer ones
            if one.text.is_changed:
                place = Path(one.name)
                name = place.with_name(f"{place.stem}_{out.stem}{place.suffix}")
                one.element.set_attribute("file", name.as_posix())
                files[out.parent / name] = one.text.to_bytes()
        return files | {out: self.main.to_bytes()}

    def _follow_includes(self, text: XmlText) -> None:
        for element in text.elements:
            if element.tag == "include" and "file" in element.attributes:
                name = element.attributes["file"]
                inner = XmlText(self.path.parent / name)
                inner.elements[0].parent = element
                inner.elements[0].tag = "mujocoinclude"
                self.included.append(_IncludedText(name, inner, element))
                self._follow_includes(inner)
