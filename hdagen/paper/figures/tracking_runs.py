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
    ROBOT,
    STRUCTURE,
    TURN,
    Bench,
    cartesian,
    controller,
    encoders_of,
    guard,
    turns,
)
from hdagen.simulation.simulator import Push, Simulation, World, run

SECONDS = 3 * TURN
STARTS = 1.0  # s in which the circle is brought to speed; they do not count
SHOVE = 10.0  # N, assumed; the paper says "an external force"
SHOVES = (Push(6.0, 7.0, (SHOVE, 0.0)), Push(8.0, 9.0, (0.0, SHOVE)))
SHOWN = ((6.0, 7.0, f"{SHOVE:g} N in x"), (8.0, 9.0, f"{SHOVE:g} N in y"))
PUBLISHED = {"impedance": (0.001, 1e-10, 1e-5), "admittance": (1000.0, 0.5, 10.0)}  # kg, N s/m, N/m: Table III
SENSIBLE = (2.0, 45.0, 500.0)  # a load for a hand, damping ratio 0.7, 20 mm under the push
TABLE_4 = {"impedance": ((3.1, 3.6), (1.5, 0.3), (2.4, 1.8)), "admittance": ((3.4, 3.7), (0.4, 1.5), (1.7, 0.8))}  # mm


@dataclass(frozen=True)
class Tracked:
    """A run along a ``path`` (T, 2, m): ``refused`` counts the ticks that the guard refused; ``lost`` is the time of
    the first of them, s (None without one), ``fault`` its message."""

    simulation: Simulation
    path: Array
    refused: int
    lost: float | None
    fault: str

    @property
    def off(self) -> Array:
        """Path error (T, 2, m): the tip less the path."""
        return self.simulation.tip - self.path

    @property
    def log(self) -> Log:
        """The log of the run."""
        return self.simulation.log

    def errors(self, circles: Sequence[int]) -> Array:
        """Compute the largest error, the mean and the standard deviation over whole circles without the start.

        Args:
            circles: numbers of the circles, from 0.

        Returns:
            The three by axis (3, 2), m.

        """
        off = self.over(circles)
        return np.stack([np.abs(off).max(axis=0), np.abs(off.mean(axis=0)), off.std(axis=0)])

    def over(self, circles: Sequence[int]) -> Array:
        """Select the path error of whole circles without the start.

        Args:
            circles: numbers of the circles, from 0.

        Returns:
            Path error (rows, 2), m.

        """
        time = self.log.time
        rows = np.zeros(len(time), bool)
        for k in circles:
            rows |= (time >= max(k * TURN, STARTS)) & (time < (k + 1) * TURN)
        return self.off[rows]


def tracked(
    bench: Bench,
    law: str,
    mbk: tuple[float, float, float],
    pushes: Sequence[Push],
    seconds: float,
    fine: bool = False,
    changes: Mapping[str, float] | None = None,
    gains: Mapping[str, float] | None = None,
    world: World | None = None,
    seed: int = 1,
) -> Tracked:
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
        regulator = predictive(bench, mbk)
    else:
        regulator = controller(bench.once("known", bench.arm), law, {**cartesian(*mbk), **(gains or {})}, fine)
    return followed(bench.arm(changes=changes), regulator, pushes, seconds, fine, world, seed)


def followed(
    plant: Arm,
    regulator: Controller,
    pushes: Sequence[Push],
    seconds: float,
    fine: bool = False,
    world: World | None = None,
    seed: int = 1,
) -> Tracked:
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
    path = turns(seconds)
    found = run(plant, regulator, path, pushes, encoders_of(fine), seed, world=world)
    refused = np.flatnonzero(found.status < 0)
    if not len(refused):
        return Tracked(found, path.position, 0, None, "")
    first = int(refused[0])
    fault = regulator.sentence(int(found.status[first]))
    return Tracked(found, path.position, len(refused), float(found.log.time[first]), fault)


def predictive(bench: Bench, mbk: tuple[float, float, float], force: str = "sensor") -> Controller:
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
    wanted = Configuration().changed(**admittance, admittance__force=force)
    arm: Arm = bench.once("predictive", lambda: load(ROBOT, bench.profile, mpc=wanted))
    return MPC(arm, wanted, guard())


CASES = {  # law, M, B and K, whether with encoders of 4096 counts
    "impedance": ("impedance", SENSIBLE, False),
    "admittance": ("admittance", SENSIBLE, False),
    "predictive": ("predictive", SENSIBLE, False),
    "impedance, 4096 counts": ("impedance", SENSIBLE, True),
    "admittance, 4096 counts": ("admittance", SENSIBLE, True),
    "impedance, Table III": ("impedance", PUBLISHED["impedance"], False),
    "admittance, Table III": ("admittance", PUBLISHED["admittance"], False),
}


def case(bench: Bench, name: str) -> Tracked:
    """Run one of CASES.

    Args:
        bench: arms and shared runs.
        name: key of CASES.

    Returns:
        The run; each is simulated once a bench.

    """
    law, mbk, fine = CASES[name]
    return bench.once(("tracked", name), partial(tracked, bench, law, mbk, SHOVES, SECONDS, fine))


def built(bench: Bench, law: str, part: str) -> Tracked:
    """Run a law on an arm with a fault of its structure.

    Args:
        bench: arms and shared runs.
        law: "impedance" or "admittance".
        part: key of STRUCTURE; any other word stands for all faults together.

    Returns:
        The run; each is simulated once a bench.

    """
    changes = dict(STRUCTURE).get(part) or {name: v for one in STRUCTURE.values() for name, v in one.items()}
    make = partial(tracked, bench, law, SENSIBLE, SHOVES, SECONDS, changes=changes)
    return bench.once(("built", law, part), make)


def cases(bench: Bench) -> dict[str, Tracked]:
    """Run all of CASES.

    Args:
        bench: arms and shared runs.

    Returns:
        The runs by key.

    """
    return {name: case(bench, name) for name in CASES}
