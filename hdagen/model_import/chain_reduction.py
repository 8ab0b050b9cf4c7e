"""A tree of bodies reduced to one chain from base to tip, everything else welded to it where it is held.

Legend: R rotation, o origin; the frame of a joint is its body's, moved to the joint's anchor, at position 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from hdagen.model_import.compiled_tree import Array, Tree, TreeBody, TreeJoint
from hdagen.model_import.model_file import ModelError
from hdagen.support.messages import join_names, join_nearest_names, show_value, suggest_name

MOST_JOINTS = 12
MOST_NEAR_NAMES = 12  # of links and sites that a sentence lists
MOST_GRIPPER_JOINTS = 2  # of each branch that hangs on the last link of a chain
ROUNDING = 1e-14
RIGHT_ANGLE_ERROR = 1e-11  # of an entry of a rotation that a model meant as 0 or ±1


@dataclass(frozen=True)
class ChainRequest:
    """What a caller wants of a model: base, tip and joints by name, each None by default, and where others are held."""

    base: str | None = None
    tip: str | None = None
    joints: tuple[str, ...] | None = None
    held: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class ChainLink:
    """A joint of the chain with everything that it carries, in the joint's frame.

    Attributes:
        joint: The joint.
        origin: (3), in the frame before, m.
        rotation: (3 × 3), the same.
        mass: kg.
        center: (3), m.
        inertia: (3 × 3), about the centre of mass, kg m².
        bodies: Names of the bodies that are in it.

    """

    joint: TreeJoint
    origin: Array
    rotation: Array
    mass: float
    center: Array
    inertia: Array
    bodies: tuple[str, ...]


@dataclass(frozen=True)
class Chain:
    """A chain out of a tree.

    Attributes:
        links: Its links, base first.
        base: The name of its base.
        tip: The name of its tip.
        tip_origin: (3), in the last joint's frame, m.
        tip_rotation: (3 × 3), the same.
        gravity: (3), in the base's frame, m/s².
        notes: Sentences on what was assumed.

    """

    links: tuple[ChainLink, ...]
    base: str
    tip: str
    tip_origin: Array
    tip_rotation: Array
    gravity: Array
    notes: tuple[str, ...]


class _Reduction:
    """A tree with the request, and the sentences found so far."""

    def __init__(self, tree: Tree, request: ChainRequest, label: str) -> None:
        self.bodies, self.request, self.label = tree.bodies, request, label
        self.notes: list[str] = []
        self.children: dict[int, list[int]] = {k: [] for k in range(len(tree.bodies))}
        for k, body in enumerate(tree.bodies):
            if body.parent >= 0:
                self.children[body.parent].append(k)
        known = {joint.name for body in tree.bodies for joint in body.joints}
        for name in (*(request.joints or ()), *(name for name, _ in request.held)):
            if name not in known:
                meant = f"{show_value(name)}{suggest_name(name, known)}"
                near = join_nearest_names([name], sorted(known - {""}), MOST_NEAR_NAMES)
                self.refuse(f"found no joint named {meant}, possible are {near}; name one of them")
        self.held = dict(request.held)
        self.moving = [len(body.joints) for body in self.bodies]  # joints of each body and of all that it carries
        for k in range(len(self.bodies) - 1, 0, -1):  # parents come first
            self.moving[self.bodies[k].parent] += self.moving[k]

    def refuse(self, sentence: str) -> NoReturn:
        """Raise a sentence on the model."""
        raise ModelError(f"{self.label}: {sentence}.")

    def find_body(self, name: str, option: str) -> tuple[int, tuple[Array, Array]]:
        """A body by its name or a site's, and the frame that is meant in it."""
        named: list[tuple[int, tuple[Array, Array]]] = []
        for k, body in enumerate(self.bodies):
            if body.name == name:
                named.append((k, (np.zeros(3), np.eye(3))))
            elif name in body.sites:
                named.append((k, body.sites[name]))
        if named:
            return named[0]
        known = [body.name for body in self.bodies] + [site for body in self.bodies for site in body.sites]
        near = join_nearest_names([name], [one for one in known if one], MOST_NEAR_NAMES)
        return self.refuse(
            f"{option} names no link or site: found {show_value(name)}{suggest_name(name, known)}, possible are {near};"
            " name one of them"
        )

    def find_tip(self, base: int) -> int:
        """The last body before the tree branches; fingers behind it are a gripper."""
        at, joints_before = base, 0
        while True:
            moving = [child for child in self.children[at] if self.moving[child]]
            if not moving:
                return at
            if len(moving) == 1:
                at = moving[0]
                joints_before += len(self.bodies[at].joints)
                continue
            if joints_before and all(self.moving[child] <= MOST_GRIPPER_JOINTS for child in moving):
                return at
            names = join_names([self.bodies[k].name for k in range(len(self.bodies)) if not self.children[k]])
            self.refuse(f"found a tree with several tips, possible is one chain; name its end by --tip, of {names}")

    def path_between(self, base: int, tip: int) -> list[int]:
        """The bodies from below the base to the tip."""
        path, at = [], tip
        while at not in (base, -1):
            path.append(at)
            at = self.bodies[at].parent
        if at != base:
            self.refuse(
                f"{self.bodies[tip].name} does not hang on {self.bodies[base].name}, possible is a tip beyond the base;"
                " name other links by --base and --tip"
            )
        return path[::-1]

    def displacement(self, joint: TreeJoint, chosen: bool) -> float:
        """Motion of a joint from the posture of the file: to 0 where it is in the chain, else to where it is held."""
        if chosen:
            return -joint.reference
        return self.position_held(joint) - joint.reference

    def position_held(self, joint: TreeJoint) -> float:
        """Where a joint outside the chain is held: as asked, else at its only position, else as the file shows it."""
        if joint.is_stuck and joint.range is not None:
            return self.held.get(joint.name, joint.range[0])
        return self.held.get(joint.name, joint.reference)

    def frame_of(self, body: TreeBody, chosen: set[str]) -> tuple[Array, Array]:
        """Rotation and origin of a body in its parent's frame, with its joints where they are held or at 0."""
        R, o = body.rotation, body.position
        for joint in body.joints:
            move = self.displacement(joint, joint.name in chosen)
            if joint.kind == "prismatic":
                o = o + R @ joint.axis * move
            elif joint.kind == "revolute" and move:
                turned = R @ _turn_about(joint.axis, move)
                o = o + R @ joint.place - turned @ joint.place
                R = turned
        return R, o

    def weld_bodies(
        self, k: int, stop: set[int], chosen: set[str], R: Array, o: Array
    ) -> list[tuple[TreeBody, Array, Array]]:
        """A body and all that it carries but what is beyond ``stop``, each with its frame."""
        found, left = [], [(k, R, o)]
        while left:
            at, R, o = left.pop()
            found.append((self.bodies[at], R, o))
            for child in reversed(self.children[at]):
                if child not in stop:
                    turned, place = self.frame_of(self.bodies[child], chosen)
                    left.append((child, R @ turned, o + R @ place))
        return found


