"""The obstacle of IV.B: a bottle of six litres that slides on the table when the tip presses it.

Legend: n direction from the bottle's axis to the tip; depth of the tip inside the bottle's circle; f contact force
along n; p, v place and velocity of the bottle, which dry friction holds while f stays below μ m g.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot

import numpy as np

from hdagen.arm.arrays import Array

BOTTLE_MASS, BOTTLE_RADIUS = 6.0, 0.09  # kg, m: six litres; assumed: a bottle about 24 cm high
BOTTLE_FRICTION = 0.3  # assumed: PET on a table; it slides from 17.7 N on
BOTTLE_STIFFNESS, BOTTLE_DAMPING = (
    5e3,
    20.0,
)  # N/m, N s/m, assumed: a full bottle's wall gives 4 mm where it begins to slide
GRAVITY = 9.81
STEPS_PER_TICK = 10  # steps of the bottle per tick


@dataclass
class Bottle:
    """A world for `hdagen.simulation.simulator.run`, which records every tick: ``force`` on the tip (2, N), ``place``
    (2, m) and ``depth`` (m, negative where tip and bottle are apart). ``at``: first place, m; ``period`` of a tick,
    s."""

    at: tuple[float, float]
    period: float = 1e-3
    mass: float = BOTTLE_MASS
    stiffness: float = BOTTLE_STIFFNESS
    friction: float = BOTTLE_FRICTION
    force: list[Array] = field(default_factory=list)
    place: list[Array] = field(default_factory=list)
    depth: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.p, self.v = np.array(self.at, float), np.zeros(2)

    def __call__(self, tip: Array, velocity: Array) -> Array:
        """Force of the bottle on the tip (2, N), held over the tick in which the bottle moves on."""
        (x, y), (px, py), (vx, vy) = tip.tolist(), self.p.tolist(), self.v.tolist()
        away = hypot(x - px, y - py)
        nx, ny = 0.0, 1.0
        if away:
            nx, ny = (x - px) / away, (y - py) / away
        depth, size = BOTTLE_RADIUS - away, 0.0
        if depth > 0:
            closing = -(nx * (float(velocity[0]) - vx) + ny * (float(velocity[1]) - vy))
            size = max(self.stiffness * depth + BOTTLE_DAMPING * closing, 0.0)
        push = np.array([size * nx, size * ny])
        self.force.append(push)
        self.place.append(self.p)
        self.depth.append(depth)
        self._slide_bottle(-size * nx, -size * ny, vx, vy)
        return push

    def _slide_bottle(self, fx: float, fy: float, vx: float, vy: float) -> None:
        """Move the bottle under force and Coulomb friction, which holds at rest, opposes motion and stops it."""
        level, h = self.friction * self.mass * GRAVITY, self.period / STEPS_PER_TICK
        pushed = hypot(fx, fy)
        if vx == vy == 0.0 and pushed <= level:
            return
        px, py = self.p.tolist()
        for _ in range(STEPS_PER_TICK):
            if vx == vy == 0.0:
                if pushed <= level:
                    break
                vx, vy = (h * (f - level * f / pushed) / self.mass for f in (fx, fy))
            else:
                free_x, free_y = vx + h * fx / self.mass, vy + h * fy / self.mass
                left = hypot(free_x, free_y)
                share = 1.0
                if left:
                    share = max(0.0, 1.0 - h * level / self.mass / left)
                vx, vy = free_x * share, free_y * share
            px, py = px + h * vx, py + h * vy
        self.p, self.v = np.array([px, py]), np.array([vx, vy])
