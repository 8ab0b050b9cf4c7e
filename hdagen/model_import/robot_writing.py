"""A chain out of a model as the text of a robot file, each number with its source."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.model_import.chain_reduction import Chain, ChainLink, ChainRequest, reduce_tree
from hdagen.model_import.compiled_tree import Array, Tree, compile_tree
from hdagen.model_import.model_file import ModelError, ModelFile, read_model_file
from hdagen.model_import.possible_inertia import is_possible_inertia
from hdagen.model_import.step_choice import choose_step
from hdagen.support.messages import make_printable, show_value

FORBIDDEN_LETTERS = re.compile(r"[^A-Za-z0-9_.-]")
MOMENT_TOLERANCE = 1e-6  # share of the sum of the others by which a rounded moment may be above it
RISE_TIME = 0.01  # s, in which a drive reaches its largest torque
LARGEST_DISTANCE, LARGEST_MASS, LARGEST_INERTIA = 100.0, 1e4, 1e4  # m, kg and kg m²: the ranges of a robot file
SMOOTHING = 0.01  # rad/s (m/s): the robot file's own default at ratio 1


@dataclass(frozen=True)
class ImportedRobot:
    """A model as a robot file.

    Attributes:
        text: The file.
        notes: Sentences on what was assumed, left out or held.

    """

    text: str
    notes: tuple[str, ...]


def import_model(path: str, request: ChainRequest | None = None) -> ImportedRobot:
    """Import a URDF or MJCF model.

    Args:
        path: The file.
        request: Base, tip and joints that are wanted; None: what the model suggests.

    Returns:
        The robot file's text, and what was assumed.

    Raises:
        ModelError: The model cannot be imported; one sentence.

    """
    file = read_model_file(path)
    tree = compile_tree(file)
    chain = reduce_tree(tree, request or ChainRequest(), file.label)
    _check_numbers(chain, file)
    return _write_robot(file, tree, chain)


def _check_numbers(chain: Chain, file: ModelFile) -> None:
    """Refuse numbers that are not finite, and inertias that no body can have, at their link."""
    for link in chain.links:
        where = f"{file.label}, joint {link.joint.name}"
        numbers: list[Any] = [link.origin, link.rotation, link.center, link.inertia, [link.mass, link.joint.armature]]
        if not np.isfinite(np.concatenate([np.ravel(part) for part in numbers])).all():
            raise ModelError(f"{where}: found NaN or infinity in its frame or body, possible are numbers; correct it.")
        _check_sizes(where, link)
        if not is_possible_inertia(link.inertia, MOMENT_TOLERANCE):
            shown = ", ".join(f"{moment:.4g}" for moment in np.linalg.eigvalsh(link.inertia))
            bodies = ", ".join(link.bodies)
            raise ModelError(
                f"{where}: found the principal moments {shown} kg m² of {bodies}, possible are moments above 0 and"
                " none above the sum of the others; correct <inertial>."
            )


def _check_sizes(where: str, link: ChainLink) -> None:
    """Refuse what no robot file may state, at its joint."""
    joint = link.joint
    for name, value in (("armature", joint.armature), ("damping", joint.damping), ("friction", joint.friction)):
        if not 0 <= value < np.inf:
            raise ModelError(f"{where}: found the {name} {value:g}, possible are numbers from 0; correct it.")
    for noun, numbers, most, unit in (
        ("distance", [*link.origin, *link.center], LARGEST_DISTANCE, "m"),
        ("mass", [link.mass], LARGEST_MASS, "kg"),
        ("inertia", np.ravel(link.inertia), LARGEST_INERTIA, "kg m²"),
    ):
        found = float(np.abs(numbers).max())
        if found > most:
            raise ModelError(
                f"{where}: found the {noun} {found:.4g} {unit}, possible are {most:g} {unit}; state it in SI units."
            )


def _write_robot(file: ModelFile, tree: Tree, chain: Chain) -> ImportedRobot:
    notes = [*chain.notes, *tree.notes]
    step, widths = choose_step(chain)
    name = file.path.stem[:60]
    label = re.sub(r"[^A-Za-z0-9 _.,()+-]", "_", tree.name or name)[:60].strip() or "robot"
    if not label[0].isalpha():
        label = f"robot {label}"
    if not tree.states_gravity:
        notes.append("assumed: gravity of 9.81 m/s² against z of the root link, as URDF states none")
    gravity = "<option gravity>" if tree.states_gravity else "assumed: URDF states none"
    lines = [
        f"# {chain.base} to {chain.tip} of {_name_source(file)}, by `hdagen robot import`",
        *(f"# {_print_comment(note)}" for note in notes),
        "",
        _write_line("name", f'"{label}"', "label"),
        _write_line("gravity", _write_vector(chain.gravity), f"in the frame of {chain.base}; {gravity}"),
        _write_line("step", repr(step), "assumed: carries friction and damping"),
    ]
    used: dict[str, str] = {}
    for link, width in zip(chain.links, widths, strict=True):
        lines += _write_joint(file, link, width, used, notes)
    lines += ["", "[tip]", _write_line("origin", _write_vector(chain.tip_origin), f"of {chain.tip}")]
    lines.append(_write_line("rotation", _write_vector(make_quaternion(chain.tip_rotation)), f"of {chain.tip}"))
    return ImportedRobot("\n".join(lines) + "\n", tuple(make_printable(note) for note in notes))


def _write_joint(file: ModelFile, link: ChainLink, width: float, used: dict[str, str], notes: list[str]) -> list[str]:
    joint = link.joint
    name = FORBIDDEN_LETTERS.sub("_", joint.name)[:64]
    if not name[0].isalpha():
        name = f"j{name}"[:64]
    if name in used:
        raise ModelError(f"{file.label}: found the joints {joint.name} and {used[name]}; give each its own letters.")
    used[name] = joint.name
    if name != joint.name:
        notes.append(f"assumed: joint {show_value(joint.name)} is called {name}")
    bodies = ", ".join(link.bodies)
    body = f"<inertial> of {bodies}"
    if len(link.bodies) > 1:
        body = f"<inertial> of {bodies}, welded"
    xx, yy, zz = np.diag(link.inertia)
    inertia = [xx, yy, zz, link.inertia[0, 1], link.inertia[0, 2], link.inertia[1, 2]]
    lines = [
        "",
        "[[joint]]",
        _write_line("name", f'"{name}"', _name_source(file)),
        _write_line("type", f'"{joint.kind}"', _name_source(file)),
        _write_line("origin", _write_vector(link.origin), "frames between the joints"),
        _write_line("rotation", _write_vector(make_quaternion(link.rotation)), "frames between the joints"),
        _write_line("axis", _write_vector(joint.axis), "<axis>" if file.is_urdf else "axis of the joint"),
        _write_line("mass", repr(link.mass), body),
        _write_line("center_of_mass", _write_vector(link.center), body),
        _write_line("inertia", _write_vector(inertia), body),
        "[joint.drive]",
        _write_line("rigid", "true", "assumed: a model knows no springs of a gear"),
        _write_line("ratio", "1.0", "assumed: input and friction are the joint's"),
        *_write_drive(file, link, width, notes),
    ]
    limits = []
    for key, value, source in (
        ("position", joint.range and _write_vector(joint.range), "range"),
        ("speed", joint.speed and repr(joint.speed), "<limit velocity>"),
        ("torque", joint.torque and repr(joint.torque), "<limit effort>" if file.is_urdf else "force range"),
        ("motor_torque_rate", joint.torque and repr(joint.torque / RISE_TIME), "assumed: all of the torque in 10 ms"),
    ):
        if value:
            limits.append(_write_line(key, str(value), source))
    if joint.range is None:
        notes.append(f"joint {name} states no range")
    return [*lines, *(["[joint.limits]", *limits] if limits else [])]


def _write_drive(file: ModelFile, link: ChainLink, width: float, notes: list[str]) -> list[str]:
    joint, dynamics = link.joint, "<dynamics>" if file.is_urdf else "joint"
    armature = "assumed: URDF states none" if file.is_urdf else "armature"
    silent = "a model that says nothing of friction is a guess of zero"
    if joint.has_curve:
        notes.append(f"left out: the part of the damping of {joint.name} that is not linear")
    if joint.is_servo:
        notes.append(f"left out: the servo of {joint.name}; the input is its torque")
    return [
        _write_line("motor_inertia", _write_guess(joint.armature), armature),
        _write_line(
            "viscous_friction",
            _write_guess(joint.damping),
            f"{dynamics} damping" if joint.damping else f"assumed: {silent}",
        ),
        _write_line(
            "coulomb_friction",
            _write_guess(joint.friction),
            f"{dynamics} friction" if joint.friction else f"assumed: {silent}",
        ),
        *(
            [_write_line("friction_smoothing", repr(width), "assumed: carried by the step")]
            if width > SMOOTHING
            else []
        ),
    ]


def _name_source(file: ModelFile) -> str:
    return make_printable(file.path.name)


def _print_comment(text: str) -> str:
    return make_printable(text)[:400]


def _write_line(key: str, value: str, source: str) -> str:
    return f"{key} = {value}".ljust(40) + f"  # {_print_comment(source)}"


def _write_guess(value: float) -> str:
    """Write a number that a model rarely has from a measurement; 0 stands for nothing known, without a source."""
    return f'{{value = {value!r}, source = "guess"}}' if value else "0.0"


def _write_vector(values: Iterable[float]) -> str:
    return "[" + ", ".join(repr(float(value) + 0.0) for value in values) + "]"


def make_quaternion(rotation: Array) -> list[float]:
    """Make the unit quaternion of a rotation.

    Args:
        rotation: (3 × 3).

    Returns:
        w, x, y, z, the first that is not 0 above 0.

    """
    m = rotation
    squares = np.array([1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2],
                        1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]])  # fmt: skip
    products = np.array([
        [squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
        [m[2, 1] - m[1, 2], squares[1], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
        [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], squares[2], m[1, 2] + m[2, 1]],
        [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[3]],
    ])  # fmt: skip
    found = products[int(np.argmax(squares))]
    found = found / np.linalg.norm(found)
    first = found[np.flatnonzero(found)[0]]
    return [float(entry) for entry in found * np.sign(first)]
