"""The bodies of a user's model whose masses, centres and inertias a verdict changes, found by the import's own reading.

A link of the robot may be several bodies of the model, welded: the one that its joint moves takes the whole change.
Legend: moments of a body are its mass m, m times its centre of mass, and its inertia about the origin.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.model_export.joint_numbers import JointNumbers, RobotNumbers
from hdagen.model_export.link_numbers import Frame, LinkBody
from hdagen.model_import.chain_reduction import Chain, ChainLink, ChainRequest, reduce_tree
from hdagen.model_import.compiled_tree import Tree, TreeBody, compile_tree
from hdagen.model_import.model_file import ModelError, read_model_file
from hdagen.model_import.possible_inertia import is_possible_inertia
from hdagen.support.messages import show_path, show_value

_MOMENT_ROUNDING = 1e-9  # share of the sum of the others by which a moment may be above it: sums and differences
SAME_NUMBER = 1e-3  # relative difference up to which model and robot file have the same number
OTHER_FRAMES = "the model's joints stand elsewhere than the robot file's; import the model by `hdagen robot import`"
PLANE_ALONE = "a link of the plane has no centre and inertia in space, which the model needs"
NO_BODY = "what is left for the body that the joint moves is a mass or an inertia that no body has"

Moments = tuple[float, Array, Array]


@dataclass(frozen=True)
class BodyChange:
    """A body of the model: the joint that moves it, and what it weighs, in its own frame, before and after."""

    joint: str
    old: LinkBody
    new: LinkBody


@dataclass
class LinkChanges:
    """The bodies that change, gravity in the world's frame (None: as it is), and why the model cannot take others."""

    bodies: list[BodyChange] = field(default_factory=list)
    gravity: tuple[float, ...] | None = None
    left_out: dict[str, str] = field(default_factory=dict)


def find_link_changes(path: Path, before: RobotNumbers, after: RobotNumbers, wanted: Sequence[str]) -> LinkChanges:
    """Find the bodies of a model that a verdict changes.

    Args:
        path: The model.
        before: The robot file's numbers, with the model's joint names.
        after: The corrected ones.
        wanted: Where each number that changes stands, as ``joint.number``, "payload" or "gravity_x".

    Returns:
        The changes.

    Raises:
        PlantError: The model has no such chain, or other numbers than the robot file.

    """
    found = LinkChanges()
    if not wanted:
        return found
    if not before.in_space:
        found.left_out = dict.fromkeys(wanted, PLANE_ALONE)
        return found
    try:
        tree = compile_tree(read_model_file(path))
        names = tuple(joint.name for joint in before.joints)
        homes = {joint.name: body for body in tree.bodies for joint in body.joints}
        chain = reduce_tree(tree, ChainRequest(tip=homes[names[-1]].name, joints=names), show_path(path))
    except ModelError as error:
        raise PlantError(str(error)) from None
    except KeyError:
        raise PlantError(f"{show_path(path)}: there is no joint {show_value(names[-1])}; name another model.") from None
    if [link.joint.name for link in chain.links] != list(names) or not _have_same_frames(before, chain):
        found.left_out = dict.fromkeys(wanted, OTHER_FRAMES)
        return found
    for old, new, link in zip(before.joints, after.joints, chain.links, strict=True):
        added = old.name == names[-1] and (before, after)
        _change_body(
            found,
            path,
            homes[old.name],
            link,
            old,
            new,
            [one for one in wanted if _belongs(one, old, names)],
            _list_payloads(*added) if added else (),
        )
    _change_gravity(found, tree, chain, before, after, [one for one in wanted if one.startswith("gravity_")])
    return found


def _belongs(place: str, joint: JointNumbers, names: Sequence[str]) -> bool:
    """Whether a number is one of a joint's link, or of what hangs on the last link."""
    return place.startswith(f"{joint.name}.") or (joint.name == names[-1] and place.startswith("payload"))


def _list_payloads(before: RobotNumbers, after: RobotNumbers) -> tuple[Moments, Moments]:
    """The moments of what hangs on the tip, in the last joint's frame, before and after."""
    return _find_placed_moments(before.payload, before.tip), _find_placed_moments(after.payload, after.tip)


def _change_body(
    found: LinkChanges,
    path: Path,
    home: TreeBody,
    link: ChainLink,
    old: JointNumbers,
    new: JointNumbers,
    wanted: list[str],
    payloads: Iterable[Moments],
) -> None:
    """Add the change of one link, or say why the model cannot take it."""
    if not wanted:
        return
    _check_same_body(path, link, old)
    own = LinkBody(home.mass, tuple(home.center), _list_entries(home.inertia))
    moments = _find_moments(own, np.zeros(3))
    for sign, body in ((-1.0, old.body), (1.0, new.body)):
        moments = _add(moments, _find_moments(body, link.joint.place), sign)
    for sign, load in zip((-1.0, 1.0), payloads, strict=False):
        moments = _add(moments, _shift(load, link.joint.place), sign)
    changed = _find_body(moments)
    if changed is None:
        found.left_out |= dict.fromkeys(wanted, NO_BODY)
        return
    found.bodies.append(BodyChange(old.name, own, changed))


