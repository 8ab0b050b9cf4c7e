"""Runs along the circle: three circles with a push on the second, as in Figs. 16 and 17.

A sensible set of parameters and predictive control of the same admittance stand beside the published parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.guarded_controller import Controller
from hdagen.log.measured_log import Log
from hdagen.mpc.configuration import Configuration
from hdagen.mpc.predictive_controller import MPC
from hdagen.paper.prototype.virtual_prototype import (
    PROTOTYPE,
    STRUCTURE_FAULTS,
    TURN_SECONDS,
    Bench,
    cartesian_gains,
    encoders_of,
    make_controller,
    make_guard,
    paper_circle,
)
from hdagen.simulation.simulator import EnvironmentForce, Push, Simulation, run

TRACKING_SECONDS = 3 * TURN_SECONDS
SETTLING_SECONDS = 1.0  # s in which the circle is brought to speed; they do not count
SHOVE_FORCE = 10.0  # N, assumed; the paper says "an external force"
TRACKING_PUSHES = (Push(6.0, 7.0, (SHOVE_FORCE, 0.0)), Push(8.0, 9.0, (0.0, SHOVE_FORCE)))
TRACKING_PUSH_BANDS = ((6.0, 7.0, f"{SHOVE_FORCE:g} N in x"), (8.0, 9.0, f"{SHOVE_FORCE:g} N in y"))
PUBLISHED_SETS = {"impedance": (0.001, 1e-10, 1e-5), "admittance": (1000.0, 0.5, 10.0)}  # kg, N s/m, N/m: Table III
TRACKING_SET = (2.0, 45.0, 500.0)  # a load for a hand, damping ratio 0.7, 20 mm under the push
TABLE_4 = {"impedance": ((3.1, 3.6), (1.5, 0.3), (2.4, 1.8)), "admittance": ((3.4, 3.7), (0.4, 1.5), (1.7, 0.8))}  # mm


@dataclass(frozen=True)
class TrackingRun:
    """A run along a ``path`` (T, 2, m): ``refused`` counts the ticks that the guard refused; ``lost_at`` is the time of
    the first of them, s (None without one), ``fault`` its message."""

    simulation: Simulation
    path: Array
    refused_ticks: int
    lost_at: float | None
    fault: str

    @property
    def path_error(self) -> Array:
        """Path error (T, 2, m): the tip less the path."""
        return self.simulation.tip - self.path

    @property
    def log(self) -> Log:
        """The log of the run."""
        return self.simulation.log

    def error_statistics(self, circles: Sequence[int]) -> Array:
        """Compute the largest error, the mean and the standard deviation over whole circles without the start.

        Args:
            circles: numbers of the circles, from 0.

        Returns:
            The three by axis (3, 2), m.

        """
        off = self.path_error_over(circles)
        return np.stack([np.abs(off).max(axis=0), np.abs(off.mean(axis=0)), off.std(axis=0)])

    def path_error_over(self, circles: Sequence[int]) -> Array:
        """Select the path error of whole circles without the start.

        Args:
            circles: numbers of the circles, from 0.

        Returns:
            Path error (rows, 2), m.

        """
        time = self.log.time
        rows = np.zeros(len(time), bool)
        for k in circles:
            rows |= (time >= max(k * TURN_SECONDS, SETTLING_SECONDS)) & (time < (k + 1) * TURN_SECONDS)
        return self.path_error[rows]


def track_circle(
    bench: Bench,
    law: str,
    mbk: tuple[float, float, float],
    pushes: Sequence[Push],
    seconds: float,
    fine: bool = False,
    changes: Mapping[str, float] | None = None,
    gains: Mapping[str, float] | None = None,
    world: EnvironmentForce | None = None,
    seed: int = 1,
) -> TrackingRun:
    """Run a law on the prototype along the circle; the controller does not know ``changes``.

    Args:
        bench: arms and shared runs.
        law: "impedance", "admittance" or "predictive".
        mbk: M, kg, B, N s/m, K, N/m.
        pushes: forces on the tip.
        seconds: length of the run, s.
        fine: encoders of 4096 counts in place of Hall sensors.
        changes: parameters of the true arm that differ from the prototype's, SI.
        gains: gains that differ from the law's own.
        world: the world that touches the tip.
        seed: of the sensors' noise.

    Returns:
        The run.

    """
    if law == "predictive":
        regulator = make_predictive_controller(bench, mbk)
    else:
        regulator = make_controller(
            bench.compute_once("known", bench.arm), law, {**cartesian_gains(*mbk), **(gains or {})}, fine
        )
    return follow_circle(bench.arm(changes=changes), regulator, pushes, seconds, fine, world, seed)


def follow_circle(
    plant: Arm,
    regulator: Controller,
    pushes: Sequence[Push],
    seconds: float,
    fine: bool = False,
    world: EnvironmentForce | None = None,
    seed: int = 1,
) -> TrackingRun:
    """Run a controller along the circle.

    Args:
        plant: the true arm.
        regulator: the controller.
        pushes: forces on the tip.
        seconds: length of the run, s.
        fine: encoders of 4096 counts in place of Hall sensors.
        world: the world that touches the tip.
        seed: of the sensors' noise.

    Returns:
        The run.

    """
    path = paper_circle(seconds)
    found = run(plant, regulator, path, pushes, encoders_of(fine), seed, world=world)
    refused = np.flatnonzero(found.status < 0)
    if not len(refused):
        return TrackingRun(found, path.position, 0, None, "")
    first = int(refused[0])
    fault = regulator.sentence(int(found.status[first]))
    return TrackingRun(found, path.position, len(refused), float(found.log.time[first]), fault)


def make_predictive_controller(bench: Bench, mbk: tuple[float, float, float], force: str = "sensor") -> Controller:
    """Make predictive control of an admittance.

    Args:
        bench: arms and shared runs.
        mbk: M, kg, B, N s/m, K, N/m.
        force: the tip force from the "sensor", or the "estimate" of the controller's filter.

    Returns:
        The controller.

    """
    names = ("mass", "damping", "stiffness")
    admittance: dict[str, Any] = {f"admittance__{name}": value for name, value in zip(names, mbk, strict=True)}
    wanted = Configuration().with_changes(**admittance, admittance__force=force)
    arm: Arm = bench.compute_once("predictive", lambda: load(PROTOTYPE, bench.profile, mpc=wanted))
    return MPC(arm, wanted, make_guard())


TRACKING_CASES = {  # law, M, B and K, whether with encoders of 4096 counts
    "impedance": ("impedance", TRACKING_SET, False),
    "admittance": ("admittance", TRACKING_SET, False),
    "predictive": ("predictive", TRACKING_SET, False),
    "impedance, 4096 counts": ("impedance", TRACKING_SET, True),
    "admittance, 4096 counts": ("admittance", TRACKING_SET, True),
    "impedance, Table III": ("impedance", PUBLISHED_SETS["impedance"], False),
    "admittance, Table III": ("admittance", PUBLISHED_SETS["admittance"], False),
}


def run_case(bench: Bench, name: str) -> TrackingRun:
    """Run one of CASES.

    Args:
        bench: arms and shared runs.
        name: key of CASES.

    Returns:
        The run; each is simulated once a bench.

    """
    law, mbk, fine = TRACKING_CASES[name]
    return bench.compute_once(
        ("tracked", name), partial(track_circle, bench, law, mbk, TRACKING_PUSHES, TRACKING_SECONDS, fine)
    )


def run_with_structure_fault(bench: Bench, law: str, part: str) -> TrackingRun:
    """Run a law on an arm with a fault of its structure.

    Args:
        bench: arms and shared runs.
        law: "impedance" or "admittance".
        part: key of STRUCTURE; any other word stands for all faults together.

    Returns:
        The run; each is simulated once a bench.

    """
    changes = dict(STRUCTURE_FAULTS).get(part) or {
        name: v for one in STRUCTURE_FAULTS.values() for name, v in one.items()
    }
    make = partial(track_circle, bench, law, TRACKING_SET, TRACKING_PUSHES, TRACKING_SECONDS, changes=changes)
    return bench.compute_once(("built", law, part), make)


def run_cases(bench: Bench) -> dict[str, TrackingRun]:
    """Run all of CASES.

    Args:
        bench: arms and shared runs.

    Returns:
        The runs by key.

    """
    return {name: run_case(bench, name) for name in TRACKING_CASES}
