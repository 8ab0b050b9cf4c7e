"""Runs against the bottle, and their numbers for Figs. 18 to 21 and Table V.

The published sets stand beside sets with the same intent (from 1 to 3 a smaller K and a larger B) that make physical
sense. These are the same for both controllers, so that every difference comes from the controllers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.paper.figures.tracking_runs import Tracked, tracked
from hdagen.paper.prototype.bottle import FRICTION, GRAVITY, MASS, RADIUS, STIFFNESS, Bottle
from hdagen.paper.prototype.virtual_prototype import CENTER, PERIOD, TURN, Bench
from hdagen.paper.prototype.virtual_prototype import RADIUS as CIRCLE

SECONDS = 2 * TURN
DEEP = 0.015  # m, assumed: depth of the circle's top inside the bottle
PLACE = (CENTER[0], CENTER[1] + CIRCLE + RADIUS - DEEP)
TABLE_5 = {  # kg, N s/m, N/m; the impedance masses are grams as Table V prints them, see the errata
    "admittance": ((500.0, 0.5, 100.0), (500.0, 1.0, 10.0), (500.0, 2.0, 1.0)),
    "impedance": ((1e-3, 1e-10, 1e-5), (1.5e-3, 1e-7, 1e-12), (2e-3, 1e-4, 1e-22)),
}
SENSIBLE = ((2.0, 45.0, 2000.0), (2.0, 60.0, 700.0), (2.0, 90.0, 250.0))
FAST = 5.0  # Hz from which a displacement counts as vibration: the motion is slower
BY_B, BY_K = (20.0, 45.0, 90.0, 180.0), (250.0, 700.0, 2000.0, 4000.0)


@dataclass(frozen=True)
class Collided:
    """A run against the bottle: ``force`` (T, 2, N) on the tip, ``place`` (T, 2, m) of the bottle, ``depth`` (T, m)."""

    run: Tracked
    force: Array
    place: Array
    depth: Array

    @property
    def pushed_back(self) -> float:
        """Largest distance of the tip from its path while it touches the bottle, m."""
        touching = self.depth > 0
        return float(np.linalg.norm(self.run.off[touching], axis=1).max(initial=0.0))

    @property
    def vibration(self) -> float:
        """rms of the tip's path error above FAST, in the 2 s from the first touch on, m."""
        from scipy.signal import butter, sosfiltfilt

        touching = np.flatnonzero(self.depth > 0)
        if not len(touching):
            return 0.0
        sos = butter(2, FAST, "high", fs=1 / PERIOD, output="sos")
        fast = sosfiltfilt(sos, self.run.off, axis=0)[touching[0] : touching[0] + round(2.0 / PERIOD)]
        return float(np.sqrt(np.mean(np.sum(fast**2, axis=1))))

    def numbers(self) -> dict[str, float | None]:
        """Collect the run's numbers, SI: contact force, energy, clearance, vibration."""
        size = np.linalg.norm(self.force, axis=1)
        step = np.diff(self.run.simulation.tip, axis=0)
        work = -np.sum(self.force[:-1] * step)
        slid = np.sum(np.linalg.norm(np.diff(self.place, axis=0), axis=1))
        return {
            "largest_force": float(size.max()), "impulse": float(size.sum() * PERIOD), "work_on_bottle": float(work),
            "slid": float(slid), "lost_in_sliding": float(FRICTION * MASS * GRAVITY * slid),
            "pushed_back": self.pushed_back, "clearance_after": float(-self.depth[-round(TURN / PERIOD) :].max()),
            "vibration": self.vibration, "lost_at": self.run.lost,
        }  # fmt: skip


def collided(
    bench: Bench,
    law: str,
    mbk: tuple[float, float, float],
    fine: bool = False,
    stiffness: float = STIFFNESS,
    friction: float = FRICTION,
    seed: int = 1,
) -> Collided:
    """Run two circles with the bottle in the way of the first.

    Args:
        bench: arms and shared runs.
        law: "impedance", "admittance" or "predictive".
        mbk: M, kg, B, N s/m, K, N/m.
        fine: encoders of 4096 counts in place of Hall sensors.
        stiffness: of the bottle, N/m.
        friction: friction coefficient of the bottle on the table.
        seed: of the sensors' noise.

    Returns:
        The run; each is simulated once a bench.

    """

    def make() -> Collided:
        world = Bottle(PLACE, stiffness=stiffness, friction=friction)
        found = tracked(bench, law, mbk, (), SECONDS, fine, world=world, seed=seed)
        return Collided(found, np.array(world.force), np.array(world.place), np.array(world.depth))

    return bench.once(("collided", law, mbk, fine, stiffness, friction, seed), make)


def sets(bench: Bench, law: str, published: bool = False) -> list[Collided]:
    """Run the three sets of a law.

    Args:
        bench: arms and shared runs.
        law: "impedance", "admittance" or "predictive".
        published: the sets of Table V in place of SENSIBLE.

    Returns:
        Three runs, in the order of the sets.

    """
    chosen = TABLE_5[law] if published else SENSIBLE
    return [collided(bench, law, mbk) for mbk in chosen]


def farther(bench: Bench, fine: bool, seed: int) -> list[float]:
    """Compare the largest push-back of both laws.

    Args:
        bench: arms and shared runs.
        fine: encoders of 4096 counts in place of Hall sensors.
        seed: of the sensors' noise.

    Returns:
        Push-back of admittance control less that of impedance control, for each of SENSIBLE, m.

    """

    def pushed_back(law: str, mbk: tuple[float, float, float]) -> float:
        return collided(bench, law, mbk, fine, seed=seed).pushed_back

    impedance = [pushed_back("impedance", mbk) for mbk in SENSIBLE]
    admittance = [pushed_back("admittance", mbk) for mbk in SENSIBLE]
    return [theirs - ours for ours, theirs in zip(impedance, admittance, strict=True)]


def vibrations(bench: Bench, law: str) -> dict[str, list[float]]:
    """Measure the vibration against B and against K.

    Args:
        bench: arms and shared runs.
        law: "impedance" or "admittance".

    Returns:
        m rms: "B" for each of BY_B at the second set's K, "K" for each of BY_K at its B.

    """
    M, B, K = SENSIBLE[1]
    return {
        "B": [collided(bench, law, (M, b, K)).vibration for b in BY_B],
        "K": [collided(bench, law, (M, B, k)).vibration for k in BY_K],
    }


def starts(bench: Bench) -> dict[str, tuple[float, float]]:
    """Measure the start of impedance control without the bottle.

    Args:
        bench: arms and shared runs.

    Returns:
        Largest error in x, m, in the first second and in the four after it: of the paper's controller, which has no
        disturbance observer, with and without dry friction, and of a controller with an observer.

    """
    none = {"coulomb_friction_1": 0.0, "coulomb_friction_2": 0.0}
    blind = {"observer_bandwidth": 0.0}
    tried = {"no observer": ({}, blind), "no observer, no dry friction": (none, blind), "with the observer": ({}, {})}
    found = {}
    for name, (changes, gains) in tried.items():
        run = bench.once(
            ("starts", name),
            partial(tracked, bench, "impedance", SENSIBLE[1], (), TURN, changes=changes, gains=gains),
        )
        error, begun = np.abs(run.off[:, 0]), run.log.time < 1.0
        found[name] = float(error[begun].max()), float(error[~begun].max())
    return found