def _check_same_body(path: Path, link: ChainLink, joint: JointNumbers) -> None:
    """Refuse a model whose link weighs something else than the robot file's."""
    size = max(float(np.abs(link.inertia).max()), link.mass * 1e-6)
    for name, found, stated, scale in (
        ("mass", [link.mass], [joint.body.mass], link.mass),
        ("center_of_mass", link.center, joint.body.center, max(float(np.abs(link.center).max()), 1e-3)),
        ("inertia", _list_entries(link.inertia), joint.body.inertia, size),
    ):
        for theirs, ours in zip(found, stated, strict=True):
            if abs(theirs - ours) > SAME_NUMBER * scale:
                raise PlantError(
                    f"{show_path(path)}: {name} of the link behind joint {joint.name!r:.60} is {theirs:.6g}, and the "
                    f"robot file has {ours:.6g}: the model has changed since the diagnosis, or is of another robot; "
                    "name the one that was diagnosed."
                )


def _have_same_frames(numbers: RobotNumbers, chain: Chain) -> bool:
    """Whether every joint but the first stands in the frame before as the robot file has it, and turns about the same
    axis; the base may be another."""
    for place, (joint, link) in enumerate(zip(numbers.joints, chain.links, strict=True)):
        if np.abs(link.joint.axis - joint.axis).max() > SAME_NUMBER:
            return False
        if place and np.abs(link.origin - joint.frame.origin).max() > SAME_NUMBER:
            return False
        if place and np.abs(link.rotation - _turn(joint.frame)).max() > SAME_NUMBER:
            return False
    return True


def _change_gravity(
    found: LinkChanges, tree: Tree, chain: Chain, before: RobotNumbers, after: RobotNumbers, wanted: list[str]
) -> None:
    """Add the change of gravity, where model and robot file have the same base."""
    if not wanted:
        return
    first, link = before.joints[0].frame, chain.links[0]
    stands = np.abs(link.rotation - _turn(first)).max() <= SAME_NUMBER and np.allclose(
        tree.gravity, chain.gravity, rtol=0, atol=SAME_NUMBER * np.linalg.norm(tree.gravity)
    )
    if not stands or not np.allclose(chain.gravity, before.gravity, rtol=0, atol=0.01):
        found.left_out |= dict.fromkeys(wanted, "the model's base is turned against the robot file's")
        return
    if not tree.states_gravity:
        found.left_out |= dict.fromkeys(wanted, "URDF states no gravity; set it in the simulator")
        return
    found.gravity = after.gravity


# -- moments ----------------------------------------------------------------------------------------------------------


def _turn(frame: Frame) -> Array:
    w, x, y, z = (entry / math.hypot(*frame.rotation) for entry in frame.rotation)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2 * w * K + 2 * K @ K


def _find_moments(body: LinkBody, place: Array) -> Moments:
    """The moments of a body about an origin that its frame's is at ``place`` from."""
    xx, yy, zz, xy, xz, yz = body.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    center = np.array(body.center) + place
    return body.mass, body.mass * center, tensor + body.mass * (center @ center * np.eye(3) - np.outer(center, center))


def _find_placed_moments(body: LinkBody, frame: Frame) -> Moments:
    """The moments of a point mass in another frame, in the frame before."""
    place = np.array(frame.origin) + _turn(frame) @ np.array(body.center)
    return _find_moments(LinkBody(body.mass), place)


def _shift(moments: Moments, place: Array) -> Moments:
    """The moments about another origin."""
    mass, first, second = moments
    if mass == 0:
        return moments
    center = first / mass
    inertia = second - mass * (center @ center * np.eye(3) - np.outer(center, center))
    return _find_moments(LinkBody(mass, tuple(center), _list_entries(inertia)), place)


def _add(one: Moments, other: Moments, sign: float) -> Moments:
    return one[0] + sign * other[0], one[1] + sign * other[1], one[2] + sign * other[2]


def _find_body(moments: Moments) -> LinkBody | None:
    """The body with these moments; None where there can be none."""
    mass, first, second = moments
    if mass <= 0:
        return None
    center = first / mass
    inertia = second - mass * (center @ center * np.eye(3) - np.outer(center, center))
    if not is_possible_inertia(inertia, _MOMENT_ROUNDING):
        return None
    return LinkBody(float(mass), tuple(center), _list_entries(inertia))


def _list_entries(tensor: Array) -> tuple[float, ...]:
    """xx, yy, zz, xy, xz, yz."""
    return tuple(float(tensor[i, k]) for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
