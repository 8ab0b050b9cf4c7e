"""Rotors that ride on the link before their joint and turn about the joint's axis, that of sliding where it slides.

Legend: θ̇ rotor's speed against that link; ω the link's angular velocity, z the joint's axis, Ω = z·ω = B v; s the
direction of the rotor; h = J_m (θ̇ + s Ω) its angular momentum. From the energy ½ J_m (θ̇ + s Ω)² joint k feels
s (B_k ḣ + h z_k·(ω × z)). In the plane all axes are parallel, and the last term, the gyroscope's, is 0.

Source: Lagrange's equations; Murphy, Wen, Saridis, IEEE Trans. Autom. Control 36 (1991) 1166, for rotors in space.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen.model.kinematic_chain import KinematicChain, SinesAndCosines
from gen.model.spatial_vectors import NO_VECTOR, Vector, add_terms, add_vectors, cross_vectors, multiply_terms

SX = ca.SX


@dataclass(frozen=True)
class CarriedRotor:
    """The motion of a rotor that its link gives it, each part times s.

    Attributes:
        row: B (1 × n).
        drift: Rate of Ω while no joint accelerates.
        twist: z_k·(ω × z) of each joint (n × 1), 1/s.

    """

    row: Any
    drift: Any
    twist: Any

    def find_turn(self, velocities: Any) -> Any:
        """Find the speed that the link gives the rotor.

        Args:
            velocities: Velocities of the joints (n).

        Returns:
            s Ω, rad/s.

        """
        return (self.row @ velocities)[0]

    def find_acceleration(self, accelerations: Any) -> Any:
        """Find the acceleration that the link gives the rotor.

        Args:
            accelerations: Accelerations of the joints (n).

        Returns:
            s dΩ/dt, rad/s².

        """
        return (self.row @ accelerations)[0] + self.drift


def find_carried_rotors(
    chain: KinematicChain, trig: SinesAndCosines, velocities: Sequence[Any], directions: Mapping[int, Any]
) -> dict[int, CarriedRotor]:
    """Find how the links of a chain move the rotors that they carry.

    Args:
        chain: The chain.
        trig: Sines and cosines of its joints' angles.
        velocities: Velocities of its joints (n).
        directions: s of each rotor that is carried, by the place of its joint, 0 for the first.

    Returns:
        The rotors by the place of their joint.

    """
    found, spin, spun = {}, NO_VECTOR, NO_VECTOR  # ω and its rate without accelerations, in the frame before
    for j in range(chain.n):
        axis = _rotor_axis(chain, j)
        if j in directions:
            s = directions[j]
            row = s * _as_row(_project_outward(chain, j, trig, axis))
            drift = s * _dot(axis, spun)
            twist = s * _as_row(_project_outward(chain, j, trig, cross_vectors(spin, axis))).T
            found[j] = CarriedRotor(row, drift, twist)
        spin, spun = chain.rotate_into_frame(j, trig, spin), chain.rotate_into_frame(j, trig, spun)
        if not chain.is_prismatic(j):
            own = (0, 0, velocities[j])
            spin, spun = add_vectors(spin, own), add_vectors(spun, cross_vectors(spin, own))
    return found


def _rotor_axis(chain: KinematicChain, j: int) -> Vector:
    """The axis of a rotor in the frame before its joint: that of the joint, but in the plane that of all rotors."""
    if chain.is_prismatic(j) and chain.in_space:
        return chain.sliding_direction(j)
    x, y, z = (row[2] for row in chain.links[j].rotation)
    return (x, y, z)


def _project_outward(chain: KinematicChain, j: int, trig: SinesAndCosines, a: Vector) -> list[Any]:
    """The component along the axis of every revolute joint before joint j of a vector of the frame before it (n)."""
    parts: list[Any] = [0] * chain.n
    for k in reversed(range(j)):
        if not chain.is_prismatic(k):
            parts[k] = a[2]
        a = chain.rotate_out_of_frame(k, trig, a)
    return parts


def _dot(a: Vector, b: Vector) -> Any:
    return add_terms(*(multiply_terms(x, y) for x, y in zip(a, b, strict=True)))


def _as_row(parts: Sequence[Any]) -> Any:
    return ca.horzcat(*(SX(part) for part in parts))
