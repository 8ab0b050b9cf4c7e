"""The obstacle of IV.B: a bottle of six litres on the table, which the tip presses and which slides.

Legend: n from the bottle's axis to the tip; depth by which the tip is inside the bottle's round; f contact force along
n; p, v place and velocity of the bottle, which dry friction holds while f stays below μ m g.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hdagen.plant import Array

MASS, RADIUS = 6.0, 0.09  # kg, m: six litres; assumed: a bottle about 24 cm high
FRICTION = 0.3  # assumed: PET on a table; it slides from 17.7 N on
STIFFNESS, DAMPING = 5e3, 20.0  # N/m, N s/m, assumed: a full bottle's wall gives 4 mm where it begins to slide
GRAVITY = 9.81
PARTS = 10  # steps of the bottle in a tick


@dataclass
class Bottle:
    """A world for `simulate.run`, with what happened tick by tick: ``force`` on the tip (2, N), ``place`` (2, m) and
    ``depth`` (m, negative where apart)."""

    at: tuple[float, float]
    period: float = 1e-3
    mass: float = MASS
    stiffness: float = STIFFNESS
    friction: float = FRICTION
    force: list[Array] = field(default_factory=list)
    place: list[Array] = field(default_factory=list)
    depth: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.p, self.v = np.array(self.at, float), np.zeros(2)

    def __call__(self, tip: Array, velocity: Array) -> Array:
        """Force of the bottle on the tip, N (2), held over the tick in which the bottle moves on."""
        away = tip - self.p
        distance = float(np.hypot(*away))
        n = away / distance if distance else np.array([0.0, 1.0])
        depth = RADIUS - distance
        closing = -float(n @ (velocity - self.v))
        push = max(self.stiffness * depth + DAMPING * closing, 0.0) * n if depth > 0 else np.zeros(2)
        self.force.append(push)
        self.place.append(self.p.copy())
        self.depth.append(depth)
        self._slide(-push)
        return push

    def _slide(self, push: Array) -> None:
        """Coulomb friction: at rest it holds, in motion it opposes and stops."""
        level, h = self.friction * self.mass * GRAVITY, self.period / PARTS
        for _ in range(PARTS):
            speed = float(np.hypot(*self.v))
            if speed == 0.0:
                pushed = float(np.hypot(*push))
                if pushed <= level:
                    return
                self.v = h * (push - level * push / pushed) / self.mass
            else:
                free = self.v + h * push / self.mass
                left = float(np.hypot(*free))
                self.v = free * max(0.0, 1.0 - h * level / self.mass / left) if left else free
            self.p = self.p + h * self.v
