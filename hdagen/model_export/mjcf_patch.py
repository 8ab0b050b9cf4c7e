"""A MuJoCo model of the user with the corrected numbers in it, joint by joint by name; every other byte stays.

MuJoCo compiles the model first. So numbers that stand in defaults are read as MuJoCo reads them, and a model that has
other numbers than the robot file is refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.model_export.actuator_patch import is_servo, patch_motor, patch_servo
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import ExportedNumber
from hdagen.model_export.inertial_patch import MADE_ANEW, makes_masses_anew, patch_mjcf_body
from hdagen.model_export.joint_numbers import JointNumbers, RobotNumbers
from hdagen.model_export.link_changes import SAME_NUMBER, find_link_changes
from hdagen.model_export.mjcf_document import write_delay_attributes, write_number, write_numbers
from hdagen.model_export.model_text import ModelText
from hdagen.model_export.mujoco_machine import import_mujoco
from hdagen.model_export.number_changes import list_number_changes
from hdagen.model_export.spring_patch import patch_spring
from hdagen.model_export.xml_text import XmlElement
from hdagen.support.messages import join_names, join_nearest_names, show_path

OTHER_STRUCTURE = "it needs another structure of the model, which --into leaves as it is"
_LINK_QUANTITIES = ("mass", "center_of_mass", "inertia")
_JOINT_QUANTITIES = ("armature", "damping", "quadratic_damping", "frictionloss", "cable_stiffness", "cable_rest")
_MOTOR_QUANTITIES = ("gain", "bias", "input_limit", "delay", "lag")


@dataclass
class PatchedModel:
    """The content of each file, the numbers that changed, what a model of this structure cannot take, and notes."""

    files: dict[Path, bytes]
    changes: tuple[ExportedNumber, ...] = ()
    left_out: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def find_model_joints(model_path: Path, robot: CorrectedRobot) -> tuple[str, ...]:
    """Find the joints of a model that are the robot's, base first: those of its names, else all where as many.

    Args:
        model_path: The model.
        robot: The robot.

    Returns:
        Their names.

    Raises:
        PlantError: A joint is not there, or the robot file has no names and the model has another number of joints.

    """
    model = _compile_model(model_path)
    mujoco = import_mujoco()
    scalar = [
        model.joint(k).name
        for k in range(model.njnt)
        if model.jnt_type[k] in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    ]
    driven = [name for name in scalar if not name.endswith("_torsion")]
    if not robot.has_joint_names and not set(robot.joint_names) <= set(driven):
        if len(driven) == robot.file.n and all(driven):
            return tuple(driven)
        raise PlantError(
            f"{show_path(model_path)}: the robot has {robot.file.n} joint(s) without names and the model "
            f"{len(driven)} ({join_names(driven)}); say which they are by --joints."
        )
    for name in robot.joint_names:
        if name not in driven:
            raise PlantError(
                f"{show_path(model_path)}: there is no joint {name!r:.60}; it has {join_nearest_names([name], driven)}."
            )
    return robot.joint_names


def is_link_number(place: str) -> bool:
    """Tell whether a number belongs to the bodies or to gravity.

    Args:
        place: Where it stands, as ``joint.number``, "payload" or "gravity_x".

    Returns:
        Whether it does.

    """
    key = place.rpartition(".")[2]
    return place.startswith(("payload", "gravity_")) or key.startswith(_LINK_QUANTITIES)


def patch_model(path: Path, out: Path, before: RobotNumbers, after: RobotNumbers) -> PatchedModel:
    """Correct the numbers of a model.

    Args:
        path: The model.
        out: The place of the corrected one.
        before: The robot file's numbers, with the model's joint names.
        after: The corrected ones.

    Returns:
        The new files.

    Raises:
        PlantError: The model cannot be read, lacks a joint, has other numbers than the robot file, or holds nothing of
            the verdict.

    """
    model, text = _compile_model(path), ModelText(path)
    patch = _ModelPatch(text, model)
    changes = list_number_changes(before, after)
    patch.correct_links(before, after, [change.where for change in changes if is_link_number(change.where)])
    for change in changes:
        if is_link_number(change.where):
            continue
        place, _, key = change.where.partition(".")
        joints = zip(before.joints, after.joints, strict=True)
        pair = next(((old, new) for old, new in joints if new.name == place), None)
        if pair is not None and key in (*_JOINT_QUANTITIES, *_MOTOR_QUANTITIES, "sensor_delay"):
            patch.check_number(pair[0], key)
        elif not key.startswith("torsion."):
            patch.leave_out(change)
    for old, new in zip(before.joints, after.joints, strict=True):
        patch.correct_joint(old, new)
        patch.correct_motor(old, new)
        patch.correct_encoder(old, new)
        patch.correct_spring(old, new)
    written = tuple(change for change in changes if change.where not in patch.left_out)
    if changes and not written:
        raise PlantError(
            f"{show_path(path)}: it can hold nothing of the verdict ({join_names(list(patch.left_out))}); export a "
            "whole model, without --into."
        )
    return PatchedModel(text.write_files(out), written, patch.left_out, patch.notes)


def _compile_model(path: Path) -> Any:
    """The compiled model. Raises PlantError."""
    mujoco = import_mujoco()
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        why = " ".join(str(error).split())[:300]
        raise PlantError(
            f"{show_path(path)}: MuJoCo cannot load it ({why}); name a model that it loads, not a part of one."
        ) from None


class _ModelPatch:
    """The changes of one model: its text, and what MuJoCo compiled from it."""

    def __init__(self, text: ModelText, model: Any) -> None:
        self.text, self.model = text, model
        self.step = float(model.opt.timestep)
        self.has_stages = int(model.opt.integrator) == int(import_mujoco().mjtIntegrator.mjINT_RK4)
        self.left_out: dict[str, str] = {}
        self.notes: list[str] = []

    def leave_out(self, change: ExportedNumber, why: str | None = None) -> None:
        """Note that a number has no place in the model."""
        self.left_out[change.where] = f"{why or OTHER_STRUCTURE}."

    def correct_links(self, before: RobotNumbers, after: RobotNumbers, wanted: list[str]) -> None:
        """Change the bodies that the joints move, and gravity."""
        found = find_link_changes(self.text.path, before, after, wanted)
        if found.bodies and makes_masses_anew(self.text):
            bodies = [place for place in wanted if not place.startswith("gravity_")]
            found.left_out |= dict.fromkeys(bodies, MADE_ANEW)
            found.bodies = []
        for change in found.bodies:
            patch_mjcf_body(self.text, change)
        if found.gravity is not None:
            option = next((one for one in self.text.elements if one.tag == "option"), None)
            if option is None:
                self.text.main.elements[0].add_child(f'<option gravity="{write_numbers(found.gravity)}"/>')
            else:
                option.set_attribute("gravity", write_numbers(found.gravity))
        self.left_out |= {place: f"{why}." for place, why in found.left_out.items()}

    def read_numbers(self, joint: JointNumbers) -> dict[str, float]:
        """The numbers of a joint as MuJoCo compiled them."""
        model, at = self.model, self.model.joint(joint.name)
        dof, found = int(at.dofadr[0]), dict[str, float]()
        found["armature"], found["damping"] = float(model.dof_armature[dof]), float(model.dof_damping[dof])
        found["quadratic_damping"] = float(model.dof_dampingpoly[dof][0])
        found["frictionloss"] = float(model.dof_frictionloss[dof])
        found["cable_stiffness"] = float(model.jnt_stiffness[at.id])
        found["cable_rest"] = float(model.qpos_spring[int(at.qposadr[0])])
        k = self.find_actuator(joint)
        if k is not None:
            found["delay"] = float(model.actuator_delay[k])
            found["lag"] = float(model.actuator_dynprm[k, 0]) if model.actuator_actnum[k] else 0.0
        return found

    def check_number(self, joint: JointNumbers, key: str) -> None:
        """Refuse a model whose number differs from the robot file's. Raises PlantError."""
        found, stated = self.read_numbers(joint).get(key), getattr(joint, key)
        if key == "cable_rest" and not joint.cable_stiffness:
            return  # a spring that is not there has no rest
        if found is not None and not math.isclose(found, stated, rel_tol=SAME_NUMBER, abs_tol=1e-9):
            raise PlantError(
                f"{show_path(self.text.path)}: {key} of joint {joint.name!r:.60} is {found:.6g}, and the robot file "
                f"has {stated:.6g}: the model has changed since the diagnosis, or is of another robot; name the one "
                "that was diagnosed."
            )

    def find_actuator(self, joint: JointNumbers) -> int | None:
        """The actuator of a joint in the compiled model."""
        at = self.model.joint(joint.name).id
        for k in range(self.model.nu):
            if self.model.actuator_trntype[k] == 0 and self.model.actuator_trnid[k, 0] == at:
                return k
        return None

    def find_element(self, section: str, attributes: Mapping[str, str], tags: Sequence[str] = ()) -> XmlElement:
        """The element with these attributes in a section, in whichever file. Raises PlantError where there is none."""
        for element in self.text.elements:
            own = all(element.attributes.get(name) == value for name, value in attributes.items())
            in_section = element.is_inside(section) and not element.is_inside("default")
            if own and in_section and (not tags or element.tag in tags):
                return element
        what = " and ".join(f"{name}={value!r}" for name, value in attributes.items())
        raise PlantError(
            f"{show_path(self.text.path)}: no element with {what:.120} stands in <{section}>; give it plainly."
        )

    def correct_joint(self, old: JointNumbers, new: JointNumbers) -> None:
        """Change the attributes of a joint, and of its torsion."""
        changed = [key for key in _JOINT_QUANTITIES if getattr(old, key) != getattr(new, key)]
        if not changed:
            return
        element = self.find_element("worldbody", {"name": new.name}, ("joint",))
        for key in changed:
            if key in ("armature", "frictionloss"):
                element.set_attribute(key, write_number(getattr(new, key)))
            elif key in ("damping", "quadratic_damping"):
                further = f" {write_number(new.quadratic_damping)}" if new.quadratic_damping else ""
                element.set_attribute("damping", write_number(new.damping) + further)
            else:
                element.set_attribute("stiffness", write_number(new.cable_stiffness))
                rest = new.cable_rest if self._angles_in_radian or new.is_prismatic else math.degrees(new.cable_rest)
                element.set_attribute("springref", write_number(rest))
        if "frictionloss" in changed:
            self._note_creep(new)

    @property
    def _angles_in_radian(self) -> bool:
        """Whether the file states angles in rad; MuJoCo's default is degrees."""
        compilers = [element for element in self.text.elements if element.tag == "compiler"]
        return any(element.attributes.get("angle") == "radian" for element in compilers)

    def _note_creep(self, joint: JointNumbers) -> None:
        """Say where MuJoCo's dry friction creeps for long."""
        settle = float(self.model.dof_solref[int(self.model.joint(joint.name).dofadr[0])][0])
        if settle > 4 * self.step:
            self.notes.append(
                f"MuJoCo's dry friction of joint {joint.name!r:.60} creeps with a time constant of {settle:g} s "
                f'(solreffriction); solreffriction="{write_number(2 * self.step)} 1" lets it hold.'
            )

    def correct_motor(self, old: JointNumbers, new: JointNumbers) -> None:
        """Change the attributes of a joint's actuator."""
        changed = [key for key in _MOTOR_QUANTITIES if getattr(old, key) != getattr(new, key)]
        if not changed:
            return
        k = self.find_actuator(new)
        if k is None:
            for key in changed:
                self._leave_out_number(new, key, "the joint has no actuator")
            return
        element, servo = self.find_element("actuator", {"joint": new.name}), is_servo(self.model, k)
        states_ratio = any("dampratio" in one.attributes for one in self.text.elements)
        for key in changed:
            if key == "delay" and not servo:
                self._set_delay(element, new, new.delay, key)
                continue
            why: str | None = "a servo of the model states its damping as a ratio; state kv"
            if not servo:
                why = patch_motor(element, self.model, k, old, new, key)
            elif key != "gain" or not states_ratio:
                why = patch_servo(element, self.model, k, old, new, key)
            if why:
                self._leave_out_number(new, key, why)

    def correct_spring(self, old: JointNumbers, new: JointNumbers) -> None:
        """Change the spring of a joint, or put one in series."""
        if old.transmission == new.transmission or new.transmission is None:
            return
        joint = self.find_element("worldbody", {"name": new.name}, ("joint",))
        why = patch_spring(self.text, joint, new, is_new=old.transmission is None)
        if why:
            for key in ("linear", "cubic", "damping", "play"):
                self._leave_out_number(new, f"torsion.{key}", why)
        elif old.transmission is None:
            self.notes.append(
                f"{new.name}: its position is now the rotor's, and {new.name}_torsion is the link's against it; the "
                f"spring asks for a timestep below that of a rigid joint, which is {self.step:g} s here."
            )

    def correct_encoder(self, old: JointNumbers, new: JointNumbers) -> None:
        """Change the delay of a joint's position sensor."""
        if old.sensor_delay == new.sensor_delay:
            return
        sensors = [e for e in self.text.elements if e.tag == "jointpos" and e.attributes.get("joint") == new.name]
        if not sensors:
            self._leave_out_number(new, "sensor_delay", "the joint has no <jointpos> sensor")
            return
        self._set_delay(sensors[0], new, new.sensor_delay, "sensor_delay")

    def _set_delay(self, element: XmlElement, joint: JointNumbers, delay: float, key: str) -> None:
        """State a delay, in steps of the model."""
        attributes = write_delay_attributes(delay, self.step, self.has_stages and key == "delay")
        if not attributes:
            self._leave_out_number(joint, key, f"it is shorter than half the model's timestep of {self.step:g} s")
            return
        if delay < self.step * (1 - 1e-9):
            self.notes.append(f"{joint.name}: MuJoCo delays by a timestep at least, {self.step:g} s for {delay:.3g} s.")
        for entry in attributes.split():
            name, _, value = entry.partition("=")
            element.set_attribute(name, value.strip('"'))

    def _leave_out_number(self, joint: JointNumbers, key: str, why: str) -> None:
        self.left_out[f"{joint.name}.{key}"] = f"{why}."
