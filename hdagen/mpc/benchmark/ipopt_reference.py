"""Plans beside the truth: the whole nonlinear problem of a tick, converged by IPOPT in a child process of `gen`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import load
from hdagen.control.reference_motion import circle
from hdagen.mpc.benchmark.law_comparison import (
    CIRCLE_CENTER,
    CIRCLE_RADIUS,
    HARD_PUSHES,
    SECONDS_PER_TURN,
    make_table_configuration,
)
from hdagen.mpc.benchmark.sqp_convergence import CONVERGED_STEPS
from hdagen.mpc.configuration import read_configuration
from hdagen.mpc.predictive_controller import MPC, NonlinearProblem
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import run
from hdagen.support.child_processes import start_child_process

TRUTH_SAMPLES, TRUTH_SECONDS = 8, 4.0
TRUTH_TIMEOUT = 120.0  # s, of the child process


def solve_with_ipopt(robot: str, structure: str, problems: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Solve problems with IPOPT, in a child process.

    Args:
        robot: A preset or the path of a robot.toml.
        structure: Structure of the controller, as `python -m gen build --mpc` takes it.
        problems: Problems, as `python -m gen truth` takes them.

    Returns:
        One answer for each problem.

    Raises:
        PlantError: The process fails, or takes too long.

    """
    command = [sys.executable, "-P", "-m", "gen", "truth", f"--mpc={structure}", "--", robot]
    beside = os.pathsep.join(filter(None, (str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH"))))
    environment, pipe = {**os.environ, "PYTHONPATH": beside}, subprocess.PIPE
    try:
        with start_child_process(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=environment) as child:
            printed, said = child.communicate(json.dumps(problems), TRUTH_TIMEOUT)
    except subprocess.TimeoutExpired as error:
        raise PlantError(
            f"the reference did not finish within {TRUTH_TIMEOUT:g} s; take fewer samples or nodes."
        ) from error
    if child.returncode:
        raise PlantError(said.strip()[-2000:] or "the reference failed without a word.")
    return list(json.loads(printed))


@dataclass(frozen=True)
class TruthComparison:
    """A tick's problem, answered: cost of the truth's plan and of the tick's, both on finely integrated dynamics and
    with the penalties that they then need; the largest difference of their first torques, share of the largest."""

    tick: int
    status: str
    iterations: int
    cost: float
    cost_of_plan: float
    apart: float


def compare_with_truth(
    config: str | None = None, profile: str = "native", samples: int = TRUTH_SAMPLES
) -> tuple[TruthComparison, ...]:
    """Compare ticks of the table's second course with the truth, the controller converged.

    Args:
        config: Path of a controller.toml; None: the configuration of the table.
        profile: Profile of the build.
        samples: Count of ticks that are compared.

    Returns:
        The comparison of each tick.

    Raises:
        PlantError: The configuration is refused, or IPOPT fails.

    """
    c = make_table_configuration()
    if config is not None:
        c = read_configuration(config)
    c = c.with_changes(c.walls, mpc__steps=CONVERGED_STEPS)
    arm = load("paper", profile, mpc=c)
    controller = MPC(arm, c)
    path = circle(CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, TRUTH_SECONDS, float(c["mpc.period"]))
    chosen = np.linspace(50, len(path.position) - 2, samples).astype(int)
    taken: list[NonlinearProblem] = []
    count = 0

    def tick() -> None:
        nonlocal count
        controller.prepare()
        controller.step()
        if count in chosen:
            taken.append(controller.nonlinear_problem())
        count += 1

    controller.wrap_tick(tick)
    run(arm, controller, path, [push for push in HARD_PUSHES if push.start < TRUTH_SECONDS], Sensors(), 1)
    controller.wrap_tick(None)
    out = []
    for at, one, answer in zip(
        chosen, taken, solve_with_ipopt("paper", c.structure, [one.data for one in taken]), strict=True
    ):
        apart = float(np.abs(np.array(answer["T"])[0] - _take_first_torque(one)).max())
        costs = (float(answer["cost"]), float(answer["cost_of_plan"]))
        out.append(TruthComparison(int(at), str(answer["status"]), int(answer["iterations"]), *costs, apart))
    return tuple(out)


def format_truth_comparison(found: tuple[TruthComparison, ...]) -> list[str]:
    """Format the comparison for a terminal.

    Args:
        found: The comparison of each tick.

    Returns:
        Lines of text.

    """
    out = [
        "plans beside IPOPT's of the whole problem: tick, status, iterations, its cost, the plan's, first torque apart"
    ]
    for one in found:
        costs = f"{one.cost:.3e} {one.cost_of_plan:.3e} {one.apart:.1e}"
        out.append(f"  {one.tick:5} {one.status:28} {one.iterations:4} {costs}")
    return out


def _take_first_torque(one: NonlinearProblem) -> Array:
    return np.asarray(one.data["T"], float).reshape(-1, len(one.data["before"]))[0]
