"""The serial chain of rigid links in space: its links as numbers and names of parameters, and where they are.

Legend: q joint positions, v velocities (n each); s, c sine and cosine of each revolute q. The frame of a joint moves
with its link: a revolute joint turns it about its own z, a prismatic joint slides it along its own x.

Fixed transforms are numbers and fold away where they are 0 or ±1 (`gen.model.spatial_vectors`). A chain that moves in
the plane has the forces and velocities of the plane alone: its tip has two coordinates, that in space has six.

Source: Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 4; paper (18)–(21). `gen.model.lagrangian` derives
the same from the Lagrangian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen.model.spatial_vectors import (
    IDENTITY,
    NO_VECTOR,
    Inertia,
    Matrix,
    Vector,
    add_terms,
    add_vectors,
    cross_vectors,
    multiply_matrix,
    multiply_terms,
    rotate_about_z,
    rotate_back_about_z,
    rotate_inertia,
    subtract_terms,
    transpose_matrix,
)

Parameters = Mapping[str, Any]
SinesAndCosines = tuple[Sequence[Any], Sequence[Any]]
Entry = float | str  # a number, or the name of a parameter

PLANE_AXES = ("x", "y")
SPACE_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class ChainLink:
    """A joint with its link.

    Attributes:
        kind: "revolute" or "prismatic".
        rotation: Components in the frame before of a vector given in the joint's, at q = 0.
        origin: The joint in the frame before, m.
        mass: The link's mass, kg.
        center_of_mass: In the frame that the robot file states, from the joint, m.
        inertia: About the centre of mass in that frame (xx, yy, zz, xy, xz, yz), kg m².
        turn: Components in the joint's frame of a vector given in the stated one.

    """

    kind: str
    rotation: Matrix
    origin: tuple[Entry, Entry, Entry]
    mass: Entry
    center_of_mass: tuple[Entry, Entry, Entry]
    inertia: tuple[Entry, Entry, Entry, Entry, Entry, Entry]
    turn: Matrix = IDENTITY


@dataclass(frozen=True)
class ChainTip:
    """The tip in the last joint's frame: ``origin``, m, and ``rotation``, as in `ChainLink`."""

    origin: tuple[Entry, Entry, Entry]
    rotation: Matrix = IDENTITY


@dataclass(frozen=True)
class Body:
    """A link with everything that is fixed to it: mass, first moment and inertia about the joint's origin."""

    mass: Any
    first_moment: Vector
    inertia: Inertia

    def add_mass(self, mass: Any, place: Vector) -> Body:
        """Fix a point mass to the body.

        Args:
            mass: The mass, kg.
            place: Its place, m.

        Returns:
            The body with the mass.

        """

        def second_moment(i: int, k: int) -> Any:
            return multiply_terms(multiply_terms(mass, place[i]), place[k])

        x, y, z = (add_terms(self.first_moment[k], multiply_terms(mass, place[k])) for k in range(3))
        xx, yy, zz, xy, xz, yz = self.inertia
        inertia = (
            add_terms(xx, add_terms(second_moment(1, 1), second_moment(2, 2))),
            add_terms(yy, add_terms(second_moment(0, 0), second_moment(2, 2))),
            add_terms(zz, add_terms(second_moment(0, 0), second_moment(1, 1))),
            subtract_terms(xy, second_moment(0, 1)),
            subtract_terms(xz, second_moment(0, 2)),
            subtract_terms(yz, second_moment(1, 2)),
        )
        return Body(add_terms(self.mass, mass), (x, y, z), inertia)


def planar_links(kinds: Sequence[str]) -> tuple[tuple[ChainLink, ...], ChainTip]:
    """Describe the links of a chain in the plane, each along its own x with the next joint at its end.

    Args:
        kinds: "revolute" or "prismatic" for each joint, base first; a prismatic joint has no length.

    Returns:
        The links, and the tip at the end of the last one.

    """
    links, end = [], NO_VECTOR
    for j, kind in enumerate(kinds, 1):
        inertia: Any = (0, 0, f"inertia_{j}", 0, 0, 0)
        links.append(ChainLink(kind, IDENTITY, end, f"mass_{j}", (f"center_of_mass_{j}", 0, 0), inertia))
        end = NO_VECTOR
        if kind != "prismatic":
            end = (f"length_{j}", 0, 0)
    return tuple(links), ChainTip(end)


