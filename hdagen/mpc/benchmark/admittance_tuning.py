"""Tuning of the admittance law's inner loop, so that the predictive controller is compared with a good rival."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference
from hdagen.mpc.configuration import Configuration, list_admittance_gains
from hdagen.simulation.ideal_admittance import simulate_ideal_admittance
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push, run

TUNED_GAIN_NAMES = ("bandwidth", "observer_bandwidth", "velocity_cutoff")
TUNING_METHOD = "Nelder-Mead on the logarithms of the gains, cost: mean distance from the ideal motion"
GAIN_SPREAD = 3.0  # factor about the defaults, either way
MOST_EVALUATIONS = 400  # of the simplex: evaluations
TUNING_SEED = 7


@dataclass(frozen=True)
class TunedGains:
    """Gains of `admittance_cartesian`, and the mean distance from the ideal motion that they reach, m."""

    gains: dict[str, float]
    distance: float
    evaluations: int


def tune_admittance(
    arm: Arm,
    c: Configuration,
    controller: Controller,
    path: Reference,
    pushes: Sequence[Push],
    sensors: Sensors,
    evaluations: int = 40,
) -> TunedGains:
    """Tune the inner loop so that the tip comes nearest to the ideal motion on one run, by `TUNING_METHOD`.

    Args:
        arm: The arm.
        c: The configuration, whose admittance is asked for.
        controller: The admittance law, which keeps the gains that were found.
        path: The path of the run.
        pushes: Forces on the tip.
        sensors: The sensors.
        evaluations: Runs that the tuning may take.

    Returns:
        The gains and the distance that they reach.

    """
    from scipy.optimize import minimize

    start = np.log([controller.gains[name] for name in TUNED_GAIN_NAMES])
    wanted = list_admittance_gains(arm.robot, c)

    def distance(logarithms: np.ndarray) -> float:
        inside = np.clip(logarithms, start - np.log(GAIN_SPREAD), start + np.log(GAIN_SPREAD))
        controller.configure(controller.guard, {**wanted, **dict(zip(TUNED_GAIN_NAMES, np.exp(inside), strict=True))})
        done = run(arm, controller, path, pushes, sensors, TUNING_SEED)
        goal = path.position + simulate_ideal_admittance(controller, done.push, path.period)
        return float(np.linalg.norm(done.tip - goal, axis=1).mean()) + float(np.abs(logarithms - inside).sum())

    simplex = start + np.vstack([np.zeros(3), 0.4 * np.eye(3)])
    options = {"maxfev": min(evaluations, MOST_EVALUATIONS), "initial_simplex": simplex, "xatol": 1e-2, "fatol": 1e-8}
    found = minimize(distance, start, method="Nelder-Mead", options=options)
    reached = distance(found.x)
    gains = {name: float(controller.gains[name]) for name in TUNED_GAIN_NAMES}
    return TunedGains(gains, reached, int(found.nfev) + 1)
