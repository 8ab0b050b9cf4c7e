"""The actuator of a joint in the text of an MJCF model: what a motor or a servo can hold of a verdict."""

from __future__ import annotations

from typing import Any

from hdagen.model_export.joint_numbers import JointNumbers
from hdagen.model_export.mjcf_document import write_number, write_numbers
from hdagen.model_export.xml_text import XmlElement

_WITH_OWN_FORCE = ("motor", "general")
_SERVO_GAINS = {"position": ("kp", "kv"), "velocity": ("", "kv"), "intvelocity": ("kp", "kv")}
_OF_REFERENCE = "the input of a servo is a reference, and this number belongs to its torque"


def is_servo(model: Any, k: int) -> bool:
    """Tell whether an actuator closes a loop on the joint's position or speed.

    Args:
        model: The compiled model.
        k: The actuator's index.

    Returns:
        Whether it does.

    """
    return bool(model.actuator_biasprm[k, 1:3].any())


def patch_motor(element: XmlElement, model: Any, k: int, old: JointNumbers, new: JointNumbers, key: str) -> str | None:
    """Correct a number of a motor, but its delay.

    Args:
        element: Its element.
        model: The compiled model.
        k: Its index there.
        old: The joint's numbers of the robot file.
        new: The corrected ones.
        key: The number's name.

    Returns:
        Why the element has no place for it; None where it has.

    """
    gear, gain = model.actuator_gear[k, 0], model.actuator_gainprm[k, 0]
    if key == "input_limit":
        most = new.input_limit * old.gain / (gear * gain)
        element.set_attribute("ctrlrange", write_numbers((-most, most)))
        element.set_attribute("ctrllimited", "true")
        return None
    if element.tag not in _WITH_OWN_FORCE:
        return f"a <{element.tag}> actuator has no place for it"
    element.new_tag = "general" if element.tag != "general" else None
    if key == "lag":
        element.set_attribute("dyntype", "filterexact")
        element.set_attribute("dynprm", write_number(new.lag))
    elif key == "gain":
        element.set_attribute("gainprm", write_number(gain * new.gain / old.gain))
    else:
        element.set_attribute("biastype", "affine")
        element.set_attribute("biasprm", write_numbers((new.bias / gear, 0.0, 0.0)))
    return None


def patch_servo(element: XmlElement, model: Any, k: int, old: JointNumbers, new: JointNumbers, key: str) -> str | None:
    """Correct a number of a servo: a gain of its torque is one of its gains, and a limit one of its force.

    Args:
        element: Its element.
        model: The compiled model.
        k: Its index there.
        old: The joint's numbers of the robot file.
        new: The corrected ones.
        key: The number's name.

    Returns:
        Why the element has no place for it; None where it has.

    """
    factor = new.gain / old.gain
    if key == "input_limit":
        most = abs(new.input_limit * new.gain / model.actuator_gear[k, 0])
        element.set_attribute("forcerange", write_numbers((-most, most)))
        element.set_attribute("forcelimited", "true")
        return None
    if key != "gain":
        return _OF_REFERENCE
    if element.tag == "general":
        element.set_attribute("gainprm", write_number(model.actuator_gainprm[k, 0] * factor))
        element.set_attribute("biasprm", write_numbers(model.actuator_biasprm[k, :3] * factor))
        return None
    if element.tag not in _SERVO_GAINS:
        return f"a <{element.tag}> actuator has no place for it"
    for name, gain in zip(_SERVO_GAINS[element.tag], -model.actuator_biasprm[k, 1:3] * factor, strict=True):
        if gain and name:
            element.set_attribute(name, write_number(gain))
    return None
