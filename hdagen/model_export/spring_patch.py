"""A spring in series with a joint, in the text of an MJCF model.

The joint moves to a body around the one that it moved, without a mass of its own: it turns the rotor. In its place
stands ``NAME_torsion``, by which the link turns against the rotor.
"""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from hdagen.model_export.joint_numbers import JointNumbers
from hdagen.model_export.link_numbers import LinkBody
from hdagen.model_export.mjcf_document import write_inertial, write_number, write_numbers
from hdagen.model_export.model_text import ModelText
from hdagen.model_export.xml_text import XmlElement

PLAY = "a play needs a tendon, which --into does not write; export a whole model"
NO_TORSION = "the model has no joint {}_torsion for it"
CABLE = "the joint has a spring to the base, which would then act on the rotor; export a whole model"
KEYFRAMES = "the keyframes of the model would have a number too few; take them out"
_PLACEMENT = ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")
_GEOMETRY = ("type", "axis", "pos", "class")


def patch_spring(text: ModelText, joint: XmlElement, numbers: JointNumbers, is_new: bool) -> str | None:
    """Correct the spring of a joint, or put one in series.

    Args:
        text: The model.
        joint: The joint's element.
        numbers: The joint's numbers, with the spring.
        is_new: Whether the robot file has none.

    Returns:
        Why the model cannot take it; None where it can.

    """
    spring = numbers.transmission
    assert spring is not None
    name = f"{numbers.name}_torsion"
    there = next((one for one in text.elements if one.tag == "joint" and one.attributes.get("name") == name), None)
    if spring.play:
        return PLAY
    if there is not None:
        there.set_attribute("stiffness", _write_stiffness(numbers))
        there.set_attribute("damping", write_number(spring.damping))
        return None
    if not is_new:
        return NO_TORSION.format(numbers.name)
    if numbers.cable_stiffness:
        return CABLE
    if any(element.tag == "key" for element in text.elements):
        return KEYFRAMES
    _insert_spring(text, joint, numbers)
    return None


def _insert_spring(text: ModelText, joint: XmlElement, numbers: JointNumbers) -> None:
    """Put a body around the joint's, and the torsion in the joint's place."""
    body = joint.container
    assert body is not None and numbers.transmission is not None
    outer = {"name": f"{body.attributes.get('name') or numbers.name}_rotor"}
    outer |= {key: body.attributes[key] for key in ("childclass", *_PLACEMENT) if key in body.attributes}
    for key in _PLACEMENT:
        body.remove_attribute(key)
    torsion = {"name": f"{numbers.name}_torsion"}
    torsion |= {key: joint.attributes[key] for key in _GEOMETRY if key in joint.attributes}
    torsion |= {"stiffness": _write_stiffness(numbers), "damping": write_number(numbers.transmission.damping)}
    torsion |= {"armature": "0", "frictionloss": "0", "limited": "false", "actuatorfrclimited": "false"}  # no default's
    indent = next(one.find_indent(body) for one in text.texts if body in one.elements)
    lines = [
        _write_tag("body", outer),
        f"  {_write_tag('joint', joint.attributes, '/')}",
        f"  {write_inertial(LinkBody(0.0))}",
    ]
    body.wrapping = (f"\n{indent}".join([*lines, ""]), f"\n{indent}</body>")
    joint.replacement = _write_tag("joint", torsion, "/")


def _write_stiffness(numbers: JointNumbers) -> str:
    spring = numbers.transmission
    assert spring is not None
    return write_numbers((spring.linear, 0.0, spring.cubic) if spring.cubic else (spring.linear,))


def _write_tag(tag: str, attributes: dict[str, str], end: str = "") -> str:
    return f"<{tag}{''.join(f' {key}={quoteattr(value)}' for key, value in attributes.items())}{end}>"
