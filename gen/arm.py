"""The planar chain of rigid links: kinematics, mass matrix, recursion of forces.

Legend: q joint positions, v velocities, a accelerations (n×1 each); s, c sine and cosine of each revolute q;
L length, m mass, r centre of mass from the joint's axis, I inertia about the centre of mass; g gravity (2).
Everything is computed link by link in the link's own frame (x along the link), so only the relative angles enter.

A revolute joint turns its link; a prismatic joint slides it along its own x and has no length.
Sources: Newton–Euler recursion and composite bodies as in Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 5
and 6, restricted to the plane; paper (18)–(21). `gen.lagrangian` derives the same from the Lagrangian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

Parameters = Mapping[str, Any]
Trig = tuple[Sequence[Any], Sequence[Any]]


@dataclass(frozen=True)
class Body:
    """A link with whatever is fixed to it: mass, first moment along x, inertia about the joint's axis."""

    mass: Any
    moment: Any
    inertia: Any


class Chain:
    """Planar serial chain of ``kinds`` ("revolute" or "prismatic"), base first."""

    def __init__(self, kinds: Sequence[str]) -> None:
        self.kinds = tuple(kinds)
        self.n = len(self.kinds)

    # -- parameters -------------------------------------------------------------------------------------------------

    def _length(self, j: int, p: Parameters) -> Any:
        return p[f"length_{j + 1}"] if self.kinds[j] == "revolute" else 0

    def bodies(self, p: Parameters) -> list[Body]:
        """The links about their joints' axes; ``tip_mass`` in p (kg, optional) is a point at the end of the last."""
        bodies = []
        for j in range(self.n):
            m, r = p[f"mass_{j + 1}"], p[f"center_of_mass_{j + 1}"]
            bodies.append(Body(m, m * r, p[f"inertia_{j + 1}"] + m * r * r))
        extra = p.get("tip_mass", 0)
        length = self._length(self.n - 1, p)
        last = bodies[-1]
        bodies[-1] = Body(last.mass + extra, last.moment + extra * length, last.inertia + extra * length * length)
        return bodies

    # -- geometry ---------------------------------------------------------------------------------------------------

    def trig(self, q: Any) -> Trig:
        """Sine and cosine of the revolute joints' angles; 0 and 1 for prismatic joints."""
        turns = [kind == "revolute" for kind in self.kinds]
        return (
            [ca.sin(q[j]) if turn else 0 for j, turn in enumerate(turns)],
            [ca.cos(q[j]) if turn else 1 for j, turn in enumerate(turns)],
        )

    def _into(self, j: int, trig: Trig, x: Any, y: Any) -> tuple[Any, Any]:
        """Components in frame j of a vector given in frame j − 1."""
        if self.kinds[j] == "prismatic":
            return x, y
        s, c = trig[0][j], trig[1][j]
        return c * x + s * y, c * y - s * x

    def _out_of(self, j: int, trig: Trig, x: Any, y: Any) -> tuple[Any, Any]:
        """Components in frame j − 1 of a vector given in frame j."""
        if self.kinds[j] == "prismatic":
            return x, y
        s, c = trig[0][j], trig[1][j]
        return c * x - s * y, s * x + c * y

    def _reach(self, j: int, q: Any, p: Parameters) -> Any:
        """Distance from the origin of frame j − 1 to that of frame j, along x of frame j − 1."""
        before = self._length(j - 1, p) if j > 0 else 0
        return before + q[j] if self.kinds[j] == "prismatic" else before

    def points(self, q: Any, p: Parameters) -> Any:
        """(n + 1) × 2: the joints' origins and the tip, in the base frame, m."""
        trig = self.trig(q)
        rows = []
        for end in range(self.n + 1):
            x, y = (0, 0) if end < self.n else (self._length(self.n - 1, p), 0)
            for j in reversed(range(min(end + 1, self.n))):
                x, y = self._out_of(j, trig, x, y)
                x = x + self._reach(j, q, p)
            rows.append(ca.horzcat(x, y))
        return ca.vertcat(*rows)

    def tip(self, q: Any, p: Parameters) -> Any:
        """Position of the tip in the base frame, m (2)."""
        return self.points(q, p)[self.n, :].T

    def jacobian(self, q: Any, p: Parameters) -> Any:
        """∂tip/∂q (2 × n), base frame."""
        trig = self.trig(q)
        columns = []
        for j in range(self.n):
            x, y = self._length(self.n - 1, p), 0
            for k in reversed(range(j + 1, self.n)):  # the tip as seen from the origin of frame j
                x, y = self._out_of(k, trig, x, y)
                x = x + self._reach(k, q, p)
            x, y = (-y, x) if self.kinds[j] == "revolute" else (1, 0)
            for k in reversed(range(j + 1)):
                x, y = self._out_of(k, trig, x, y)
            columns.append(ca.vertcat(x, y))
        return ca.horzcat(*columns)

    def branches(self, point: Any, p: Parameters) -> Any:
        """Both inverse branches of the two-revolute arm, paper (21) corrected: columns elbow down (q2 ≥ 0), elbow up.

        Out of reach the cosine is outside [−1, 1] and every entry is NaN, so no posture is ever invented.
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

    def recursion(
        self, q: Any, v: Any, a: Any, p: Parameters, gravity: Any, force: Any = (0, 0), trig: Trig | None = None
    ) -> Any:
        """Joint torques M a + C v + g − Jᵀ F (n), F the force of the world on the tip in the base frame, N."""
        trig = trig or self.trig(q)
        bodies = self.bodies(p)
        spin, spun = 0, 0  # angular velocity and acceleration of the frame
        ax, ay = -gravity[0], -gravity[1]
        fx, fy = force[0], force[1]
        pulls: list[tuple[Any, Any, Any]] = []
        for j, body in enumerate(bodies):
            reach = self._reach(j, q, p)
            ax, ay = (
                ax - spin * spin * reach,
                ay + spun * reach,
            )  # acceleration of the origin of frame j, in frame j − 1
            if self.kinds[j] == "prismatic":
                ax, ay = ax + a[j], ay + 2 * spin * v[j]
            else:
                spin, spun = spin + v[j], spun + a[j]
            ax, ay = self._into(j, trig, ax, ay)
            fx, fy = self._into(j, trig, fx, fy)
            pulls.append(
                (
                    body.mass * ax - body.moment * spin * spin,
                    body.mass * ay + body.moment * spun,
                    body.inertia * spun + body.moment * ay,
                )
            )
        px, py, pn = -fx, -fy, -self._length(self.n - 1, p) * fy
        torques: list[Any] = []
        for j in reversed(range(self.n)):
            px, py, pn = px + pulls[j][0], py + pulls[j][1], pn + pulls[j][2]
            torques.append(pn if self.kinds[j] == "revolute" else px)
            px, py = self._out_of(j, trig, px, py)
            pn = pn + self._reach(j, q, p) * py
        return ca.vertcat(*reversed(torques))

    def mass_matrix(self, q: Any, p: Parameters, trig: Trig | None = None) -> Any:
        """M(q) of the links (n × n), by composite bodies; reflected rotors are not in it."""
        trig = trig or self.trig(q)
        bodies = self.bodies(p)
        M = ca.SX.zeros(self.n, self.n)
        mass, hx, hy, inertia = 0, 0, 0, 0  # everything outboard, about the origin of frame j
        for j in reversed(range(self.n)):
            mass, hx, inertia = mass + bodies[j].mass, hx + bodies[j].moment, inertia + bodies[j].inertia
            # force and moment that accelerate the composite body along joint j
            fx, fy, moment = (-hy, hx, inertia) if self.kinds[j] == "revolute" else (mass, 0, -hy)
            M[j, j] = moment if self.kinds[j] == "revolute" else fx
            for k in reversed(range(j)):
                fx, fy = self._out_of(k + 1, trig, fx, fy)
                moment = moment + self._reach(k + 1, q, p) * fy
                M[k, j] = M[j, k] = moment if self.kinds[k] == "revolute" else fx
            if j > 0:
                hx, hy = self._out_of(j, trig, hx, hy)
                reach = self._reach(j, q, p)
                inertia = inertia + reach * (2 * hx + reach * mass)
                hx = hx + reach * mass
        return M

    def gravity(self, q: Any, p: Parameters) -> Any:
        """g(q) (n): the torque that holds the arm at rest."""
        zero = [0] * self.n
        return self.recursion(q, zero, zero, p, (p["gravity_x"], p["gravity_y"]))

    def bias(self, q: Any, v: Any, p: Parameters) -> Any:
        """C(q, v) v + g(q) (n)."""
        return self.recursion(q, v, [0] * self.n, p, (p["gravity_x"], p["gravity_y"]))

    def coriolis_matrix(self, q: Any, v: Any, p: Parameters) -> Any:
        """C(q, v) (n × n) by Christoffel symbols, so that dM/dt − 2C is skew."""
        M = self.mass_matrix(q, p)
        slopes = [ca.reshape(ca.jacobian(ca.vec(M), q[k]), self.n, self.n) for k in range(self.n)]
        C = ca.SX.zeros(self.n, self.n)
        for i in range(self.n):
            for j in range(self.n):
                C[i, j] = sum((slopes[k][i, j] + slopes[j][i, k] - slopes[i][j, k]) * v[k] for k in range(self.n)) / 2
        return C
