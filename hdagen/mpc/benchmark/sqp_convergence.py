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
from hdagen.mpc.benchmark.law_comparison import (
    CIRCLE_CENTER,
    CIRCLE_RADIUS,
    SECONDS_PER_TURN,
    make_courses,
    make_table_configuration,
)
from hdagen.mpc.closed_loop_trial import Trial, evaluate_trial, run_trial
from hdagen.mpc.configuration import Configuration, list_admittance_gains
from hdagen.mpc.predictive_controller import MPC
from hdagen.simulation.ideal_admittance import simulate_ideal_admittance
from hdagen.simulation.simulated_sensors import Sensors

CONVERGED_STEPS, CONVERGED_SECONDS = 30, 4.0
CONVERGED_SEEDS = 5  # the noise alone moves the price of a run by half a percent
MOST_EXTRA_COST = 5e-3  # of the converged problem's cost


@dataclass(frozen=True)
class LoopCosts:
    """A course driven with one step a tick and converged, over the same seeds of the noise: mean prices of both, the
    share that one step costs more, and the largest violation of any limit in either (SI of its family)."""

    course: str
    once: float
    converged: float
    more: float
    violated: float


def compare_loop_costs(profile: str = "native", say: Callable[[str], None] = lambda _: None) -> tuple[LoopCosts, ...]:
    """Drive both courses of the table with one step a tick and with the converged problem.

    Args:
        profile: Profile of the build.
        say: Hears the name of each run as it begins.

    Returns:
        Prices of each course.

    Raises:
        PlantError: A build fails, or the controller refuses its configuration.

    """
    c = make_table_configuration()
    arm = load("paper", profile, mpc=c)
    controller, out = MPC(arm, c), []
    path = circle(CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, CONVERGED_SECONDS, float(c["mpc.period"]))
    for course, _, pushes, walls, limits in make_courses(c):
        prices, worst = {1: 0.0, CONVERGED_STEPS: 0.0}, 0.0
        felt = [push for push in pushes if push.start < CONVERGED_SECONDS]
        for steps in prices:
            controller.configure_with(limits.with_changes(limits.walls, mpc__steps=steps))
            for seed in range(1, CONVERGED_SEEDS + 1):
                say(f"{course}: {steps} steps a tick, noise {seed} of {CONVERGED_SEEDS}")
                found = run_trial(arm, controller, path, felt, Sensors(), walls, seed=seed)
                prices[steps] += compute_loop_cost(arm, limits, path, found, controller) / CONVERGED_SEEDS
                worst = max(worst, *evaluate_trial(arm, limits, path, found, controller).violated.values())
        out.append(
            LoopCosts(course, prices[1], prices[CONVERGED_STEPS], prices[1] / prices[CONVERGED_STEPS] - 1, worst)
        )
    return tuple(out)


def compute_loop_cost(arm: Arm, c: Configuration, path: Reference, found: Trial, controller: MPC) -> float:
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
    goal = path.position + simulate_ideal_admittance(controller, s.push, h, list_admittance_gains(arm.robot, c))
    node = round(c.grid[0] / h)
    share = s.torque / np.array(arm.manifest["mpc"]["torque"])
    q, v = (s.state[:, _joint_columns(arm, what)] for what in ("position", "velocity"))
    held = share - _holding_torque(arm, q, v, s.push) / np.array(arm.manifest["mpc"]["torque"])
    terms = {
        "position": s.tip - goal,
        "velocity": np.gradient(s.tip - goal, h, axis=0),
        "posture": v,
        "torque": held,
        "torque_rate": share[node:] - share[:-node],
    }
    return float(sum(0.5 * c[f"weights.{name}"] * np.sum(value**2) for name, value in terms.items()) / len(share))


def _joint_columns(arm: Arm, what: str) -> list[int]:
    return [arm.index(f"joint_{what}_{j}") for j in range(1, arm.n + 1)]


def _holding_torque(arm: Arm, q: Array, v: Array, force: Array) -> Array:
    """Motor torque that holds the arm at rest under the force on its tip (T, n)."""
    ratio = np.array([arm.parameters[f"ratio_{j}"] for j in range(1, arm.n + 1)])
    gravity = arm.evaluate("gravity_torque", q=q)["g"]
    J = arm.evaluate("tip_jacobian", q=q, v=v)["J"].reshape(len(q), arm.n, 2)  # by columns
    return np.asarray((gravity - np.einsum("tji,ti->tj", J, force)) / ratio)


def format_loop_costs(found: tuple[LoopCosts, ...]) -> list[str]:
    """Format the prices for a terminal.

    Args:
        found: Prices of each course.

    Returns:
        Lines of text.

    """
    out = [
        f"closed loop, one step a tick beside the converged problem's (mean cost a tick, {CONVERGED_SEEDS} seeds of the"
        " noise):"
    ]
    for loop in found:
        met = "missed"
        if loop.more <= MOST_EXTRA_COST:
            met = "met"
        out.append(
            f"  {loop.course}: {loop.once:.5g} and {loop.converged:.5g}, {loop.more:+.2%} "
            f"(bar: at most {MOST_EXTRA_COST:+.1%}: {met}); largest violation {loop.violated:.2g}"
        )
    return out
