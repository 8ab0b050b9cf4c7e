"""The step that RK4 carries: springs and walls oscillate, a dashpot d between rotor and link decays at
d (1/M + 1/(N² J)).

RK4 carries a decay only up to 2.78 a step, and an oscillation up to 2.83. A robot file that its own step does not carry
is refused at the build; a diagnosis or a user may ask for more damping afterwards, or for a spring in a drive that the
file calls rigid, and would see the model fly apart. A stiff wall loads a joint beyond what its motor does, where a
spring is many times as stiff.

Legend: d damping, N m s/rad; C compliance, rad/(N m); M, J inertia of link and rotor, kg m²; N ratio; p parameters
(np).
Source: Hairer, Wanner, Solving Ordinary Differential Equations II (1996), IV.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hdagen.torques import full_torque

if TYPE_CHECKING:
    from hdagen.plant import Arm, Array

STABLE = 2.5  # of the decay, or of the oscillation, a step, with a margin
BEYOND = 1.5  # times the robot file's own damping, which the build has looked at, up to which it counts for nothing
POSES = 64
LOADED = 1.25  # of the oscillation at full torque, a step: a joint at a wall is loaded beyond
TINY = 1e-3  # N m, below which a spring is at rest
DEEP = 0.05  # rad or m: what takes half of the full torque within this depth is a stiff wall


@dataclass(frozen=True, eq=False)
class Carried:
    """``places`` of the springs' damping in p; ``looseness`` 1/M + 1/(N² J) of each, the largest over poses,
    1/(kg m²); ``usual``: the decay that the robot file's own damping makes at most, 1/s; ``missing``: of the springs
    that the file does not have, which of those it is, and the places of C and of d beside it; ``walls``: places of
    stiffnesses, from which on each is a stiff wall, and the looseness and the stiffness at full torque of its joint."""

    places: tuple[int, ...]
    looseness: Array
    usual: float
    missing: tuple[tuple[int, int, int], ...]
    walls: tuple[tuple[int, float, float, float], ...]

    @classmethod
    def of(cls, arm: Arm) -> Carried:
        """That of an arm as its robot file describes it."""
        flexible, described = arm.manifest["flexible"], arm.parameters.described
        if not flexible:
            return cls((), np.zeros(0), 0.0, (), ())
        names, nominal = list(described), np.array([q.nominal for q in described.values()])
        arm = arm.at(nominal)
        q = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, arm.n))
        inverse = np.linalg.inv(arm.evaluate("mass_matrix", q=q)["M"].reshape(-1, arm.n, arm.n))
        full = full_torque(arm)
        loaded = _stiffness(arm, full)
        own = np.diagonal(inverse, axis1=1, axis2=2).max(0)[[j - 1 for j in flexible]]
        rotors = [described[f"ratio_{j}"].nominal ** 2 * described[f"motor_inertia_{j}"].nominal for j in flexible]
        places = tuple(names.index(f"torsional_damping_{j}") for j in flexible)
        looseness = np.asarray(own + 1.0 / np.array(rotors))
        missing = tuple(
            (at, names.index(f"missing_compliance_{j}"), names.index(f"missing_damping_{j}"))
            for at, j in enumerate(flexible)
            if f"missing_compliance_{j}" in described
        )
        walls = []
        for loose, stiffness, j in zip(looseness, loaded, flexible, strict=True):
            for name in (f"contact_stiffness_above_{j}", f"contact_stiffness_below_{j}"):
                if name in described:
                    walls.append((names.index(name), 0.5 * full[j - 1] / DEEP, float(loose), float(stiffness)))
        return cls(places, looseness, float(looseness @ nominal[list(places)]), missing, tuple(walls))

    def longest(self, p: Array) -> float:
        """What RK4 carries with parameters ``p``, s: the joints' decays are added, which bounds the fastest, and so are
        squares of the oscillations that no file has looked at; inf where neither is beyond the robot file's own."""
        decay = float(self.looseness @ p[list(self.places)])
        step = STABLE / decay if decay > BEYOND * self.usual else np.inf
        for place, stiff, loose, stiffness in self.walls:
            if p[place] >= stiff:
                step = min(step, LOADED / float(np.sqrt(loose * (stiffness + p[place]))))
        if not self.missing:
            return step
        which, compliance, damping = map(list, zip(*self.missing, strict=True))
        own = self.looseness[which]
        fastest = max(decay + float(own @ p[damping]), float(np.sqrt(np.sum(own / p[compliance]))))
        return min(step, STABLE / fastest)

    def loaded(self, arm: Arm, load: Array) -> float:
        """What RK4 carries with the springs at a load (n), N m, s: they stiffen. The squares of the oscillations are
        added, which bounds the fastest; inf in an arm without springs."""
        fastest = float(np.sqrt(self.looseness @ _stiffness(arm, load)))
        return STABLE / fastest if fastest > 0.0 else np.inf

    def springs(self, step: float) -> dict[int, tuple[float, float]]:
        """Within which the C and d, by place, of each spring that the file does not have lie for a ``step``, s."""
        bounds = {}
        for which, compliance, damping in self.missing:
            loose = float(self.looseness[which])
            bounds[compliance] = loose * (step / STABLE) ** 2, np.inf
            bounds[damping] = 0.0, STABLE / (loose * step)
        return bounds


def _stiffness(arm: Arm, load: Array) -> Array:
    """Of the springs, each at its torque of ``load`` (n), N m/rad."""
    flexible = [j - 1 for j in arm.manifest["flexible"]]
    torques = np.maximum(np.abs(load), TINY)
    ends = [arm.evaluate("torsion", joint_torque=share * torques)["torsion"] for share in (0.99, 1.0)]
    return np.asarray(0.01 * torques[flexible] / np.abs(ends[1] - ends[0])[flexible])
