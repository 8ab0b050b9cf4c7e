"""A URDF of the user with the corrected numbers in it, joint by joint by name; every other byte stays."""

from __future__ import annotations

import math
from pathlib import Path

from hdagen.arm.build_loader import PlantError
from hdagen.model_export.inertial_patch import patch_urdf_link
from hdagen.model_export.joint_numbers import JointNumbers, RobotNumbers
from hdagen.model_export.link_changes import SAME_NUMBER, find_link_changes
from hdagen.model_export.mjcf_document import write_number
from hdagen.model_export.mjcf_patch import PatchedModel, is_link_number
from hdagen.model_export.model_text import ModelText
from hdagen.model_export.number_changes import list_number_changes
from hdagen.model_export.xml_text import XmlElement
from hdagen.support.messages import join_names, show_path

NO_PLACE = "it has no place in URDF; export mjcf or json."
_DYNAMICS = {"damping": "damping", "frictionloss": "friction"}


def patch_urdf(path: Path, out: Path, before: RobotNumbers, after: RobotNumbers) -> PatchedModel:
    """Correct the numbers of a URDF.

    Args:
        path: The URDF.
        out: The place of the corrected one.
        before: The robot file's numbers, with the URDF's joint names.
        after: The corrected ones.

    Returns:
        The new file.

    Raises:
        PlantError: The URDF cannot be read, lacks a joint, has other numbers than the robot file, or holds nothing of
            the verdict.

    """
    text = ModelText(path)
    if text.main.elements[0].tag != "robot":
        raise PlantError(f"{show_path(path)}: is no URDF; export mjcf into an MJCF model.")
    elements = {joint.name: text.find_named(("joint",), joint.name) for joint in before.joints}
    changes, left_out = list_number_changes(before, after), dict[str, str]()
    found = find_link_changes(path, before, after, [one.where for one in changes if is_link_number(one.where)])
    left_out |= {place: f"{why}." for place, why in found.left_out.items()}
    for change in found.bodies:
        patch_urdf_link(text, _find_link(text, elements[change.joint]), change)
    for number in changes:
        place, _, key = number.where.rpartition(".")
        if is_link_number(number.where):
            continue
        if key not in _DYNAMICS:
            left_out[number.where] = NO_PLACE
            continue
        pair = next((old, new) for old, new in zip(before.joints, after.joints, strict=True) if new.name == place)
        _patch_dynamics(text, elements[place], *pair, key)
    written = tuple(change for change in changes if change.where not in left_out)
    if changes and not written:
        raise PlantError(
            f"{show_path(path)}: it can hold nothing of the verdict ({join_names(list(left_out))}); export mjcf."
        )
    return PatchedModel(text.write_files(out), written, left_out)


def _find_link(text: ModelText, joint: XmlElement) -> XmlElement:
    """The link that a joint moves."""
    child = text.find_child(joint, "child")
    assert child is not None  # MuJoCo has read the joint
    return text.find_named(("link",), child.attributes["link"])


def _patch_dynamics(text: ModelText, joint: XmlElement, old: JointNumbers, new: JointNumbers, key: str) -> None:
    """Correct damping or friction of a joint. Raises PlantError where the URDF has another number."""
    dynamics, name = text.find_child(joint, "dynamics"), _DYNAMICS[key]
    stated = 0.0 if dynamics is None else float(dynamics.attributes.get(name, "0"))
    if not math.isclose(stated, getattr(old, key), rel_tol=SAME_NUMBER, abs_tol=1e-9):
        raise PlantError(
            f"{show_path(text.path)}: {name} of joint {old.name!r:.60} is {stated:.6g}, and the robot file has "
            f"{getattr(old, key):.6g}: the model has changed since the diagnosis, or is of another robot; name the one "
            "that was diagnosed."
        )
    value = write_number(getattr(new, key))
    if dynamics is None:
        joint.add_child(f'<dynamics {name}="{value}"/>')
    else:
        dynamics.set_attribute(name, value)
