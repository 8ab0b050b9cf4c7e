"""What a model's XML may not hold, said with its element before MuJoCo reads it: MuJoCo reads some of it in silence."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from xml.etree import ElementTree

from hdagen.support.messages import join_names, show_value

MOST_COPIES = 10_000  # that elements which multiply others make in all
NOT_A_NUMBER = re.compile(r"(^|\s)[+-]?nan($|\s)", re.IGNORECASE)
NAMES = frozenset(
    {
        "name",
        "class",
        "childclass",
        "file",
        "filename",
        "model",
        "link",
        "joint",
        "body",
        "site",
        "geom",
        "mesh",
        "target",
    }
)  # attributes that may hold any word
MULTIPLIERS = ("replicate", "composite", "flexcomp")


def find_document_fault(root: ElementTree.Element) -> str | None:
    """Find what no model may hold.

    Args:
        root: The parsed XML of a file.

    Returns:
        The fault with its element and its cure, as the rest of a sentence; None where there is none.

    """
    for element in root.iter():
        for key, value in element.attrib.items():
            if key not in NAMES and NOT_A_NUMBER.search(value):
                return f"{_label(element)}: found NaN in {key}, possible are numbers; correct it"
    copies = _count_copies(root, 1)
    if copies > MOST_COPIES:
        return f"found elements that make {copies:.6g} copies, possible are {MOST_COPIES}; leave them out"
    return None


def find_urdf_fault(root: ElementTree.Element) -> str | None:
    """Find what is no URDF: names that stand twice, loops, several roots, signs and limits that cannot be.

    Args:
        root: The parsed XML.

    Returns:
        The fault with its element and its cure, as the rest of a sentence; None where there is none.

    """
    return next((fault for fault in _list_urdf_faults(root)), None)


def _list_urdf_faults(root: ElementTree.Element) -> Iterator[str]:
    links, joints = root.findall("link"), root.findall("joint")
    for elements in (links, joints):
        for name, count in Counter(element.get("name", "") for element in elements).items():
            if count > 1:
                yield f"found {count} <{elements[0].tag}> with the name {show_value(name)}; give each its own"
    yield from _list_tree_faults(links, joints)
    for joint in joints:
        yield from _list_joint_faults(joint)
    for link in links:
        mass = _read_number(link.find("inertial/mass"), "value")
        if mass is not None and mass < 0:
            yield f"{_label(link)}: found the mass {mass:g} kg, possible are numbers from 0; correct <inertial>"


def _list_tree_faults(links: list[ElementTree.Element], joints: list[ElementTree.Element]) -> Iterator[str]:
    """Faults of how joints tie links together."""
    known = {link.get("name", "") for link in links}
    parents: dict[str, str] = {}
    for joint in joints:
        ends = [joint.find(tag) for tag in ("parent", "child")]
        names = ["" if end is None else end.get("link", "") for end in ends]
        for tag, name in zip(("parent", "child"), names, strict=True):
            if name not in known:
                yield f"{_label(joint)}: found the {tag} {show_value(name)}, possible is a <link> of the file; name one"
        parent, child = names
        if child in parents:
            yield f"{_label(joint)}: {show_value(child)} is another joint's child, too; give it one parent"
        parents[child] = parent
    roots = sorted(known - set(parents))
    if links and not roots:
        yield "every link is another one's child, possible is a tree with one root; cut the loop"
    if len(roots) > 1:
        yield f"found the roots {join_names(roots)}, possible is one; join the others to it, or remove them"
    for link in known & set(parents):
        seen, at = {link}, parents[link]
        while at in parents:
            if at in seen:
                yield f"link {show_value(link)} hangs on itself, possible is a tree; cut the loop"
                return
            seen.add(at)
            at = parents[at]


def _list_joint_faults(joint: ElementTree.Element) -> Iterator[str]:
    """Faults of one joint's numbers."""
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    for element, keys in ((limit, ("effort", "velocity")), (dynamics, ("damping", "friction"))):
        for key in keys:
            number = _read_number(element, key)
            if number is not None and number < 0:
                yield f"{_label(joint)}: found the {key} {number:g}, possible are numbers from 0; correct it"
    low, high = _read_number(limit, "lower"), _read_number(limit, "upper")
    if joint.get("type") in ("revolute", "prismatic") and low is not None and high is not None and low > high:
        yield f"{_label(joint)}: found the range {low:g} to {high:g}, possible is lower below upper; correct <limit>"
    parent = joint.find("parent")
    if joint.get("type") == "floating" and parent is not None and parent.get("link") != "world":
        yield f"{_label(joint)}: found the type floating, possible is one below the link world; make it fixed"


def _read_number(element: ElementTree.Element | None, key: str) -> float | None:
    """An attribute as a number; None where it is not there, and where it is no number, which MuJoCo says."""
    try:
        number = float("" if element is None else element.get(key, ""))
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _count_copies(element: ElementTree.Element, around: int) -> float:
    """The elements that multiplying ones make, those inside others by the product."""
    total = 0.0
    for child in element:
        inside: float = around
        if child.tag == "include" and around > 1:
            return math.inf  # whose own elements are not counted here
        if child.tag in MULTIPLIERS:
            for word in child.get("count", "1").split():
                number = float(word) if re.fullmatch(r"\d{1,15}", word) else 1.0
                inside = inside * max(number, 1.0)
            total = max(total, inside)
        total = max(total, _count_copies(child, int(min(inside, 1e15))))
    return total


def _label(element: ElementTree.Element) -> str:
    name = element.get("name")
    return f"<{element.tag}>" if name is None else f"<{element.tag}> {show_value(name)}"
