"""What a model's XML may not hold, said with its element before MuJoCo reads it: MuJoCo reads some of it in silence."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from xml.etree import ElementTree

from hdagen.support.messages import join_names, show_value

MOST_NESTING = 200  # of elements in one another, and of links that hang on one another
MOST_ELEMENTS = (
    10_000  # of all files of a model, with the copies that <replicate> and the like make: seconds of reading
)
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


def find_document_fault(root: ElementTree.Element, around: int = 0) -> str | None:
    """Find what no model may hold.

    Args:
        root: The parsed XML of a file.
        around: Elements around it in the file that includes it.

    Returns:
        The fault with its element and its cure, as the rest of a sentence; None where there is none.

    """
    depths = measure_depths(root)
    deepest = around + max(depths.values())
    if deepest > MOST_NESTING:
        last = next(element for element in root.iter() if around + depths[element] > MOST_NESTING)
        return (
            f"{_label(last)}: found elements {deepest} deep in one another, possible are {MOST_NESTING}; join the"
            " bodies that do not move against each other"
        )
    for element in root.iter():
        for key, value in element.attrib.items():
            if key not in NAMES and NOT_A_NUMBER.search(value):
                return f"{_label(element)}: found NaN in {key}, possible are numbers; correct it"
    return None


def count_elements(root: ElementTree.Element) -> float:
    """Count the elements that MuJoCo makes of a file.

    Args:
        root: The parsed XML of a file.

    Returns:
        Their number, with the copies that multiplying elements make; infinite where one multiplies an included file.

    """
    total, left = 0.0, [(root, 1.0)]
    while left:
        element, copies = left.pop()
        if element.tag == "include" and copies > 1:
            return math.inf  # whose own elements are not counted here
        if element.tag in MULTIPLIERS:
            for word in element.get("count", "1").split():
                number = float(word) if re.fullmatch(r"\d{1,15}", word) else 1.0
                copies = min(copies * max(number, 1.0), 1e15)
        total += copies
        left += [(child, copies) for child in element]
    return total


def measure_depths(root: ElementTree.Element) -> dict[ElementTree.Element, int]:
    """Measure how deep each element lies.

    Args:
        root: The parsed XML of a file.

    Returns:
        For each element the elements around it and itself.

    """
    depths = {root: 1}
    for element in root.iter():  # those around come first
        for child in element:
            depths[child] = depths[element] + 1
    return depths


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
    yield from _list_depth_faults(parents)


def _list_depth_faults(parents: dict[str, str]) -> Iterator[str]:
    """Links that hang on themselves, and those that hang on too many others; ``parents`` is of each link by name."""
    depths: dict[str, int] = {}
    for link in parents:
        path, at = dict[str, None](), link
        while at in parents and at not in depths:
            if at in path:
                yield f"link {show_value(link)} hangs on itself, possible is a tree; cut the loop"
                return
            path[at] = None
            at = parents[at]
        for one in reversed(path):
            depths[one] = depths.get(parents[one], 0) + 1
    deepest = max(depths.values(), default=0)
    if deepest > MOST_NESTING:
        last = next(link for link, depth in depths.items() if depth == deepest)
        yield (
            f"<link> {show_value(last)}: found {deepest} links that hang on one another, possible are {MOST_NESTING};"
            " join those that do not move against each other"
        )


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


def _label(element: ElementTree.Element) -> str:
    name = element.get("name")
    return f"<{element.tag}>" if name is None else f"<{element.tag}> {show_value(name)}"
