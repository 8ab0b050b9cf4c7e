"""The dynamics of the chain: recursion of forces, mass matrix, gravity and Coriolis terms.

Legend: q joint positions, v velocities, a accelerations (n each); ω, ω̇ angular velocity and acceleration of a link;
m mass, h first moment, I inertia about the joint's origin. Everything is computed link by link in the frame of the
link's joint, so only the relative angles enter.

Source: Newton–Euler recursion and composite bodies as in Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 5
and 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from gen.model.kinematic_chain import Body, ChainLink, KinematicChain, Parameters, SinesAndCosines
from gen.model.spatial_vectors import (
    IDENTITY,
    NO_INERTIA,
    NO_VECTOR,
    Vector,
    add_terms,
    add_vectors,
    cross_vectors,
    multiply_inertia,
    multiply_matrix,
    multiply_terms,
    rotate_inertia,
    rotate_inertia_about_z,
    scale_vector,
    shift_body,
    subtract_terms,
    subtract_vectors,
)


class ChainDynamics(KinematicChain):
    """A serial chain of rigid links with masses."""

    def newton_euler(
        self,
        q: Any,
        v: Any,
        a: Any,
        p: Parameters,
        gravity: Sequence[Any],
        wrench: Sequence[Any] = (),
        trig: SinesAndCosines | None = None,
    ) -> Any:
        """Find the joint torques of a motion by the recursion of Newton and Euler.

        Args:
            q: Joint positions (n), rad or m.
            v: Joint velocities (n).
            a: Joint accelerations (n).
            p: The parameters by name.
            gravity: Gravity in the base frame (2 or 3), m/s².
            wrench: Force of the world on the tip in the base frame, N, and after it in space its moment about the
                tip, N m (0, 2 or 6).
            trig: Sine and cosine of the joints' angles (`sines_and_cosines`); None makes them from q.

        Returns:
            M a + C v + g − Jᵀ F (n), N m or N.

        """
        trig = trig or self.sines_and_cosines(q)
        spin, spun = NO_VECTOR, NO_VECTOR  # ω, ω̇
        rise = scale_vector(-1, _fill_vector(gravity))  # acceleration of the frame's origin, gravity taken off
        force, moment = _fill_vector(wrench[:3]), _fill_vector(wrench[3:])
        pulls: list[tuple[Vector, Vector]] = []
        for j, body in enumerate(self.rigid_bodies(p)):
            rise = _accelerate_point(rise, spin, spun, self.offset_to_frame(j, q, p))
            if self.is_prismatic(j):
                along = self.sliding_direction(j)
                x, y, z = (multiply_terms(one, v[j]) for one in scale_vector(2, cross_vectors(spin, along)))
                rise = add_vectors(add_vectors(rise, scale_vector(a[j], along)), (x, y, z))
            spin, spun, rise = (self.rotate_into_frame(j, trig, one) for one in (spin, spun, rise))
            if not self.is_prismatic(j):
                spun = add_vectors(spun, cross_vectors(spin, (0, 0, v[j])))
                spin, spun = add_vectors(spin, (0, 0, v[j])), add_vectors(spun, (0, 0, a[j]))
            force, moment = self.rotate_into_frame(j, trig, force), self.rotate_into_frame(j, trig, moment)
            pulls.append(_move_body(body, spin, spun, rise))
        push, turn = scale_vector(-1, force), cross_vectors(scale_vector(-1, self.tip_offset(p)), force)
        turn = add_vectors(turn, scale_vector(-1, moment))
        torques: list[Any] = []
        for j in reversed(range(self.n)):
            push, turn = add_vectors(push, pulls[j][0]), add_vectors(turn, pulls[j][1])
            torques.append(_along_joint(self.links[j], push, turn))
            push, turn = self._carry_wrench(j, trig, push, turn, self.offset_to_frame(j, q, p))
        return ca.vertcat(*reversed(torques))

    def _carry_wrench(
        self, j: int, trig: SinesAndCosines, force: Vector, moment: Vector, offset: Vector
    ) -> tuple[Vector, Vector]:
        """A force and its moment about the origin of a joint's frame, in the frame before and about its origin."""
        force, moment = self.rotate_out_of_frame(j, trig, force), self.rotate_out_of_frame(j, trig, moment)
        return force, add_vectors(moment, cross_vectors(offset, force))

    def mass_matrix(self, q: Any, p: Parameters, trig: SinesAndCosines | None = None) -> Any:
        """Find the mass matrix of the links by composite bodies; reflected rotors are not in it.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.
            trig: Sine and cosine of the joints' angles (`sines_and_cosines`); None makes them from q.

        Returns:
            M(q) (n × n), kg m² or kg.

        """
        trig = trig or self.sines_and_cosines(q)
        bodies = self.rigid_bodies(p)
        M = ca.SX.zeros(self.n, self.n)
        outboard = Body(0, NO_VECTOR, NO_INERTIA)  # everything from joint j on, about its origin
        for j in reversed(range(self.n)):
            outboard = _join_bodies(outboard, bodies[j])
            h, inertia = outboard.first_moment, outboard.inertia
            # force and moment that accelerate the outboard body along joint j
            force: Vector = (subtract_terms(0, h[1]), h[0], 0)
            moment: Vector = (inertia[4], inertia[5], inertia[2])
            if self.is_prismatic(j):
                force, moment = (outboard.mass, 0, 0), (0, h[2], subtract_terms(0, h[1]))
            M[j, j] = _along_joint(self.links[j], force, moment)
            for k in reversed(range(j)):
                force, moment = self._carry_wrench(k + 1, trig, force, moment, self.offset_to_frame(k + 1, q, p))
                M[k, j] = M[j, k] = _along_joint(self.links[k], force, moment)
            if j > 0:
                outboard = _carry_body(self, j, trig, outboard, self.offset_to_frame(j, q, p))
        return M

    def gravity_torque(self, q: Any, p: Parameters) -> Any:
        """Find the torque that holds the arm at rest.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.

        Returns:
            g(q) (n), N m or N.

        """
        zero = [0] * self.n
        return self.newton_euler(q, zero, zero, p, self.gravity(p))

    def bias_torque(self, q: Any, v: Any, p: Parameters) -> Any:
        """Find the torque of a motion without acceleration.

        Args:
            q: Joint positions (n), rad or m.
            v: Joint velocities (n).
            p: The parameters by name.

        Returns:
            C(q, v) v + g(q) (n), N m or N.

        """
        return self.newton_euler(q, v, [0] * self.n, p, self.gravity(p))

    def gravity(self, p: Parameters) -> tuple[Any, ...]:
        """Find gravity in the base frame.

        Args:
            p: The parameters by name.

        Returns:
            Its components (2, or 3 in space), m/s².

        """
        return tuple(p[f"gravity_{axis}"] for axis in self.axes)

    def coriolis_matrix(self, q: Any, v: Any, p: Parameters) -> Any:
        """Find the Coriolis matrix by Christoffel symbols, so that dM/dt − 2C is skew.

        Args:
            q: Joint positions (n), rad or m.
            v: Joint velocities (n).
            p: The parameters by name.

        Returns:
            C(q, v) (n × n).

        """
        M = self.mass_matrix(q, p)
        slopes = [ca.reshape(ca.jacobian(ca.vec(M), q[k]), self.n, self.n) for k in range(self.n)]
        C = ca.SX.zeros(self.n, self.n)
        for i in range(self.n):
            for j in range(self.n):
                C[i, j] = sum((slopes[k][i, j] + slopes[j][i, k] - slopes[i][j, k]) * v[k] for k in range(self.n)) / 2
        return C

    def mass_moments(self, q: Any, p: Parameters) -> Any:
        """Find the first moments of the links about the base's origin.

        Joints with parallel axes turn a link by the sum of their angles.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.

        Returns:
            Mass times centre of mass of each link (n × 2, or × 3 in space) in the base frame, kg m.

        """
        origins, rows = self.joint_origins(q, p), []
        for j, body in enumerate(self.rigid_bodies(p)):
            moment, last = body.first_moment, j
            while last >= 0:
                first = last
                while first > 0 and self.links[first].rotation == IDENTITY:
                    first -= 1
                angle = sum(q[k] for k in range(first, last + 1) if not self.is_prismatic(k))
                moment = multiply_matrix(self.links[first].rotation, _turn_about_z(angle, moment))
                last = first - 1
            rows.append([body.mass * origins[j, k] + moment[k] for k in range(len(self.axes))])
        return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def _turn_about_z(angle: Any, a: Vector) -> Vector:
    """Components in the fixed frame of a vector given in a frame that has turned by an angle about z."""
    s, c = ca.sin(angle), ca.cos(angle)
    x = subtract_terms(multiply_terms(a[0], c), multiply_terms(a[1], s))
    return (x, add_terms(multiply_terms(a[0], s), multiply_terms(a[1], c)), a[2])


