"""Plans beside the truth: what the whole nonlinear problem, converged by IPOPT in a child process of `gen`, would
do."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.mpc.comparison import CENTER, HARD, RADIUS, TURN, WALLS, default
from hdagen.mpc.configuration import Configuration, read
from hdagen.mpc.controller import MPC, Problem
from hdagen.plant import Array, PlantError, load
from hdagen.reference import circle
from hdagen.simulate import Sensors, run

SAMPLES, SECONDS = 4, 4.0
LONGEST = 120.0  # s, of the child process


def ask(robot: str, structure: str, problems: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """IPOPT's answers to problems as `gen.mpc.truth` takes them. Raises PlantError."""
    command = [sys.executable, "-P", "-m", "gen", "truth", f"--mpc={structure}", "--", robot]
    beside = os.pathsep.join(filter(None, (str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH"))))
    try:
        done = subprocess.run(
            command, input=json.dumps(problems), capture_output=True, text=True, timeout=LONGEST, check=False,
            env={**os.environ, "PYTHONPATH": beside},
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise PlantError(f"the reference did not finish within {LONGEST:g} s; take fewer samples or nodes.") from error
    if done.returncode:
        raise PlantError(done.stderr.strip()[-2000:] or "the reference failed without a word.")
    return list(json.loads(done.stdout))


def against_truth(config: str | None = None, profile: str = "native", samples: int = SAMPLES) -> dict[str, Any]:
    """Ticks of the table's second course beside the truth: costs of both plans on finely integrated dynamics, and their
    first torques. Raises PlantError."""
    c = default() if config is None else read(config)
    arm = load("paper", profile, mpc=c)
    controller = MPC(arm, c)
    path = circle(RADIUS, CENTER, TURN, SECONDS, float(c["mpc.period"]))
    chosen = np.linspace(50, len(path.position) - 2, samples).astype(int)
    taken: list[Problem] = []
    count = 0

    def tick() -> None:
        nonlocal count
        controller.prepare()
        controller.step()
        if count in chosen:
            taken.append(controller.whole())
        count += 1

    controller.through(tick)
    run(arm, controller, path, [push for push in HARD if push.start < SECONDS], Sensors(), 1)
    controller.through(None)
    return compared(c, taken)


def compared(c: Configuration, taken: list[Problem]) -> dict[str, Any]:
    """The problems, answered by the truth."""
    answers = ask("paper", c.structure, [one.data for one in taken])
    gaps, ratios = [], []
    for one, answer in zip(taken, answers, strict=True):
        first = np.array(answer["T"])[0] - _first(one)
        gaps.append(float(np.abs(first).max()))
        ratios.append(answer["cost_of_plan"] / answer["cost"] - 1)
    return {
        "walls": len(WALLS),
        "samples": len(taken),
        "status": [answer["status"] for answer in answers],
        "iterations": [answer["iterations"] for answer in answers],
        "cost_excess": ratios,
        "first_torque_apart": gaps,
    }


def _first(one: Problem) -> Array:
    return np.asarray(one.data["T"], float).reshape(-1, len(one.data["before"]))[0]
