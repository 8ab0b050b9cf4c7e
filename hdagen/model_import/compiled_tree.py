"""A model as MuJoCo compiles it: bodies, joints and inertias as numbers, without anything that needs a mesh.

MuJoCo's own parser resolves defaults, classes, includes, orientations and inertias. Geometry, sensors and the rest are
taken out before, so that files of meshes need not be there.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdagen.model_import.model_file import ModelError, ModelFile
from hdagen.model_import.spec_preparation import replace_impossible_inertias, strip_geometry
from hdagen.model_import.stated_ranges import find_urdf_range, take_stuck_joints
from hdagen.support.messages import join_names
from hdagen.support.mujoco_warnings import collect_mujoco_warnings

Array = NDArray[np.float64]
JOINT_KINDS = {0: "free", 1: "ball", 2: "prismatic", 3: "revolute"}  # mjtJoint
TENSOR_ERROR = 1e-9  # of the largest entry, by which principal axes may differ from the six numbers
LARGEST_NUMBER = 1e12  # of a body or a frame, whose products then stay numbers
NO_LIMIT = 1e6  # from here on a limit stands for none: URDF demands one of every joint
NO_MUJOCO = "pip install 'hdagen[mujoco]'"


@dataclass(frozen=True)
class TreeJoint:
    """A joint of a body; vectors in the body's frame.

    Attributes:
        name: Its name; empty where it has none.
        kind: "revolute", "prismatic", "ball" or "free".
        place: (3), its anchor, m.
        axis: (3), unit vector.
        reference: Its position in the posture that the file shows.
        range: Its limits; None where it has none.
        is_stuck: Whether its limits are one point, so that it cannot move.
        torque: Its largest torque or force; None where the file states none.
        speed: Its largest speed; None where the file states none.
        armature: kg m² or kg.
        damping: N m s/rad or N s/m.
        friction: N m or N.
        is_servo: Whether an actuator of it closes a loop of its own.
        has_curve: Whether its damping is not linear.
        is_coupled: Whether an equation couples it to another joint.

    """

    name: str
    kind: str
    place: Array
    axis: Array
    reference: float
    range: tuple[float, float] | None
    is_stuck: bool
    torque: float | None
    speed: float | None
    armature: float
    damping: float
    friction: float
    is_servo: bool
    has_curve: bool
    is_coupled: bool


@dataclass(frozen=True)
class TreeBody:
    """A body; the frame in its parent's.

    Attributes:
        name: Its name.
        parent: Its parent's index; −1 for the world.
        position: (3), m.
        rotation: (3 × 3).
        mass: kg.
        center: (3), centre of mass, m.
        inertia: (3 × 3), about it, in the body's frame, kg m².
        joints: Its joints.
        sites: Position and rotation of its sites by name.
        is_looped: Whether an equation ties it to another body.

    """

    name: str
    parent: int
    position: Array
    rotation: Array
    mass: float
    center: Array
    inertia: Array
    joints: tuple[TreeJoint, ...]
    sites: dict[str, tuple[Array, Array]]
    is_looped: bool


@dataclass(frozen=True)
class Tree:
    """All bodies of a model, parents first; the world is the first.

    Attributes:
        name: The model's name.
        gravity: (3), in the world's frame, m/s².
        states_gravity: Whether the format states gravity.
        bodies: The bodies.
        notes: Sentences on parts that were left out.
        impossible: Names of the bodies of a URDF that state an inertia that no body has.

    """

    name: str
    gravity: Array
    states_gravity: bool
    bodies: tuple[TreeBody, ...]
    notes: tuple[str, ...]
    impossible: frozenset[str]


def compile_tree(file: ModelFile) -> Tree:
    """Compile a model.

    Args:
        file: The model file.

    Returns:
        Its bodies.

    Raises:
        ModelError: MuJoCo is missing or refuses the model, or a body's inertia would come from a mesh.

    """
    try:
        import mujoco
    except ImportError:
        raise ModelError(f"{file.label}: MuJoCo reads it, and is not installed; {NO_MUJOCO}.") from None
    with collect_mujoco_warnings() as told:
        return _compile_document(mujoco, file, told)


def _compile_document(mujoco: Any, file: ModelFile, told: list[str]) -> Tree:
    """The bodies of a model; ``told`` is what MuJoCo warns of meanwhile."""
    try:
        spec = mujoco.MjSpec.from_file(str(file.path))
    except (ValueError, RuntimeError, OSError) as error:
        raise ModelError(f"{file.label}: MuJoCo cannot read it ({_first_line(error)}); correct it there.") from None
    told.clear()  # of the reader, which warns of limits alone: they are looked at below
    notes = _check_elements(spec)
    forces = _find_actuators(spec)
    coupled, looped = _find_equations(spec)
    tensors = {body.name: _read_tensor(mujoco, body, file) for body in spec.bodies if body.name}
    try:
        stuck = take_stuck_joints(spec, file)
        weightless = strip_geometry(spec, file)
        impossible = replace_impossible_inertias(spec, tensors) - weightless if file.is_urdf else set[str]()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            model = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{file.label}: MuJoCo refuses it ({_first_line(error)}); correct it there.") from None
    said = dict.fromkeys(_first_line(one) for one in (*(str(one.message) for one in caught), *told))
    notes += [f"MuJoCo says: {one}" for one in said]
    _check_finite(model, file)
    if impossible:
        notes.append(f"counted as stated, though no body has such an inertia: {join_names(sorted(impossible))}")
    parts = _ModelParts(mujoco, model, file, forces, coupled, looped, stuck, weightless, impossible, tensors)
    bodies = tuple(_read_body(parts, index) for index in range(model.nbody))
    gravity = model.opt.gravity.copy()
    return Tree(spec.modelname, gravity, not file.is_urdf, bodies, tuple(notes), frozenset(impossible))


@dataclass(frozen=True)
class _ModelParts:
    """A compiled model, and by name of the joint or body what the document says beside it."""

    mujoco: Any
    model: Any
    file: ModelFile
    forces: dict[str, tuple[float | None, bool]]
    coupled: set[str]
    looped: set[str]
    stuck: dict[str, float]
    weightless: set[str]
    impossible: set[str]
    tensors: dict[str, Array | None]


def _read_body(parts: _ModelParts, index: int) -> TreeBody:
    mujoco, model = parts.mujoco, parts.model
    body = model.body(index)
    joints = tuple(_read_joint(parts, k) for k in np.flatnonzero(model.jnt_bodyid == index).tolist())
    weight = 0.0 if body.name in parts.weightless else float(model.body_mass[index])
    axes = _rotation(mujoco, model.body_iquat[index])
    inertia = axes @ np.diag(model.body_inertia[index]) @ axes.T * (body.name not in parts.weightless)
    tensor = parts.tensors.get(body.name)
    is_close = tensor is not None and np.allclose(tensor, inertia, 0, TENSOR_ERROR * np.abs(inertia).max())
    if tensor is not None and (is_close or body.name in parts.impossible):
        inertia = tensor  # as the file has it
    sites = {
        model.site(k).name: (model.site_pos[k].copy(), _rotation(mujoco, model.site_quat[k]))
        for k in np.flatnonzero(model.site_bodyid == index).tolist()
    }
    place, turned = model.body_pos[index].copy(), _rotation(mujoco, model.body_quat[index])
    parent = int(model.body_parentid[index]) if index else -1
    center = model.body_ipos[index].copy()
    return TreeBody(body.name, parent, place, turned, weight, center, inertia, joints, sites, body.name in parts.looped)


def _check_finite(model: Any, file: ModelFile) -> None:
    """Refuse a model with numbers that no arithmetic carries, at the first body or joint that has one."""
    of_bodies = ("body_pos", "body_quat", "body_mass", "body_ipos", "body_iquat", "body_inertia")
    of_joints = ("jnt_pos", "jnt_axis")
    for kind, count, names in (("body", model.nbody, of_bodies), ("joint", model.njnt, of_joints)):
        for k in range(count):
            if not all(_are_usable(getattr(model, name)[k]) for name in names):
                raise _refuse_number(file, f", {kind} {getattr(model, kind)(k).name}")
    if not (_are_usable(model.qpos0) and _are_usable(model.opt.gravity)):
        raise _refuse_number(file, "", " in <option> or ref")


def _refuse_number(file: ModelFile, element: str, place: str = "") -> ModelError:
    """The refusal of a number that no arithmetic carries."""
    found = f"NaN, infinity or a number beyond {LARGEST_NUMBER:g}{place}"
    return ModelError(f"{file.label}{element}: found {found}, possible are numbers; correct it.")


def _are_usable(numbers: Array) -> bool:
    return bool((np.abs(numbers) <= LARGEST_NUMBER).all())


def _first_line(error: Exception | str) -> str:
    """MuJoCo's words in one line, without its own advice of where it is."""
    return re.sub(r"\s+", " ", str(error)).removeprefix("Error: ").strip()[:300].rstrip(".")