def _along_joint(link: ChainLink, force: Vector, moment: Vector) -> Any:
    """The component of a force and a moment in a joint's frame that the joint feels."""
    if link.kind == "prismatic":
        return force[0]
    return moment[2]


def _carry_body(chain: KinematicChain, j: int, trig: SinesAndCosines, body: Body, offset: Vector) -> Body:
    """A body of a joint's frame in the frame before, about its origin."""
    inertia = body.inertia
    if not chain.is_prismatic(j):
        inertia = rotate_inertia_about_z(trig[0][j], trig[1][j], inertia)
    moment = chain.rotate_out_of_frame(j, trig, body.first_moment)
    inertia = rotate_inertia(chain.links[j].rotation, inertia)
    return Body(body.mass, *shift_body(body.mass, moment, inertia, offset))


def _fill_vector(parts: Sequence[Any]) -> Vector:
    """Up to three components as a vector."""
    filled = (*parts, 0, 0, 0)
    return (filled[0], filled[1], filled[2])


def _accelerate_point(rise: Vector, spin: Vector, spun: Vector, r: Vector) -> Vector:
    """Acceleration of the point r of a link whose origin accelerates with ``rise``: rise + ω̇ × r + ω × (ω × r).

    The part of r itself, −(ω² − ω_k²) r_k, stands apart; the rest is a matrix with the entries ω_i ω_k ± ω̇.
    """
    squares = [multiply_terms(one, one) for one in spin]
    out = []
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        own = multiply_terms(add_terms(squares[k], squares[m]), r[i])
        by_k = subtract_terms(multiply_terms(spin[i], spin[k]), spun[m])
        by_m = add_terms(multiply_terms(spin[i], spin[m]), spun[k])
        rest = add_terms(multiply_terms(by_k, r[k]), multiply_terms(by_m, r[m]))
        out.append(add_terms(subtract_terms(rise[i], own), rest))
    return (out[0], out[1], out[2])


def _move_body(body: Body, spin: Vector, spun: Vector, rise: Vector) -> tuple[Vector, Vector]:
    """Force and moment about the origin that give a body its motion."""
    h, inertia = body.first_moment, body.inertia
    force = subtract_vectors(scale_vector(body.mass, rise), cross_vectors(h, spun))
    force = add_vectors(force, cross_vectors(cross_vectors(h, spin), spin))
    moment = add_vectors(multiply_inertia(inertia, spun), cross_vectors(spin, multiply_inertia(inertia, spin)))
    return force, add_vectors(moment, cross_vectors(h, rise))


def _join_bodies(a: Body, b: Body) -> Body:
    """Two bodies of one frame as one."""
    moment = add_vectors(a.first_moment, b.first_moment)
    inertia = tuple(add_terms(one, other) for one, other in zip(a.inertia, b.inertia, strict=True))
    return Body(add_terms(a.mass, b.mass), moment, inertia)
