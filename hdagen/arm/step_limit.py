"""The longest step at which RK4 is stable for a flexible arm.

Springs and walls oscillate; a dashpot d between rotor and link decays at the rate d (1/M + 1/(N² J)). RK4 is stable up
to a decay of 2.78 a step, and up to an oscillation of 2.83. The build refuses a robot file whose own step is too long.
A diagnosis or a user may set more damping afterwards, or a spring in a drive that the file calls rigid; the model would
then diverge. A stiff wall loads a joint beyond its motor's torque, where a spring is many times as stiff.

Legend: d damping, N m s/rad; C compliance, rad/(N m); M, J inertia of link and rotor, kg m²; N ratio; p parameters
(np).
Source: Hairer, Wanner, Solving Ordinary Differential Equations II (1996), IV.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.interface import ArmInterface
from hdagen.arm.ratings import compute_rated_torque

RK4_STABILITY_LIMIT = 2.5  # largest rate times step, of a decay or an oscillation; RK4 is stable up to 2.78
CHECKED_DAMPING_RATIO = 1.5  # decay up to which no bound applies, over that of the robot file, which the build checks
MASS_MATRIX_POSES = 64  # random poses over which the mass matrix is looked at
WALL_STABILITY_LIMIT = 1.25  # largest oscillation times step at full torque: a wall loads a joint beyond it
LEAST_SPRING_TORQUE = 1e-3  # N m, below which a spring is at rest
STIFF_WALL_DEPTH = 0.05  # rad or m; a wall that takes half of the full torque within this depth is stiff


@dataclass(frozen=True, eq=False)
class StableStep:
    """The bounds on the step of an arm.

    Attributes:
        damping_indices: Index in p of each spring's damping.
        inverse_inertia: 1/M + 1/(N² J) of each spring, the largest over poses, 1/(kg m²).
        nominal_decay: The fastest decay with the robot file's own damping, 1/s.
        added_springs: For each spring that the file does not have: its number among the springs, and the indices in p
            of its C and d.
        stiff_walls: For each wall: the index in p of its stiffness, the stiffness from which it is a stiff wall,
            N m/rad, and the looseness and the stiffness at full torque of its joint's spring.

    """

    damping_indices: tuple[int, ...]
    inverse_inertia: Array
    nominal_decay: float
    added_springs: tuple[tuple[int, int, int], ...]
    stiff_walls: tuple[tuple[int, float, float, float], ...]

    @classmethod
    def from_arm(cls, arm: ArmInterface) -> StableStep:
        """Compute the bounds of an arm from its robot file.

        Args:
            arm: The arm; its present parameters do not count.

        Returns:
            The bounds; without any in a rigid arm.

        """
        flexible, described = arm.manifest["flexible"], arm.parameters.described
        if not flexible:
            return cls((), np.zeros(0), 0.0, (), ())
        names, nominal = list(described), np.array([q.nominal for q in described.values()])
        arm = arm.with_parameters(nominal)
        q = np.random.default_rng(0).uniform(-np.pi, np.pi, (MASS_MATRIX_POSES, arm.n))
        inverse = np.linalg.inv(arm.evaluate("mass_matrix", q=q)["M"].reshape(-1, arm.n, arm.n))
        full = compute_rated_torque(arm)
        loaded = _compute_spring_stiffness(arm, full)
        own = np.diagonal(inverse, axis1=1, axis2=2).max(0)[[j - 1 for j in flexible]]
        rotors = [described[f"ratio_{j}"].nominal ** 2 * described[f"motor_inertia_{j}"].nominal for j in flexible]
        places = tuple(names.index(f"torsional_damping_{j}") for j in flexible)
        looseness = np.asarray(own + 1.0 / np.array(rotors))
        springs = arm.effects.series_springs.values()
        missing = tuple(
            (at, names.index(f"{spring.compliance}_{j}"), names.index(f"{spring.damping}_{j}"))
            for at, j in enumerate(flexible)
            for spring in springs
            if f"{spring.compliance}_{j}" in described
        )
        walls, known_walls = [], [wall for traits in arm.effects.values() for wall in traits.walls]
        for loose, stiffness, j in zip(looseness, loaded, flexible, strict=True):
            for name in (f"{wall.stiffness}_{j}" for wall in known_walls):
                if name in described:
                    walls.append(
                        (names.index(name), 0.5 * full[j - 1] / STIFF_WALL_DEPTH, float(loose), float(stiffness))
                    )
        return cls(places, looseness, float(looseness @ nominal[list(places)]), missing, tuple(walls))

    def longest_step(self, p: Array) -> float:
        """Bound the step by the parameters.

        The joints' decays are added, which bounds the fastest one; so are the squares of the oscillations that the
        build has not checked.

        Args:
            p: (np), the parameters.

        Returns:
            The longest stable step, s; inf where the parameters are no faster than the robot file's own.

        """
        decay, step = float(self.inverse_inertia @ p[list(self.damping_indices)]), np.inf
        if decay > CHECKED_DAMPING_RATIO * self.nominal_decay:
            step = RK4_STABILITY_LIMIT / decay
        for place, stiff, loose, stiffness in self.stiff_walls:
            if p[place] >= stiff:
                step = min(step, WALL_STABILITY_LIMIT / float(np.sqrt(loose * (stiffness + p[place]))))
        if not self.added_springs:
            return step
        which, compliance, damping = map(list, zip(*self.added_springs, strict=True))
        own = self.inverse_inertia[which]
        fastest = max(decay + float(own @ p[damping]), float(np.sqrt(np.sum(own / p[compliance]))))
        return min(step, RK4_STABILITY_LIMIT / fastest)

    def longest_step_under_load(self, arm: ArmInterface, load: Array) -> float:
        """Bound the step by springs that stiffen under load.

        The squares of the oscillations are added, which bounds the fastest one.

        Args:
            arm: The arm.
            load: (n), the joints' torques, N m.

        Returns:
            The longest stable step, s; inf in an arm without springs.

        """
        fastest = float(np.sqrt(self.inverse_inertia @ _compute_spring_stiffness(arm, load)))
        if fastest <= 0.0:
            return np.inf
        return RK4_STABILITY_LIMIT / fastest

    def spring_bounds(self, step: float) -> dict[int, tuple[float, float]]:
        """Bound the springs that the robot file does not have, so that a step is stable.

        Args:
            step: The step, s.

        Returns:
            By index in p: the lower and upper bound of C, rad/(N m), and of d, N m s/rad.

        """
        bounds = {}
        for which, compliance, damping in self.added_springs:
            loose = float(self.inverse_inertia[which])
            bounds[compliance] = loose * (step / RK4_STABILITY_LIMIT) ** 2, np.inf
            bounds[damping] = 0.0, RK4_STABILITY_LIMIT / (loose * step)
        return bounds


def _compute_spring_stiffness(arm: ArmInterface, load: Array) -> Array:
    """The stiffness of each spring at its joint's torque in ``load`` (n, N m), N m/rad."""
    flexible = [j - 1 for j in arm.manifest["flexible"]]
    torques = np.maximum(np.abs(load), LEAST_SPRING_TORQUE)
    ends = [arm.evaluate("torsion", joint_torque=share * torques)["torsion"] for share in (0.99, 1.0)]
    return np.asarray(0.01 * torques[flexible] / np.abs(ends[1] - ends[0])[flexible])
