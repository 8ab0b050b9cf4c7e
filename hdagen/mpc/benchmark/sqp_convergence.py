"""The cost of one step of sequential quadratic programming a tick in closed loop, beside that of the converged problem:
the same controller, iterated every tick until its torques stand still (`mpc.steps`), on the same course, seed and arm.

The price is the controller's own cost along the real motion, with the ideal motion in place of its forecast.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.reference_motion import Reference, circle
from hdagen.mpc.benchmark.law_comparison import CENTER, RADIUS, TURN, courses, default
from hdagen.mpc.closed_loop_trial import Trial, outcome, trial
from hdagen.mpc.configuration import Configuration, gains_of
from hdagen.mpc.predictive_controller import MPC
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import ideal

STEPS, SECONDS = 30, 4.0
SEEDS = 5  # the noise alone moves the price of a run by half a percent
BAR = 5e-3  # of the converged problem's cost


@dataclass(frozen=True)
class Loop:
    """A course driven with one step a tick and converged, over the same seeds of the noise: mean prices of both, the
    share that one step costs more, and the largest violation of any limit in either (SI of its family)."""

    course: str
    once: float
    converged: float
    more: float
    violated: float


def loops(profile: str = "native", say: Callable[[str], None] = lambda _: None) -> tuple[Loop, ...]:
    """Drive both courses of the table with one step a tick and with the converged problem.

    Args:
        profile: Profile of the build.
        say: Hears the name of each run as it begins.

    Returns:
        Prices of each course.

    Raises:
        PlantError: A build fails, or the controller refuses its configuration.

    """
    c = default()
    arm = load("paper", profile, mpc=c)
    controller, out = MPC(arm, c), []
    path = circle(RADIUS, CENTER, TURN, SECONDS, float(c["mpc.period"]))
    for course, _, pushes, walls, limits in courses(c):
        prices, worst = {1: 0.0, STEPS: 0.0}, 0.0
        felt = [push for push in pushes if push.start < SECONDS]
        for steps in prices:
            controller.configure_with(limits.changed(limits.walls, mpc__steps=steps))
            for seed in range(1, SEEDS + 1):
                say(f"{course}: {steps} steps a tick, noise {seed} of {SEEDS}")
                found = trial(arm, controller, path, felt, Sensors(), walls, seed=seed)
                prices[steps] += price(arm, limits, path, found, controller) / SEEDS
                worst = max(worst, *outcome(arm, limits, path, found, controller).violated.values())
        out.append(Loop(course, prices[1], prices[STEPS], prices[1] / prices[STEPS] - 1, worst))
    return tuple(out)


def price(arm: Arm, c: Configuration, path: Reference, found: Trial, controller: MPC) -> float:
    """Compute the controller's cost along a run.

    Args:
        arm: The controlled arm.
        c: The configuration, whose weights count.
        path: The commanded path of the tip.
        found: The run.
        controller: The controller of the run.

    Returns:
        Mean cost of a tick, without a unit.

    """
    s, h = found.simulation, path.period
    goal = path.position + ideal(arm, controller, s.push, h, gains_of(c))
    node = round(c.grid[0] / h)
    share = s.torque / np.array(arm.manifest["mpc"]["torque"])
    q, v = (s.state[:, _columns(arm, what)] for what in ("position", "velocity"))
    held = share - _hold(arm, q, v, s.push) / np.array(arm.manifest["mpc"]["torque"])
    terms = {
        "position": s.tip - goal,
        "velocity": np.gradient(s.tip - goal, h, axis=0),
        "posture": v,
        "torque": held,
        "torque_rate": share[node:] - share[:-node],
    }
    return float(sum(0.5 * c[f"weights.{name}"] * np.sum(value**2) for name, value in terms.items()) / len(share))


def _columns(arm: Arm, what: str) -> list[int]:
    return [arm.index(f"joint_{what}_{j}") for j in range(1, arm.n + 1)]


def _hold(arm: Arm, q: Array, v: Array, force: Array) -> Array:
    """Motor torque that holds the arm at rest under the force on its tip (T, n)."""
    ratio = np.array([arm.parameters[f"ratio_{j}"] for j in range(1, arm.n + 1)])
    gravity = arm.evaluate("gravity_torque", q=q)["g"]
    J = arm.evaluate("tip_jacobian", q=q, v=v)["J"].reshape(len(q), arm.n, 2)  # by columns
    return np.asarray((gravity - np.einsum("tji,ti->tj", J, force)) / ratio)


def lines(found: tuple[Loop, ...]) -> list[str]:
    """Format the prices for a terminal.

    Args:
        found: Prices of each course.

    Returns:
        Lines of text.

    """
    out = [
        f"closed loop, one step a tick beside the converged problem's (mean cost a tick, {SEEDS} seeds of the noise):"
    ]
    for loop in found:
        met = "missed"
        if loop.more <= BAR:
            met = "met"
        out.append(
            f"  {loop.course}: {loop.once:.5g} and {loop.converged:.5g}, {loop.more:+.2%} "
            f"(bar: at most {BAR:+.1%}: {met}); largest violation {loop.violated:.2g}"
        )
    return out