def reduce_tree(tree: Tree, request: ChainRequest, label: str) -> Chain:
    """Reduce a tree to a chain.

    Args:
        tree: The tree.
        request: Base, tip and joints that are wanted.
        label: The model's name in sentences.

    Returns:
        The chain.

    Raises:
        ModelError: There is no such chain, or it has what a chain cannot have.

    """
    work = _Reduction(tree, request, label)
    base, (base_place, base_turn) = 0, (np.zeros(3), np.eye(3))
    if request.base is not None:
        base, (base_place, base_turn) = work.find_body(request.base, "--base")
    else:
        base = _skip_free_joint(work)
    if request.tip is not None:
        tip, tip_frame = work.find_body(request.tip, "--tip")
    else:
        tip, tip_frame = _assume_tip(work, base)
    path = work.path_between(base, tip)
    chosen = _choose_joints(work, path)
    _tell_held_joints(work, chosen)
    links, frame = _collect_links(work, path, chosen, base_place, base_turn)
    turned, place = _clean(frame[0] @ tip_frame[1]), frame[1] + frame[0] @ tip_frame[0]
    gravity = _clean(_turn_to_base(work, base, base_turn)) @ tree.gravity
    name = request.tip or tree.bodies[tip].name
    return Chain(tuple(links), tree.bodies[base].name, name, place, turned, gravity + 0.0, tuple(work.notes))


def _assume_tip(work: _Reduction, base: int) -> tuple[int, tuple[Array, Array]]:
    """The last body before the tree branches, and its only site or its own frame."""
    tip = work.find_tip(base)
    body = work.bodies[tip]
    if len(body.sites) == 1:
        ((site, frame),) = body.sites.items()
        work.notes.append(f"assumed: the tip is the site {site} of {body.name}")
        return tip, frame
    work.notes.append(f"assumed: the tip is the frame of {body.name}; --tip names another")
    return tip, (np.zeros(3), np.eye(3))


def _skip_free_joint(work: _Reduction) -> int:
    """The world, or the body that floats in it where there is one."""
    floating = [k for k in work.children[0] if any(joint.kind == "free" for joint in work.bodies[k].joints)]
    if len(floating) == 1 and len([k for k in work.children[0] if work.moving[k]]) == 1:
        name = work.bodies[floating[0]].name
        work.notes.append(f"left out: the free joint of {name}, which is the base")
        return floating[0]
    return 0


