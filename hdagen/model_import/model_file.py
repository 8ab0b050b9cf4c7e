"""A model file from outside: what it may hold, checked before MuJoCo sees it."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from hdagen.model_import.document_checks import (
    MOST_ELEMENTS,
    count_elements,
    find_document_fault,
    find_urdf_fault,
    measure_depths,
)
from hdagen.support.input_file import InputFileError, read_bytes
from hdagen.support.messages import make_printable, show_path, show_value

LARGEST_MODEL = 20_000_000  # bytes of all files of a model
MOST_TAGS = 10 * MOST_ELEMENTS  # of opened and closed elements and comments, by which a file is refused unread
MODEL_SUFFIXES = (".urdf", ".xml", ".mjcf", ".xacro")
DECLARATION = re.compile(rb"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)


class ModelError(Exception):
    """A model that cannot be imported; one printable sentence."""

    def __init__(self, text: str) -> None:
        super().__init__(make_printable(text))


@dataclass(frozen=True)
class ModelFile:
    """A model that may be read.

    Attributes:
        path: The file.
        label: Its name in sentences.
        is_urdf: Whether it is URDF; else it is MJCF.
        root: Its parsed XML, without the files that it includes.
        included: The files that it includes.

    """

    path: Path
    label: str
    is_urdf: bool
    root: ElementTree.Element
    included: tuple[Path, ...] = field(default=())


def is_model_file(robot: str | Path) -> bool:
    """Tell whether a robot is named by a URDF or MJCF file.

    Args:
        robot: A preset, or a path.

    Returns:
        True where the name ends as those of models do.

    """
    return Path(robot).suffix.lower() in MODEL_SUFFIXES


def read_model_file(path: str | Path) -> ModelFile:
    """Read a model file and those that it includes, as far as safety asks for it.

    Args:
        path: The file.

    Returns:
        The model file.

    Raises:
        ModelError: A file is missing, too large or no XML, declares entities, or lies outside the model's folder.

    """
    main = Path(path)
    label = show_path(main)
    if main.suffix.lower() == ".xacro":
        raise ModelError(f"{label}: found xacro, possible is URDF; expand it by `xacro {label} > model.urdf`.")
    raw = _read_part(main, 0)
    root = _parse_xml(raw, label)
    if root.tag not in ("robot", "mujoco"):
        raise ModelError(
            f"{label}: found the element {show_value(root.tag)} at the top, possible are <robot> and <mujoco>; name a"
            " URDF or an MJCF file."
        )
    if any("wiki/xacro}" in str(element.tag) for element in root.iter()):
        raise ModelError(f"{label}: found xacro, possible is URDF; expand it by `xacro {label} > model.urdf`.")
    reading = _Reading(main.resolve(), len(raw))
    reading.count(root, label)
    if root.tag == "robot" and (fault := find_urdf_fault(root)):
        raise ModelError(f"{label}: {fault}.")
    if root.tag == "mujoco":
        _follow_includes(reading, root, label, 0)
    return ModelFile(main, label, root.tag == "robot", root, tuple(reading.included))


@dataclass
class _Reading:
    """A model that is being read: its file, bytes and elements so far, and the files that it includes."""

    main: Path
    size: int
    elements: float = 0
    included: list[Path] = field(default_factory=list)

    def count(self, root: ElementTree.Element, label: str) -> None:
        """Count the elements of one more file, and refuse more than can be read in seconds."""
        self.elements += count_elements(root)
        if self.elements > MOST_ELEMENTS:
            raise ModelError(
                f"{label}: found {self.elements:.6g} elements, with the copies that <replicate> and the like make,"
                f" possible are {MOST_ELEMENTS}; leave out what the arm does not need."
            )


def _read_part(path: Path, before: int) -> bytes:
    """The content of a file of a model of which ``before`` bytes are read already."""
    try:
        return read_bytes(path, LARGEST_MODEL - before, "give a URDF or an MJCF file without data in it")
    except InputFileError as error:
        raise ModelError(str(error)) from None


def _parse_xml(raw: bytes, label: str, around: int = 0) -> ElementTree.Element:
    """The checked XML of a file that lies in ``around`` elements of another."""
    if DECLARATION.search(raw):
        raise ModelError(f"{label}: found a DOCTYPE or ENTITY, which no robot model needs; remove it.")
    if raw.count(b"<") > MOST_TAGS:
        raise ModelError(
            f"{label}: found more than {MOST_TAGS} tags, possible are {MOST_ELEMENTS} elements; leave"
            " out what the arm does not need."
        )
    if b"\0" in raw:
        raise ModelError(f"{label}: found text that is not in UTF-8; save it in UTF-8.")
    try:
        root = ElementTree.fromstring(raw)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ModelError(f"{label}: found text that is no XML ({error}); correct it there.") from None
    if fault := find_document_fault(root, around):
        raise ModelError(f"{label}: {fault}.")
    return root


def _follow_includes(reading: _Reading, root: ElementTree.Element, label: str, around: int) -> None:
    """Check every file that an MJCF includes, itself in ``around`` elements of others."""
    main, depths = reading.main, measure_depths(root)
    for element in root.iter():
        if element.tag not in ("include", "model") or element.get("file") is None:
            continue
        name = str(element.get("file"))
        found = (main.parent / name).resolve()
        if not found.is_relative_to(main.parent):
            raise ModelError(
                f"{label}: <{element.tag}> names {show_value(name)}, possible is a file in the model's folder; copy it"
                " there."
            )
        if found in (main, *reading.included):
            raise ModelError(f"{label}: <{element.tag}> names {show_value(name)} again; include each file once.")
        raw = _read_part(found, reading.size)
        reading.included.append(found)
        reading.size += len(raw)
        deep, own = around + depths[element] - 1, show_path(found)
        part = _parse_xml(raw, own, deep)
        if element.tag == "include" and part.tag == "robot":
            raise ModelError(
                f"{label}: <include> names {show_value(name)}, which is a URDF, possible is MJCF; convert it, or import"
                " it alone."
            )
        reading.count(part, own)
        _follow_includes(reading, part, own, deep)
