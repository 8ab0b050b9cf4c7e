"""Runs against the bottle, and their numbers for Figs. 18 to 21 and Table V.

The published sets stand beside sets with the same intent (from 1 to 3 a smaller K and a larger B) that make physical
sense. These are the same for both controllers, so that every difference comes from the controllers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.paper.figures.tracking_runs import TrackingRun, track_circle
from hdagen.paper.prototype.bottle import BOTTLE_FRICTION, BOTTLE_MASS, BOTTLE_RADIUS, BOTTLE_STIFFNESS, GRAVITY, Bottle
from hdagen.paper.prototype.virtual_prototype import CIRCLE_CENTER, PERIOD, TURN_SECONDS, Bench
from hdagen.paper.prototype.virtual_prototype import CIRCLE_RADIUS as CIRCLE

COLLISION_SECONDS = 2 * TURN_SECONDS
BOTTLE_OVERLAP = 0.015  # m, assumed: depth of the circle's top inside the bottle
BOTTLE_PLACE = (CIRCLE_CENTER[0], CIRCLE_CENTER[1] + CIRCLE + BOTTLE_RADIUS - BOTTLE_OVERLAP)
TABLE_5 = {  # kg, N s/m, N/m; the impedance masses are grams as Table V prints them, see the errata
    "admittance": ((500.0, 0.5, 100.0), (500.0, 1.0, 10.0), (500.0, 2.0, 1.0)),
    "impedance": ((1e-3, 1e-10, 1e-5), (1.5e-3, 1e-7, 1e-12), (2e-3, 1e-4, 1e-22)),
}
COLLISION_SETS = ((2.0, 45.0, 2000.0), (2.0, 60.0, 700.0), (2.0, 90.0, 250.0))
VIBRATION_FREQUENCY = 5.0  # Hz from which a displacement counts as vibration: the motion is slower
DAMPING_VALUES, STIFFNESS_VALUES = (20.0, 45.0, 90.0, 180.0), (250.0, 700.0, 2000.0, 4000.0)


@dataclass(frozen=True)
class CollisionRun:
    """A run against the bottle: ``force`` (T, 2, N) on the tip, ``place`` (T, 2, m) of the bottle, ``depth`` (T, m)."""

    run: TrackingRun
    force: Array
    place: Array
    depth: Array

    @property
    def largest_push_back(self) -> float:
        """Largest distance of the tip from its path while it touches the bottle, m."""
        touching = self.depth > 0
        return float(np.linalg.norm(self.run.path_error[touching], axis=1).max(initial=0.0))

    @property
    def vibration_rms(self) -> float:
        """rms of the tip's path error above FAST, in the 2 s from the first touch on, m."""
        from scipy.signal import butter, sosfiltfilt

        touching = np.flatnonzero(self.depth > 0)
        if not len(touching):
            return 0.0
        sos = butter(2, VIBRATION_FREQUENCY, "high", fs=1 / PERIOD, output="sos")
        fast = sosfiltfilt(sos, self.run.path_error, axis=0)[touching[0] : touching[0] + round(2.0 / PERIOD)]
        return float(np.sqrt(np.mean(np.sum(fast**2, axis=1))))

    def collect_numbers(self) -> dict[str, float | None]:
        """Collect the run's numbers, SI: contact force, energy, clearance, vibration."""
        size = np.linalg.norm(self.force, axis=1)
        step = np.diff(self.run.simulation.tip, axis=0)
        work = -np.sum(self.force[:-1] * step)
        slid = np.sum(np.linalg.norm(np.diff(self.place, axis=0), axis=1))
        return {
            "largest_force": float(size.max()), "impulse": float(size.sum() * PERIOD), "work_on_bottle": float(work),
            "slid": float(slid), "lost_in_sliding": float(BOTTLE_FRICTION * BOTTLE_MASS * GRAVITY * slid),
            "pushed_back": self.largest_push_back,
            "clearance_after": float(-self.depth[-round(TURN_SECONDS / PERIOD) :].max()),
            "vibration": self.vibration_rms, "lost_at": self.run.lost_at,
        }  # fmt: skip


def run_collision(
    bench: Bench,
    law: str,
    mbk: tuple[float, float, float],
    fine: bool = False,
    stiffness: float = BOTTLE_STIFFNESS,
    friction: float = BOTTLE_FRICTION,
    seed: int = 1,
) -> CollisionRun:
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

    def make() -> CollisionRun:
        world = Bottle(BOTTLE_PLACE, stiffness=stiffness, friction=friction)
        found = track_circle(bench, law, mbk, (), COLLISION_SECONDS, fine, world=world, seed=seed)
        return CollisionRun(found, np.array(world.force), np.array(world.place), np.array(world.depth))

    return bench.compute_once(("collided", law, mbk, fine, stiffness, friction, seed), make)


def run_parameter_sets(bench: Bench, law: str, published: bool = False) -> list[CollisionRun]:
    """Run the three sets of a law.

    Args:
        bench: arms and shared runs.
        law: "impedance", "admittance" or "predictive".
        published: the sets of Table V in place of SENSIBLE.

    Returns:
        Three runs, in the order of the sets.

    """
    chosen = TABLE_5[law] if published else COLLISION_SETS
    return [run_collision(bench, law, mbk) for mbk in chosen]


def compare_push_back(bench: Bench, fine: bool, seed: int) -> list[float]:
    """Compare the largest push-back of both laws.

    Args:
        bench: arms and shared runs.
        fine: encoders of 4096 counts in place of Hall sensors.
        seed: of the sensors' noise.

    Returns:
        Push-back of admittance control less that of impedance control, for each of SENSIBLE, m.

    """

    def pushed_back(law: str, mbk: tuple[float, float, float]) -> float:
        return run_collision(bench, law, mbk, fine, seed=seed).largest_push_back

    impedance = [pushed_back("impedance", mbk) for mbk in COLLISION_SETS]
    admittance = [pushed_back("admittance", mbk) for mbk in COLLISION_SETS]
    return [theirs - ours for ours, theirs in zip(impedance, admittance, strict=True)]


def measure_vibrations(bench: Bench, law: str) -> dict[str, list[float]]:
    """Measure the vibration against B and against K.

    Args:
        bench: arms and shared runs.
        law: "impedance" or "admittance".

    Returns:
        m rms: "B" for each of BY_B at the second set's K, "K" for each of BY_K at its B.

    """
    M, B, K = COLLISION_SETS[1]
    return {
        "B": [run_collision(bench, law, (M, b, K)).vibration_rms for b in DAMPING_VALUES],
        "K": [run_collision(bench, law, (M, B, k)).vibration_rms for k in STIFFNESS_VALUES],
    }


def measure_start_errors(bench: Bench) -> dict[str, tuple[float, float]]:
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
        run = bench.compute_once(
            ("starts", name),
            partial(
                track_circle, bench, "impedance", COLLISION_SETS[1], (), TURN_SECONDS, changes=changes, gains=gains
            ),
        )
        error, begun = np.abs(run.path_error[:, 0]), run.log.time < 1.0
        found[name] = float(error[begun].max()), float(error[~begun].max())
    return found
