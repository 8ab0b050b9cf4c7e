"""The axes of the target: where the arm is on them, its admittance's force, and the goal of a node.

Legend: q joint positions; e displacement that the admittance gives the target; of a tip in space p its position, R its
orientation, R_d that of the path, E = exp [e]× in its turn, R_k that of a node's trajectory, D(e) left Jacobian
(`gen.model.rotation_vectors`).

The axes are the joints, or the tip's position, and in space its turn. A turn has no coordinates that are good
everywhere, so each node has its own: the rotation vector from R_k. There R_k is at 0, the Jacobian of the turn is that
of the angular velocity, and the goal is the rotation vector of (E R_d) R_kᵀ. The slope of its square is exact, as
D(e)ᵀ e = e. The admittance is that of `gen.model.tip_laws_in_space`: M ë + B ė + K e = D(e)ᵀ m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from gen.model.arm_model import Model
from gen.model.emitted_function import make_dense_function
from gen.model.rotation_vectors import (
    find_left_jacobian,
    find_rotation_vector,
    invert_left_jacobian,
    make_rotation_matrix,
)
from gen.mpc.problem_structure import Structure

SX = ca.SX
ORIENTATION_SIZE = 9  # entries of a rotation matrix


@dataclass(frozen=True)
class TargetAxes:
    """The axes of a target: ``positions`` of them are places, and after these ``turns`` are turns of the tip."""

    model: Model
    structure: Structure

    @property
    def follows_pose(self) -> bool:
        """Whether the target is a pose in space."""
        return self.structure.space == "tip" and bool(self.model.chain.in_space)

    @property
    def positions(self) -> int:
        """Axes that are places."""
        if self.structure.space == "joint":
            return self.model.n
        return len(self.model.chain.axes)

    @property
    def count(self) -> int:
        """Axes in all."""
        return 2 * self.positions if self.follows_pose else self.positions

    @property
    def orientation_size(self) -> int:
        """Entries of the orientation that a node tells beside its outputs."""
        return ORIENTATION_SIZE if self.follows_pose else 0

    def list_functions(self, c: Any) -> tuple[ca.Function, ...]:
        """Write the functions that the controller calls outside of the horizon's stage.

        Args:
            c: The symbols of the model's constants.

        Returns:
            ``place`` of the arm: the axes' positions and the orientation; ``begin``: displacement and velocity with
            which the target starts at the arm; ``pull``: what a force along the axes is for the displacement;
            ``goal`` of a node: positions and velocities.

        """
        k, q = self.count, SX.sym("q", self.model.n)
        place = SX.sym("place", self.positions + self.orientation_size)
        path, moved = SX.sym("path", 2 * k), SX.sym("moved", 2 * k)
        force, seen = SX.sym("force", k), SX.sym("seen", self.orientation_size)
        return (
            make_dense_function("axes_place", {"q": q, "c": c}, {"place": self._find_place(q)}),
            make_dense_function("axes_begin", {"place": place, "path": path}, {"moved": self._begin(place, path)}),
            make_dense_function("axes_pull", {"moved": moved, "force": force}, {"pull": self._pull(moved, force)}),
            make_dense_function(
                "axes_goal", {"path": path, "moved": moved, "seen": seen}, {"goal": self._find_goal(path, moved, seen)}
            ),
        )

    def _find_place(self, q: Any) -> Any:
        if self.structure.space == "joint":
            return q
        chain = self.model.chain
        place = chain.tip_position(q, self.model.chain_parameters())
        if self.follows_pose:
            return ca.vertcat(place, ca.vec(chain.tip_rotation(q)))
        return place

    def _begin(self, place: Any, path: Any) -> Any:
        """As far as the arm is from its path, and at rest, so that starting asks for no jump."""
        k, first = self.count, self.positions
        if not self.follows_pose:
            return ca.vertcat(place - path[:k], -path[k:])
        wanted = make_rotation_matrix(path[first:k])
        e = find_rotation_vector(ca.reshape(place[first:], 3, 3) @ wanted.T)
        turning = -invert_left_jacobian(-e) @ path[k + first :]
        return ca.vertcat(place[:first] - path[:first], e, -path[k : k + first], turning)

    def _pull(self, moved: Any, force: Any) -> Any:
        if not self.follows_pose:
            return force
        e = moved[self.positions : self.count]
        return ca.vertcat(force[: self.positions], find_left_jacobian(e).T @ force[self.positions :])

    def _find_goal(self, path: Any, moved: Any, seen: Any) -> Any:
        k, first = self.count, self.positions
        if not self.follows_pose:
            return path + moved
        e, rate = moved[first:k], moved[k + first :]
        E = make_rotation_matrix(e)
        turn = find_rotation_vector(E @ make_rotation_matrix(path[first:k]) @ ca.reshape(seen, 3, 3).T)
        turning = find_left_jacobian(e) @ rate + E @ path[k + first :]
        along = path[:first] + moved[:first], path[k : k + first] + moved[k : k + first]
        return ca.vertcat(along[0], turn, along[1], turning)