def _choose_joints(work: _Reduction, path: Sequence[int]) -> set[str]:
    """Names of the joints of the chain."""
    on_path = [(joint, work.bodies[k]) for k in path for joint in work.bodies[k].joints]
    wanted = work.request.joints
    if wanted is not None:
        missing = [name for name in wanted if name not in {joint.name for joint, _ in on_path}]
        if missing:
            work.refuse(f"--joints names {join_names(missing)}, which is not between base and tip")
        on_path = [(joint, body) for joint, body in on_path if joint.name in wanted]
    on_path = [(joint, body) for joint, body in on_path if joint.name not in work.held]
    for joint, body in on_path:
        where = f"joint {joint.name or '(without a name)'} of {body.name}"
        if joint.kind in ("free", "ball"):
            work.refuse(f"{where} is {joint.kind}, possible are revolute and prismatic joints; name another --base")
        if joint.is_stuck and joint.range is not None:
            at = f"{joint.range[0]:.12g}"
            work.refuse(
                f"{where} has the limits {at} to {at}, between which it cannot move, possible is the lower limit below"
                f" the upper; state them, or weld it by --at {joint.name}={at}"
            )
        if joint.is_coupled:
            work.refuse(
                f"{where} is coupled to another joint, possible are independent joints; leave it out by --joints"
            )
        if not joint.name:
            work.refuse(f"{where}: a joint of the chain needs a name, by which logs and reports know it; give it one")
        if len([one for one, home in on_path if home is body]) > 1:
            work.refuse(
                f"{body.name} has several joints and nothing between them (a planar joint is three), possible is one;"
                " name a --base beyond it, or hold one by --at"
            )
        if body.is_looped:
            work.refuse(
                f"{body.name} is tied to another body in a closed loop, possible is an open chain; cut the loop"
            )
    if not 1 <= len(on_path) <= MOST_JOINTS:
        work.refuse(
            f"found {len(on_path)} joints between base and tip, possible are 1 to {MOST_JOINTS}; name others by --base,"
            " --tip or --joints"
        )
    return {joint.name for joint, _ in on_path}


def _tell_held_joints(work: _Reduction, chosen: set[str]) -> None:
    held = []
    for body in work.bodies:
        for joint in body.joints:
            if joint.name not in chosen and joint.kind in ("revolute", "prismatic"):
                held.append(f"{joint.name} at {work.position_held(joint):g}")
    if held:
        work.notes.append(f"held: {join_names(held)}, and welded")


def _collect_links(
    work: _Reduction, path: Sequence[int], chosen: set[str], base_place: Array, base_turn: Array
) -> tuple[list[ChainLink], tuple[Array, Array]]:
    """The links, and rotation and origin of the last body of the path in the last joint's frame."""
    heads = [k for k in path if any(joint.name in chosen for joint in work.bodies[k].joints)]
    R, o = base_turn.T, -base_turn.T @ base_place
    links, rounded = [], False
    for k in path:
        body = work.bodies[k]
        turned, place = work.frame_of(body, chosen)
        R, o = R @ turned, o + R @ place
        if k not in heads:
            continue
        joint = next(joint for joint in body.joints if joint.name in chosen)
        parts = work.weld_bodies(k, set(heads) - {k}, chosen, np.eye(3), -joint.place)
        mass, center, inertia = _join_parts(parts)
        if mass <= 0:
            work.refuse(f"link {body.name} behind joint {joint.name}: found no mass, possible is above 0; state it")
        names = tuple(part.name for part, _, _ in parts if part.mass > 0)
        rounded = rounded or bool(np.abs(_clean(R) - R).max() > ROUNDING)
        links.append(ChainLink(joint, o + R @ joint.place, _clean(R), mass, center, inertia, names))
        R, o = np.eye(3), -joint.place
    if rounded:
        work.notes.append(f"assumed: right angles that are off by less than {RIGHT_ANGLE_ERROR:g} are exact")
    return links, (R, o)


def _join_parts(parts: Sequence[tuple[TreeBody, Array, Array]]) -> tuple[float, Array, Array]:
    """Mass, centre and inertia about it of several bodies in one frame."""
    mass = sum(body.mass for body, _, _ in parts)
    if mass <= 0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    centers = [(body.mass, o + R @ body.center) for body, R, o in parts]
    center = sum((m * place for m, place in centers), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for (body, R, _), (m, place) in zip(parts, centers, strict=True):
        arm = place - center
        inertia = inertia + R @ body.inertia @ R.T + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return float(mass), center, (inertia + inertia.T) / 2


def _turn_to_base(work: _Reduction, base: int, own: Array) -> Array:
    """Components in the base's frame of a vector given in the world's."""
    R, at = own, base
    while at > 0:
        R = work.frame_of(work.bodies[at], set())[0] @ R
        at = work.bodies[at].parent
    return R.T


def _turn_about(axis: Array, angle: float) -> Array:
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def _clean(rotation: Array) -> Array:
    """A rotation as the model means it: 0 and ±1 where it rounds right angles, if a rotation is left."""
    whole = np.round(rotation)
    cleaned = np.where(np.abs(rotation - whole) < RIGHT_ANGLE_ERROR, whole, rotation) + 0.0
    if np.abs(cleaned @ cleaned.T - np.eye(3)).max() < ROUNDING:
        return cleaned
    return rotation
