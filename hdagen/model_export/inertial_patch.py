"""Masses, centres and inertias of bodies in the text of an MJCF or URDF model."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hdagen.model_export.link_changes import BodyChange
from hdagen.model_export.link_numbers import INERTIA_ENTRIES, LinkBody
from hdagen.model_export.mjcf_document import write_inertial
from hdagen.model_export.model_text import ModelText
from hdagen.model_export.xml_text import XmlElement

MADE_ANEW = "the compiler of the model takes masses from shapes or scales them (inertiafromgeom, settotalmass)"
_ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
_DIGITS = 12  # of a number that is a sum of others
_SUM_ROUNDING = 1e-11


def makes_masses_anew(text: ModelText) -> bool:
    """Tell whether MuJoCo leaves the stated masses of a model aside.

    Args:
        text: The model.

    Returns:
        Whether it does.

    """
    compilers = [element.attributes for element in text.elements if element.tag == "compiler"]
    return any(one.get("inertiafromgeom") == "true" or "settotalmass" in one for one in compilers)


def patch_mjcf_body(text: ModelText, change: BodyChange) -> None:
    """Correct the body of an MJCF model that a joint moves.

    Args:
        text: The model.
        change: The change.

    Raises:
        PlantError: The joint is not written out.

    """
    body = text.find_named(("joint",), change.joint, "worldbody").container
    assert body is not None
    inertial, new = text.find_child(body, "inertial"), _round_body(change.new)
    if inertial is None:
        body.add_child(write_inertial(new))
        return
    if _differ((change.old.mass,), (new.mass,)):
        inertial.set_attribute("mass", _write((new.mass,)))
    if _differ(change.old.center, new.center):
        inertial.set_attribute("pos", _write(new.center))
    if _differ(change.old.inertia, new.inertia):
        for name in ("diaginertia", *_ORIENTATIONS):
            inertial.remove_attribute(name)
        inertial.set_attribute("fullinertia", _write(new.inertia))


def patch_urdf_link(text: ModelText, link: XmlElement, change: BodyChange) -> None:
    """Correct a link of a URDF.

    Args:
        text: The model.
        link: The link's element.
        change: The change.

    """
    inertial, new = text.find_child(link, "inertial"), _round_body(change.new)
    moments = " ".join(
        f'i{entry}="{_write((moment,))}"' for entry, moment in zip(INERTIA_ENTRIES, new.inertia, strict=True)
    )
    if inertial is None:
        link.add_child(
            f'<inertial><origin xyz="{_write(new.center)}"/><mass value="{_write((new.mass,))}"/>'
            f"<inertia {moments}/></inertial>"
        )
        return
    parts = {tag: text.find_child(inertial, tag) for tag in ("origin", "mass", "inertia")}
    origin, mass, inertia = parts["origin"], parts["mass"], parts["inertia"]
    assert mass is not None and inertia is not None  # MuJoCo has read the link
    if _differ((change.old.mass,), (new.mass,)):
        mass.set_attribute("value", _write((new.mass,)))
    turns = _differ(change.old.inertia, new.inertia)
    if origin is None and (turns or _differ(change.old.center, new.center)):
        inertial.add_child(f'<origin xyz="{_write(new.center)}"/>')
    elif origin is not None and _differ(change.old.center, new.center):
        origin.set_attribute("xyz", _write(new.center))
    if turns:
        if origin is not None:
            origin.remove_attribute("rpy")
        for entry, moment in zip(INERTIA_ENTRIES, new.inertia, strict=True):
            inertia.set_attribute(f"i{entry}", _write((moment,)))


def _round_body(body: LinkBody) -> LinkBody:
    """The body to the digits that are no rounding of sums."""
    largest = max(body.inertia)
    x, y, z = (_round(place, max(map(abs, body.center))) for place in body.center)
    return LinkBody(_round(body.mass, body.mass), (x, y, z), tuple(_round(one, largest) for one in body.inertia))


def _round(value: float, largest: float) -> float:
    if abs(value) <= _SUM_ROUNDING * largest * 1e-3:
        return 0.0
    return float(f"{value:.{_DIGITS}g}")


def _differ(old: Sequence[float], new: Sequence[float]) -> bool:
    size = max(map(abs, old), default=0.0)
    return any(
        not math.isclose(a, b, rel_tol=_SUM_ROUNDING, abs_tol=_SUM_ROUNDING * size)
        for a, b in zip(old, new, strict=True)
    )


def _write(values: Sequence[float]) -> str:
    return " ".join(f"{value:.{_DIGITS}g}" for value in values)