def _rotation(mujoco: Any, quaternion: Array) -> Array:
    found = np.empty(9)
    mujoco.mju_quat2Mat(found, np.ascontiguousarray(quaternion))
    return found.reshape(3, 3)


def _read_tensor(mujoco: Any, body: Any, file: ModelFile) -> Array | None:
    """The inertia that a body states with six numbers, in the body's frame, kg m²; None where it states none.

    MuJoCo keeps the principal axes of it alone, with an error of about 1e-12. Raises ModelError where it is infinite.
    """
    xx, yy, zz, xy, xz, yz = (float(entry) for entry in body.fullinertia)
    if np.isnan(xx):
        return None
    if not _are_usable(np.asarray(body.fullinertia, float)):
        raise _refuse_number(file, f", body {body.name}")
    turned = _rotation(mujoco, np.asarray(body.iquat, float))
    return turned @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turned.T


def _check_elements(spec: Any) -> list[str]:
    """Sentences on elements that a chain does not take over."""
    said = {
        "keyframes": len(spec.keys), "tendons": len(spec.tendons), "contact pairs": len(spec.pairs),
        "flexible bodies": len(spec.flexes), "sensors": len(spec.sensors),
    }  # fmt: skip
    found = ", ".join(f"{count} {noun}" for noun, count in said.items() if count)
    return [f"left out: {found}"] if found else []


