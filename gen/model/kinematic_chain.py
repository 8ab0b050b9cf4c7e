"""The planar chain of rigid links: kinematics, mass matrix, recursion of forces.

Legend: q joint positions, v velocities, a accelerations (n×1 each); s, c sine and cosine of each revolute q;
L length, m mass, r centre of mass from the joint's axis, I inertia about the centre of mass; g gravity (2).
Everything is computed link by link in the link's own frame (x along the link), so only the relative angles enter.

A revolute joint turns its link; a prismatic joint slides it along its own x and has no length.
Sources: Newton–Euler recursion and composite bodies as in Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 5
and 6, restricted to the plane; paper (18)–(21). `gen.model.lagrangian` derives the same from the Lagrangian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

Parameters = Mapping[str, Any]
SinesAndCosines = tuple[Sequence[Any], Sequence[Any]]


@dataclass(frozen=True)
class Body:
    """A link with everything that is fixed to it: mass, first moment along x, inertia about the joint's axis."""

    mass: Any
    first_moment: Any
    inertia: Any


class Chain:
    """Planar serial chain of ``kinds`` ("revolute" or "prismatic"), base first."""

    def __init__(self, kinds: Sequence[str]) -> None:
        self.kinds = tuple(kinds)
        self.n = len(self.kinds)

    def is_prismatic(self, j: int) -> bool:
        """Tell whether a joint slides.

        Args:
            j: The joint's place, 0 for the first.

        Returns:
            True where the joint is prismatic, False where it is revolute.

        """
        return self.kinds[j] == "prismatic"

    # -- parameters -------------------------------------------------------------------------------------------------

    def _length(self, j: int, p: Parameters) -> Any:
        if self.is_prismatic(j):
            return 0
        return p[f"length_{j + 1}"]

    def rigid_bodies(self, p: Parameters) -> list[Body]:
        """Find the links about their joints' axes.

        Args:
            p: The parameters by name; ``tip_mass`` (kg, optional) is a point at the end of the last link.

        Returns:
            The links, base first.

        """
        bodies = []
        for j in range(self.n):
            m, r = p[f"mass_{j + 1}"], p[f"center_of_mass_{j + 1}"]
            bodies.append(Body(m, m * r, p[f"inertia_{j + 1}"] + m * r * r))
        extra = p.get("tip_mass", 0)
        length = self._length(self.n - 1, p)
        last = bodies[-1]
        bodies[-1] = Body(last.mass + extra, last.first_moment + extra * length, last.inertia + extra * length * length)
        return bodies

    # -- geometry ---------------------------------------------------------------------------------------------------

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

    def _rotate_into_frame(self, j: int, trig: SinesAndCosines, x: Any, y: Any) -> tuple[Any, Any]:
        """Components in frame j of a vector given in frame j − 1."""
        if self.is_prismatic(j):
            return x, y
        s, c = trig[0][j], trig[1][j]
        return c * x + s * y, c * y - s * x

    def _rotate_out_of_frame(self, j: int, trig: SinesAndCosines, x: Any, y: Any) -> tuple[Any, Any]:
        """Components in frame j − 1 of a vector given in frame j."""
        if self.is_prismatic(j):
            return x, y
        s, c = trig[0][j], trig[1][j]
        return c * x - s * y, s * x + c * y

    def _offset_to_frame(self, j: int, q: Any, p: Parameters) -> Any:
        """Distance from the origin of frame j − 1 to that of frame j, along x of frame j − 1."""
        before = 0
        if j > 0:
            before = self._length(j - 1, p)
        if self.is_prismatic(j):
            return before + q[j]
        return before

    def joint_origins(self, q: Any, p: Parameters) -> Any:
        """Find where the joints and the tip are.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.

        Returns:
            Origins of the joints, then the tip ((n + 1) × 2), in the base frame, m.

        """
        trig = self.sines_and_cosines(q)
        rows = []
        for end in range(self.n + 1):
            x, y = 0, 0
            if end == self.n:
                x = self._length(self.n - 1, p)
            for j in reversed(range(min(end + 1, self.n))):
                x, y = self._rotate_out_of_frame(j, trig, x, y)
                x = x + self._offset_to_frame(j, q, p)
            rows.append(ca.horzcat(x, y))
        return ca.vertcat(*rows)

    def tip_position(self, q: Any, p: Parameters) -> Any:
        """Find where the tip is.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.

        Returns:
            The tip in the base frame (2), m.

        """
        return self.joint_origins(q, p)[self.n, :].T

    def tip_jacobian(self, q: Any, p: Parameters) -> Any:
        """Find the Jacobian of the tip.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.

        Returns:
            ∂tip/∂q (2 × n) in the base frame.

        """
        trig = self.sines_and_cosines(q)
        columns = []
        for j in range(self.n):
            x, y = self._length(self.n - 1, p), 0
            for k in reversed(range(j + 1, self.n)):  # the tip as seen from the origin of frame j
                x, y = self._rotate_out_of_frame(k, trig, x, y)
                x = x + self._offset_to_frame(k, q, p)
            if self.is_prismatic(j):
                x, y = 1, 0
            else:
                x, y = -y, x
            for k in reversed(range(j + 1)):
                x, y = self._rotate_out_of_frame(k, trig, x, y)
            columns.append(ca.vertcat(x, y))
        return ca.horzcat(*columns)

    def inverse_branches(self, point: Any, p: Parameters) -> Any:
        """Find both inverse branches of the arm of two revolute joints, paper (21) corrected.

        Out of reach the cosine is outside [−1, 1] and every entry is NaN, so no posture is ever invented.

        Args:
            point: The point to reach in the base frame (2), m.
            p: The parameters by name.

        Returns:
            Joint angles (2 × 2), rad: a column with the elbow down (q2 ≥ 0), and one with the elbow up.

        Raises:
            ValueError: The arm is another one.

        """
        if self.kinds != ("revolute", "revolute"):
            raise ValueError("the closed inverse is that of two revolute joints")
        l1, l2 = p["length_1"], p["length_2"]
        x, y = point[0], point[1]
        elbow = ca.acos((x * x + y * y - l1 * l1 - l2 * l2) / (2 * l1 * l2))
        columns = []
        for q2 in (elbow, -elbow):
            columns.append(ca.vertcat(ca.atan2(y, x) - ca.atan2(l2 * ca.sin(q2), l1 + l2 * ca.cos(q2)), q2))
        return ca.horzcat(*columns)

    # -- dynamics ---------------------------------------------------------------------------------------------------

    def newton_euler(
        self,
        q: Any,
        v: Any,
        a: Any,
        p: Parameters,
        gravity: Any,
        force: Any = (0, 0),
        trig: SinesAndCosines | None = None,
    ) -> Any:
        """Find the joint torques of a motion by the recursion of Newton and Euler.

        Args:
            q: Joint positions (n), rad or m.
            v: Joint velocities (n).
            a: Joint accelerations (n).
            p: The parameters by name.
            gravity: Gravity in the base frame (2), m/s².
            force: Force F of the world on the tip in the base frame (2), N.
            trig: Sine and cosine of the joints' angles (`trig`); None makes them from q.

        Returns:
            M a + C v + g − Jᵀ F (n), N m or N.

        """
        trig = trig or self.sines_and_cosines(q)
        bodies = self.rigid_bodies(p)
        spin, spun = 0, 0  # angular velocity and acceleration of the frame
        ax, ay = -gravity[0], -gravity[1]
        fx, fy = force[0], force[1]
        pulls: list[tuple[Any, Any, Any]] = []
        for j, body in enumerate(bodies):
            reach = self._offset_to_frame(j, q, p)
            ax, ay = (
                ax - spin * spin * reach,
                ay + spun * reach,
            )  # acceleration of the origin of frame j, in frame j − 1
            if self.is_prismatic(j):
                ax, ay = ax + a[j], ay + 2 * spin * v[j]
            else:
                spin, spun = spin + v[j], spun + a[j]
            ax, ay = self._rotate_into_frame(j, trig, ax, ay)
            fx, fy = self._rotate_into_frame(j, trig, fx, fy)
            pulls.append(
                (
                    body.mass * ax - body.first_moment * spin * spin,
                    body.mass * ay + body.first_moment * spun,
                    body.inertia * spun + body.first_moment * ay,
                )
            )
        px, py, pn = -fx, -fy, -self._length(self.n - 1, p) * fy
        torques: list[Any] = []
        for j in reversed(range(self.n)):
            px, py, pn = px + pulls[j][0], py + pulls[j][1], pn + pulls[j][2]
            torques.append(self._along_joint(j, px, pn))
            px, py = self._rotate_out_of_frame(j, trig, px, py)
            pn = pn + self._offset_to_frame(j, q, p) * py
        return ca.vertcat(*reversed(torques))

    def _along_joint(self, j: int, force: Any, moment: Any) -> Any:
        """The component that a joint feels, of a force along x and a moment about its axis."""
        if self.is_prismatic(j):
            return force
        return moment

    def mass_matrix(self, q: Any, p: Parameters, trig: SinesAndCosines | None = None) -> Any:
        """Find the mass matrix of the links by composite bodies; reflected rotors are not in it.

        Args:
            q: Joint positions (n), rad or m.
            p: The parameters by name.
            trig: Sine and cosine of the joints' angles (`trig`); None makes them from q.

        Returns:
            M(q) (n × n), kg m² or kg.

        """
        trig = trig or self.sines_and_cosines(q)
        bodies = self.rigid_bodies(p)
        M = ca.SX.zeros(self.n, self.n)
        mass, hx, hy, inertia = 0, 0, 0, 0  # everything outboard, about the origin of frame j
        for j in reversed(range(self.n)):
            mass, hx, inertia = mass + bodies[j].mass, hx + bodies[j].first_moment, inertia + bodies[j].inertia
            # force and moment that accelerate the composite body along joint j
            if self.is_prismatic(j):
                fx, fy, moment = mass, 0, -hy
            else:
                fx, fy, moment = -hy, hx, inertia
            M[j, j] = self._along_joint(j, fx, moment)
            for k in reversed(range(j)):
                fx, fy = self._rotate_out_of_frame(k + 1, trig, fx, fy)
                moment = moment + self._offset_to_frame(k + 1, q, p) * fy
                M[k, j] = M[j, k] = self._along_joint(k, fx, moment)
            if j > 0:
                hx, hy = self._rotate_out_of_frame(j, trig, hx, hy)
                reach = self._offset_to_frame(j, q, p)
                inertia = inertia + reach * (2 * hx + reach * mass)
                hx = hx + reach * mass
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
        return self.newton_euler(q, zero, zero, p, (p["gravity_x"], p["gravity_y"]))

    def bias_torque(self, q: Any, v: Any, p: Parameters) -> Any:
        """Find the torque of a motion without acceleration.

        Args:
            q: Joint positions (n), rad or m.
            v: Joint velocities (n).
            p: The parameters by name.

        Returns:
            C(q, v) v + g(q) (n), N m or N.

        """
        return self.newton_euler(q, v, [0] * self.n, p, (p["gravity_x"], p["gravity_y"]))

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
