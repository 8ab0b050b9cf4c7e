"""Runs against the bottle, and the numbers that Figs. 18 to 21 and Table V show of them.

The published sets stand beside sets with the same intent (from 1 to 3 a smaller K and a larger B) that make physical
sense, the same for both controllers, so that what differs between these comes from the controllers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from hdagen.paper.bottle import FRICTION, GRAVITY, MASS, RADIUS, STIFFNESS, Bottle
from hdagen.paper.prototype import CENTER, PERIOD, TURN, Bench
from hdagen.paper.prototype import RADIUS as CIRCLE
from hdagen.paper.tracking import Tracked, tracked
from hdagen.plant import Array

SECONDS = 2 * TURN
DEEP = 0.015  # m that the circle runs through the bottle, assumed: at the circle's top
PLACE = (CENTER[0], CENTER[1] + CIRCLE + RADIUS - DEEP)
TABLE_5 = {  # kg, N s/m, N/m; the impedance masses are grams as Table V prints them, see the errata
    "admittance": ((500.0, 0.5, 100.0), (500.0, 1.0, 10.0), (500.0, 2.0, 1.0)),
    "impedance": ((1e-3, 1e-10, 1e-5), (1.5e-3, 1e-7, 1e-12), (2e-3, 1e-4, 1e-22)),
}
SENSIBLE = ((2.0, 45.0, 2000.0), (2.0, 60.0, 700.0), (2.0, 90.0, 250.0))
FAST = 5.0  # Hz: what is faster than the motion counts as vibration
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
        """How far the bottle keeps the tip off its path at most, m."""
        touching = self.depth > 0
        return float(np.linalg.norm(self.run.off[touching], axis=1).max()) if touching.any() else 0.0

    @property
    def vibration(self) -> float:
        """rms of what is faster than FAST in the tip's distance from its path, from the first touch on, m."""
        from scipy.signal import butter, sosfiltfilt

        touching = np.flatnonzero(self.depth > 0)
        if not len(touching):
            return 0.0
        sos = butter(2, FAST, "high", fs=1 / PERIOD, output="sos")
        fast = sosfiltfilt(sos, self.run.off, axis=0)[touching[0] : touching[0] + round(2.0 / PERIOD)]
        return float(np.sqrt(np.mean(np.sum(fast**2, axis=1))))

    def numbers(self) -> dict[str, float | None]:
        """Contact force, energy, clearance and the rest, SI."""
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
    """Two circles, the bottle in the way of the first."""

    def make() -> Collided:
        world = Bottle(PLACE, stiffness=stiffness, friction=friction)
        found = tracked(bench, law, mbk, (), SECONDS, fine, world=world, seed=seed)
        return Collided(found, np.array(world.force), np.array(world.place), np.array(world.depth))

    return bench.once(("collided", law, mbk, fine, stiffness, friction, seed), make)


def sets(bench: Bench, law: str, published: bool = False) -> list[Collided]:
    """The three sets of a law."""
    return [collided(bench, law, mbk) for mbk in (TABLE_5[law] if published else SENSIBLE)]


def farther(bench: Bench, fine: bool, seed: int) -> list[float]:
    """By how much admittance control yields more than impedance control, set by set, m."""
    impedance, admittance = (
        [collided(bench, law, mbk, fine, seed=seed).pushed_back for mbk in SENSIBLE]
        for law in ("impedance", "admittance")
    )
    return [theirs - ours for ours, theirs in zip(impedance, admittance, strict=True)]


def vibrations(bench: Bench, law: str) -> dict[str, list[float]]:
    """Vibration by B at the second set's K, and by K at its B, m rms."""
    M, B, K = SENSIBLE[1]
    return {
        "B": [collided(bench, law, (M, b, K)).vibration for b in BY_B],
        "K": [collided(bench, law, (M, B, k)).vibration for k in BY_K],
    }


def starts(bench: Bench) -> dict[str, tuple[float, float]]:
    """Largest error in x (m) in the first second and in the four after it, impedance control without the bottle, of the
    controller as the paper has it, without a disturbance observer, with and without dry friction, and with one."""
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