class KinematicChain:
    """A serial chain: the places of its joints and its tip, and how they move."""

    def __init__(self, links: Sequence[ChainLink], tip: ChainTip, in_space: bool) -> None:
        self.links, self.tip, self.in_space = tuple(links), tip, in_space
        self.n = len(self.links)
        self.axes: tuple[str, ...] = PLANE_AXES
        if in_space:
            self.axes = SPACE_AXES

    def is_prismatic(self, j: int) -> bool:
        """Tell whether a joint slides.

        Args:
            j: The joint's place, 0 for the first.

        Returns:
            True where the joint is prismatic, False where it is revolute.

        """
        return self.links[j].kind == "prismatic"

    # -- parameters -------------------------------------------------------------------------------------------------

    def tip_offset(self, p: Parameters) -> Vector:
        """Find the tip in the last joint's frame.

        Args:
            p: The parameters by name.

        Returns:
            The tip, m.

        """
        return _find_vector(self.tip.origin, p)

    def rigid_bodies(self, p: Parameters) -> list[Body]:
        """Find the links about their joints' origins.

        Args:
            p: The parameters by name; ``tip_mass`` (kg, optional) is a point at the tip, or at ``tip_mass_center`` (m)
                in the tip's frame.

        Returns:
            The links, base first.

        """
        bodies = []
        for link in self.links:
            own = tuple(_find_value(entry, p) for entry in link.inertia)
            about_center = Body(0, NO_VECTOR, rotate_inertia(link.turn, own))
            center = multiply_matrix(link.turn, _find_vector(link.center_of_mass, p))
            bodies.append(about_center.add_mass(_find_value(link.mass, p), center))
        place = self.tip_offset(p)
        if "tip_mass_center" in p:
            place = add_vectors(place, multiply_matrix(self.tip.rotation, p["tip_mass_center"]))
        bodies[-1] = bodies[-1].add_mass(p.get("tip_mass", 0), place)
        return bodies

    # -- frames -----------------------------------------------------------------------------------------------------

    def sines_and_cosines(self, q: Any) -> SinesAndCosines:
        """Find sine and cosine of the revolute joints' angles; 0 and 1 for prismatic joints.

        Args:
            q: Joint positions (n), rad or m.

        Returns:
            The sines (n) and the cosines (n).

        """
        sines: list[Any] = [0] * self.n
        cosines: list[Any] = [1] * self.n
        for j in range(self.n):
            if not self.is_prismatic(j):
                sines[j], cosines[j] = ca.sin(q[j]), ca.cos(q[j])
        return sines, cosines

    def rotate_into_frame(self, j: int, trig: SinesAndCosines, a: Vector) -> Vector:
        """Find the components in a joint's frame of a vector given in the frame before.

        Args:
            j: The joint's place, 0 for the first.
            trig: Sines and cosines (`sines_and_cosines`).
            a: The vector in the frame before.

        Returns:
            The vector in the joint's frame.

        """
        return rotate_back_about_z(trig[0][j], trig[1][j], multiply_matrix(transpose_matrix(self.links[j].rotation), a))

    def rotate_out_of_frame(self, j: int, trig: SinesAndCosines, a: Vector) -> Vector:
        """Find the components in the frame before of a vector given in a joint's frame.

        Args:
            j: The joint's place, 0 for the first.
            trig: Sines and cosines (`sines_and_cosines`).
            a: The vector in the joint's frame.

        Returns:
            The vector in the frame before.

        """
        return multiply_matrix(self.links[j].rotation, rotate_about_z(trig[0][j], trig[1][j], a))

    def offset_to_frame(self, j: int, q: Any, p: Parameters) -> Vector:
        """Find the origin of a joint's frame in the frame before.

        Args:
            j: The joint's place, 0 for the first.
            q: Joint positions (n), rad or m.
            p: The parameters by name.

        Returns:
            The origin, m.

        """
        offset = _find_vector(self.links[j].origin, p)
        if self.is_prismatic(j):
            along = self.sliding_direction(j)
            x, y, z = (add_terms(offset[k], multiply_terms(along[k], q[j])) for k in range(3))
            return (x, y, z)
        return offset

    def sliding_direction(self, j: int) -> Vector:
        """Find the direction in which a prismatic joint slides.

        Args:
            j: The joint's place, 0 for the first.

        Returns:
            The unit vector in the frame before.

        """
        x, y, z = (row[0] for row in self.links[j].rotation)
        return (x, y, z)

    def _find_place(self, first: int, j: int, trig: SinesAndCosines, q: Any, p: Parameters, place: Vector) -> Vector:
        """The place in frame ``first`` − 1 (0: the base) of a point given in the frame of joint j."""
        for k in reversed(range(first, j + 1)):
            place = self.rotate_out_of_frame(k, trig, place)
            place = add_vectors(place, self.offset_to_frame(k, q, p))
        return place

    # -- tip and joints ---------------------------------------------------------------------------------------------

    def joint_origins(self, q: Any, p: Parameters) -> Any:
        """Find where the joints and the tip are.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.

        Returns:
            Origins of the joints, then the tip ((n + 1) × 2, or × 3 in space), in the base frame, m.

        """
        trig, ends = self.sines_and_cosines(q), [*([NO_VECTOR] * self.n), self.tip_offset(p)]
        rows = []
        for end, place in enumerate(ends):
            found = self._find_place(0, min(end, self.n - 1), trig, q, p, place)
            rows.append(ca.horzcat(*found[: len(self.axes)]))
        return ca.vertcat(*rows)

    def tip_position(self, q: Any, p: Parameters) -> Any:
        """Find where the tip is.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.

        Returns:
            The tip in the base frame (2, or 3 in space), m.

        """
        return self.joint_origins(q, p)[self.n, :].T

    def tip_rotation(self, q: Any) -> Any:
        """Find how the tip is turned.

        Args:
            q: Joint positions (n), rad or m.

        Returns:
            Components in the base frame of a vector given in the tip's frame (3 × 3).

        """
        trig, columns = self.sines_and_cosines(q), []
        for axis in transpose_matrix(self.tip.rotation):
            for k in reversed(range(self.n)):
                axis = self.rotate_out_of_frame(k, trig, axis)  # noqa: PLW2901 - it moves from frame to frame
            columns.append(ca.vertcat(*axis))
        return ca.horzcat(*columns)

    def tip_jacobian(self, q: Any, p: Parameters) -> Any:
        """Find the Jacobian of the tip.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.

        Returns:
            Velocity of the tip by v, in the base frame: (2 × n), or in space (6 × n), below it the angular velocity.

        """
        trig, columns = self.sines_and_cosines(q), []
        for j in range(self.n):
            turn: Vector = NO_VECTOR
            move: Vector = (1, 0, 0)
            if not self.is_prismatic(j):
                turn = (0, 0, 1)
                seen = self._find_place(j + 1, self.n - 1, trig, q, p, self.tip_offset(p))  # from the joint's frame
                move = cross_vectors(turn, seen)
            for k in reversed(range(j + 1)):
                move, turn = self.rotate_out_of_frame(k, trig, move), self.rotate_out_of_frame(k, trig, turn)
            rows = (*move, *turn) if self.in_space else move[:2]
            columns.append(ca.vertcat(*rows))
        return ca.horzcat(*columns)

    def inverse_branches(self, point: Any, p: Parameters) -> Any:
        """Find both inverse branches of the arm of two revolute joints in the plane, paper (21) corrected.

        Out of reach the cosine is outside [−1, 1] and every entry is NaN, so no posture is ever invented.

        Args:
            point: The point to reach in the base frame (2), m.
            p: The parameters by name.

        Returns:
            Joint angles (2 × 2), rad: a column with the elbow down (q2 ≥ 0), and one with the elbow up.

        Raises:
            ValueError: The arm is another one.

        """
        if not self.has_closed_inverse:
            raise ValueError("the closed inverse is that of two revolute joints in the plane")
        l1, l2 = p["length_1"], p["length_2"]
        x, y = point[0], point[1]
        elbow = ca.acos((x * x + y * y - l1 * l1 - l2 * l2) / (2 * l1 * l2))
        columns = []
        for q2 in (elbow, -elbow):
            columns.append(ca.vertcat(ca.atan2(y, x) - ca.atan2(l2 * ca.sin(q2), l1 + l2 * ca.cos(q2)), q2))
        return ca.horzcat(*columns)

    @property
    def has_closed_inverse(self) -> bool:
        """Whether `inverse_branches` knows the chain."""
        return not self.in_space and [link.kind for link in self.links] == ["revolute", "revolute"]


def _find_value(entry: Entry, p: Parameters) -> Any:
    """A number as it is, a parameter by its name."""
    if isinstance(entry, str):
        return p[entry]
    return entry


def _find_vector(entries: tuple[Entry, Entry, Entry], p: Parameters) -> Vector:
    x, y, z = (_find_value(entry, p) for entry in entries)
    return (x, y, z)