def _find_actuators(spec: Any) -> dict[str, tuple[float | None, bool]]:
    """For each joint with an actuator: the largest torque that it gives, and whether it closes a loop of its own."""
    found: dict[str, tuple[float | None, bool]] = {}
    for actuator in spec.actuators:
        if int(actuator.trntype) > 1:  # of a joint, or of a joint in its parent's frame
            continue
        gear, limit = abs(float(actuator.gear[0])) or 1.0, None
        servo = bool(np.any(np.asarray(actuator.biasprm)[1:3] != 0)) and int(actuator.biastype) != 0
        low, high = (float(end) for end in actuator.forcerange)
        if int(actuator.forcelimited) == 1 or (int(actuator.forcelimited) == 2 and low < high):
            limit = gear * min(abs(low), abs(high))
        elif not servo and float(actuator.ctrlrange[0]) < float(actuator.ctrlrange[1]):
            limit = gear * abs(float(actuator.gainprm[0])) * min(abs(float(end)) for end in actuator.ctrlrange)
        found[actuator.target] = (limit or None, servo)
    return found


def _find_equations(spec: Any) -> tuple[set[str], set[str]]:
    """Joints that an equation couples, and bodies that one ties to another."""
    joints: set[str] = set()
    bodies: set[str] = set()
    for equation in spec.equalities:
        names = {str(equation.name1), str(equation.name2)} - {""}
        if equation.type.name == "mjEQ_JOINT":
            joints |= names
        else:
            bodies |= names
    return joints, bodies


def _read_joint(parts: _ModelParts, k: int) -> TreeJoint:
    model, file = parts.model, parts.file
    joint = model.joint(k)
    kind, name = JOINT_KINDS[int(model.jnt_type[k])], str(joint.name)
    first = int(model.jnt_dofadr[k])
    limit, servo = parts.forces.get(name, (None, False))
    if model.jnt_actfrclimited[k]:
        stated = float(np.abs(model.jnt_actfrcrange[k]).min())
        if stated < NO_LIMIT:
            limit = min(stated, limit or stated) or None
    bounds = find_urdf_range(file, name)
    if name in parts.stuck:
        bounds = (parts.stuck[name], parts.stuck[name])
    elif model.jnt_limited[k] and np.abs(model.jnt_range[k]).max() < NO_LIMIT:
        bounds = (float(model.jnt_range[k][0]), float(model.jnt_range[k][1]))
    damping = np.atleast_1d(model.dof_damping[first])
    reference = 0.0
    if kind in ("revolute", "prismatic"):
        reference = float(model.qpos0[model.jnt_qposadr[k]])
    return TreeJoint(
        name,
        kind,
        model.jnt_pos[k].copy(),
        model.jnt_axis[k].copy(),
        reference,
        bounds,
        name in parts.stuck,
        limit,
        _find_speed(file, name),
        float(model.dof_armature[first]),
        float(damping[0]),
        float(model.dof_frictionloss[first]),
        servo,
        bool(np.any(damping[1:])),
        name in parts.coupled,
    )


def _find_speed(file: ModelFile, name: str) -> float | None:
    """The largest speed of a joint of a URDF, which MuJoCo does not read."""
    for joint in file.root.findall("joint"):
        limit = joint.find("limit")
        if joint.get("name") == name and limit is not None:
            try:
                speed = float(limit.get("velocity", "0"))
            except ValueError:
                return None
            return speed if 0 < speed < NO_LIMIT else None
    return None
